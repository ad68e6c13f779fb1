"""Segments as a cue: what they tell above null partitions, where it leads, and what a user sees."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import invoke, unwrapped
from conftest import edited, make_pose, without
from scipy.spatial.transform import Rotation

from semcal_cli import core
from semcal_cli.checks.families import check_consistency
from semcal_cli.checks.other_pose import check_rivals
from semcal_cli.config import CalibrationConfig, CueName, ExactConfig, InitializationConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.estimation.refine.several_starts import SeveralStarts
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.search.mounting_search import search_mountings
from semcal_cli.estimation.uncertainty.information import information_by_squares
from semcal_cli.findings.check import findings_among
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.cues.segments import KINDS, SEGMENTS, STARTS, observe_segments
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.observations import NO_CLASS, LabelledCloud, Observations
from semcal_cli.pipeline import refine_and_polish, start_at

FAR = make_pose((0.02, -0.015, 0.024), (0.1, -0.1, 0.14))
"""2 degrees and 0.2 m."""


@pytest.fixture(scope="module")
def seen(street: Path) -> Observations:
    return observe_segments(read_drive(street))


@pytest.fixture
def bare(drive: Path) -> Path:
    """The drive without point labels."""
    without(drive, "point_labels")
    shutil.rmtree(drive / "point_labels")
    return drive


def test_points_are_ground_objects_or_nothing(seen: Observations) -> None:
    assert seen.has_partitions
    assert list(seen.point_class_names) == list(KINDS.values())
    classes = np.concatenate([cloud.classes for cloud in seen.clouds])
    assert set(np.unique(classes)) <= {core.GROUND, core.OBJECT, 255}
    assert 0.2 < np.mean(classes == core.GROUND) < 0.8
    assert np.mean(classes == 255) < 0.15


def test_information_is_highest_at_the_truth_about_every_axis(seen: Observations, street_truth: Pose) -> None:
    own = information_by_squares(seen, street_truth).mean
    for axis in np.eye(3):
        for side in (-0.02, 0.02):
            turned = make_pose(tuple(axis * side), (0.0, 0.0, 0.0)) @ street_truth
            assert information_by_squares(seen, turned).mean < 0.9 * own


def test_segments_in_the_wrong_place_tell_nothing(seen: Observations, street_truth: Pose) -> None:
    found = information_by_squares(seen, street_truth)
    assert found.mean > 5.0 * np.linalg.norm(found.influence)
    about_up = np.eye(4)
    about_up[:3, :3] = Rotation.from_euler("z", 100.0, degrees=True).as_matrix()
    elsewhere = information_by_squares(seen, street_truth @ about_up)
    assert elsewhere.mean < 0.3 * found.mean


def test_the_order_of_points_changes_nothing(street: Path, seen: Observations, street_truth: Pose) -> None:
    rng = np.random.default_rng(0)
    orders = [rng.permutation(cloud.num_points) for cloud in seen.clouds]
    points = [cloud.points[order] for cloud, order in zip(seen.clouds, orders, strict=True)]
    shuffled = with_points(seen, points)
    expected = information_by_squares(seen, street_truth).mean
    assert information_by_squares(shuffled, street_truth).mean == pytest.approx(expected, rel=0.03)


def test_the_mounting_of_the_lidar_changes_little(seen: Observations, street_truth: Pose) -> None:
    turn = make_pose((0.0, 1.2, 2.0), (0.0, 0.0, 0.0))
    points = [(cloud.points @ turn[:3, :3].T).astype(np.float32) for cloud in seen.clouds]
    found = information_by_squares(with_points(seen, points), street_truth @ np.linalg.inv(turn)).mean
    assert found == pytest.approx(information_by_squares(seen, street_truth).mean, rel=0.1)


def with_points(seen: Observations, points: list[np.ndarray]) -> Observations:
    """The same images with other sweeps, segmented anew."""
    segmented = core.segment_sweeps(points, SEGMENTS.segmentation)
    partitions = core.turned_partitions(points, segmented, SEGMENTS.num_turns)
    kinds = [np.append(sweep.kinds, 255)[np.minimum(sweep.ids, sweep.num_segments)] for sweep in segmented]
    clouds = [
        LabelledCloud(each, kind.astype(np.uint8), partitions=partition)
        for each, kind, partition in zip(points, kinds, partitions, strict=True)
    ]
    return seen.with_clouds(clouds)


@pytest.mark.parametrize("cues", [("segments",), ("labels", "segments")])
def test_a_start_two_degrees_off_comes_back(
    street: Path, street_truth: Pose, cues: tuple[CueName, ...]
) -> None:
    config = CalibrationConfig(cues=cues)
    data = load(read_drive(street), config)
    initial = start_at(data, InitialPose(FAR @ street_truth, "start"))
    error = compare_poses(refine_and_polish(data, initial, config.refinement).T_camera_lidar, street_truth)
    assert error.rotation_deg < 0.15
    assert error.camera_center_cm < 3.0


def test_the_camera_is_upright_though_the_lidar_is_upside_down(
    seen: Observations, street_truth: Pose
) -> None:
    over = make_pose((np.pi, 0.0, 0.0), (0.0, 0.0, 0.0))
    turned = replace(seen.of_classes, lidar=None).with_clouds(
        cloud.with_points((cloud.points @ over[:3, :3].T).astype(np.float32)) for cloud in seen.clouds
    )
    hypotheses = search_mountings(turned, InitializationConfig(), 0).hypotheses
    best = compare_poses(hypotheses[0].T_camera_lidar @ over, street_truth)
    assert best.rotation_deg < 3.0
    down_in_camera = [-(each.T_camera_lidar @ over)[:3, 2] for each in hypotheses]
    assert min(down[1] for down in down_in_camera) > 0.5


def test_a_drive_without_labels_of_points_needs_no_start(bare: Path, street_truth: Pose) -> None:
    output = bare.parent / "found.yaml"
    arguments = ["calibrate", bare, "--cue", "segments", "-o", output]
    answer = invoke(*arguments)
    assert answer.exit_code in (0, 3), answer.output
    error = compare_poses(read_transform(output), street_truth)
    assert error.rotation_deg < 0.15
    assert error.camera_center_cm < 3.0
    settings = yaml.safe_load(output.read_text())["settings"]["options"]
    assert settings["cues"]["segments"]["num_turns"] == SEGMENTS.num_turns


def test_the_same_bytes_with_any_number_of_threads(bare: Path, street_truth: Pose) -> None:
    write_transform(FAR @ street_truth, bare.parent / "start.json", "lidar2cam")
    outputs = []
    for threads in ("1", "2"):
        output = bare.parent / f"threads_{threads}.yaml"
        arguments = ["refine", bare, "--init", bare.parent / "start.json", "--cue", "segments", "-o", output]
        answer = invoke(*arguments, "--max-frames", "2", "--threads", threads, "-q")
        assert answer.exit_code in (0, 3), answer.output
        outputs.append(output.read_bytes())
    assert outputs[0] == outputs[1]


def test_beside_intensity_segments_weigh_less_and_are_searched_alone(street: Path) -> None:
    drive = read_drive(street)
    cues: tuple[CueName, ...] = ("segments", "intensity")
    both = load_cues(drive, cues)
    weights = [{each.weight for each in both.of_cue(cue).frame_observations} for cue in range(2)]
    assert weights == [{SEGMENTS.weight_by_intensity}, {1.0}]
    searched = LoadedDrive(drive, both, cues).searched_by
    assert searched.num_frames == len(drive.frames)
    assert not searched.has_partitions
    assert both.starts == STARTS


def test_images_of_unsure_labels_are_exchanged_as_sure_as_their_own(
    seen: Observations, street_truth: Pose, tmp_path: Path
) -> None:
    unsure = []
    for index, image in enumerate(seen.images):
        sure = np.eye(len(seen.image_class_names), dtype=np.uint8)
        shares = sure[np.where(image.classes == NO_CLASS, 0, image.classes)] * np.uint8(8) + np.uint8(2)
        np.savez(tmp_path / f"{index}.npz", shares)
        (read,) = core.read_class_shares([tmp_path / f"{index}.npz"], image.classes.shape)
        unsure.append(replace(image, shares=read))
    found = findings_among(check_consistency(seen.with_images(unsure), street_truth, estimated_s=None))
    assert not any("images of other frames" in finding.sentence for finding in found)


def test_a_weight_scales_a_cue(seen: Observations, street_truth: Pose) -> None:
    light = replace(
        seen, frame_observations=tuple(replace(each, weight=0.5) for each in seen.frame_observations)
    )
    full, half = (information_by_squares(each, street_truth) for each in (seen, light))
    assert half.weights.sum() == pytest.approx(0.5 * full.weights.sum(), rel=1e-5)
    # Pairs that weigh little count as a tenth of a point.
    assert half.mean == pytest.approx(full.mean, rel=0.1)


def test_what_cannot_be_done_is_said(bare: Path) -> None:
    with pytest.raises(InputError, match=r"drive.yaml: frames.*point_labels: found nothing"):
        load(read_drive(bare), CalibrationConfig(cues=("labels",)))
    with edited(bare) as document:
        del document["frames"][0]["image_labels"]
    with pytest.raises(InputError, match=r"drive.yaml: frames.*image_labels: found nothing"):
        load(read_drive(bare), CalibrationConfig(cues=("segments",)))


def test_verify_tells_a_knocked_camera(bare: Path, street_truth: Pose) -> None:
    knocked = make_pose((0.0, 0.026, 0.0), (0.0, 0.0, 0.0)) @ street_truth
    verdicts = []
    for T in (street_truth, knocked):
        write_transform(T, bare.parent / "stored.json", "lidar2cam")
        answer = invoke("verify", bare, bare.parent / "stored.json", "--cue", "segments")
        verdicts.append(answer.exit_code)
    assert verdicts[0] in (0, 4)
    assert verdicts[1] in (3, 4)
    assert verdicts != [4, 4]


@pytest.mark.parametrize("by", ["class", "segment"])
def test_overlays_need_no_labels_of_points(bare: Path, street_truth: Pose, by: str) -> None:
    write_transform(street_truth, bare.parent / "stored.json", "lidar2cam")
    folder = bare.parent / by
    arguments = ["overlay", bare, bare.parent / "stored.json", "--cue", "segments", "--by", by]
    answer = invoke(*arguments, "-o", folder, "--max-frames", "1")
    assert answer.exit_code == 0, answer.output
    assert len(list(folder.glob("*.png"))) == 1


def test_a_right_pose_has_no_rival_and_a_wrong_one_has(seen: Observations, street_truth: Pose) -> None:
    several = replace(seen, starts=STARTS)
    assert findings_among(check_rivals(several, street_truth, None)) == ()
    (found,) = findings_among(check_rivals(several, FAR @ street_truth, None))
    assert "explains the data better" in found.sentence
    assert "standard errors; a trusted pose must beat every other by 3: add frames" in found.sentence


def test_starts_that_meet_go_on_as_one(seen: Observations, street_truth: Pose) -> None:
    starts = SeveralStarts(seen, ExactConfig(), 0, STARTS)
    level = starts.ascend(8, street_truth, visible_only=False)
    assert compare_poses(level.T_camera_lidar, street_truth).rotation_deg < 0.5
    assert len(starts.poses) < STARTS.num_starts[0] // 2


def test_a_level_without_maxima_in_reach_stays_where_it_was(seen: Observations, street_truth: Pose) -> None:
    nowhere = replace(STARTS, farthest_m=0.0)
    level = SeveralStarts(seen, ExactConfig(), 0, nowhere).ascend(8, street_truth, visible_only=False)
    assert np.array_equal(level.T_camera_lidar, street_truth)


def test_segments_beside_intensity_are_checked_by_it(street: Path) -> None:
    both, alone = (
        load(street, CalibrationConfig(cues=cues)) for cues in (("segments", "intensity"), ("segments",))
    )
    assert not both.checked_by.has_partitions
    assert both.checked_by.num_cues == 1
    assert alone.checked_by.has_partitions


def test_a_report_shows_the_first_of_two_cues(bare: Path, tmp_path: Path) -> None:
    made = tmp_path / "initial.yaml"
    asked = ["initialize", bare, "--cue", "segments,intensity", "-o", made, "-q"]
    assert invoke(*asked).exit_code == 0
    page = tmp_path / "report.html"
    result = invoke("report", bare, made, "-o", page, "-q")
    assert result.exit_code == 0, result.output
    assert all(kind in page.read_text() for kind in KINDS.values())


def test_a_sweep_without_segments_says_nothing(bare: Path, street_truth: Pose) -> None:
    sweep = sorted((bare / "points").iterdir())[1]
    sweep.write_bytes(sweep.read_bytes()[: 16 * 10])
    data = load(bare, CalibrationConfig(cues=("segments",)))
    initial = start_at(data, InitialPose(street_truth, "start"))
    found = refine_and_polish(data, initial, CalibrationConfig().refinement)
    assert compare_poses(found.T_camera_lidar, street_truth).rotation_deg < 0.3


def test_sweeps_of_one_kind_of_segments_are_named(bare: Path) -> None:
    for sweep in sorted((bare / "points").iterdir()):
        points = np.fromfile(sweep, np.float32).reshape(-1, 4)
        points[:, 2] = -1.7
        points.tofile(sweep)
    shown = invoke("inspect", bare)
    assert ": no objects found in this sweep, which --cue segments needs" in unwrapped(shown.output, 12)
    answer = invoke("initialize", bare, "--cue", "segments", "-q")
    assert isinstance(answer.exception, CalibrationError)
    expected = (
        f"{bare / 'drive.yaml'}: no initial calibration: found points of only ground, expected two classes"
    )
    assert str(answer.exception) == expected
