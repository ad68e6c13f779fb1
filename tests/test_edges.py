"""Edges as a cue: what they are, where they lead, from how far, and what a user sees."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import yaml
from commands import invoke
from conftest import make_pose, real, without
from dataset_imports import run_import

from semcal_cli import core, threads
from semcal_cli.checks import other_pose
from semcal_cli.checks.cues_disagree import check_coarse_cue
from semcal_cli.config import AUTO, CalibrationConfig, ExactConfig, PolishConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.refine import higher_maxima
from semcal_cli.estimation.refine.higher_maxima import climb, ends_elsewhere
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import Level
from semcal_cli.estimation.refine.several_starts import SeveralStarts
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.search.mounting_search import with_best
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.cue_table import choose_cues
from semcal_cli.observations.cues.edges import (
    STARTS,
    STARTS_ALONE,
    edges_of_sweeps,
    observe_edges,
)
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import NO_CLASS, LabelledImage, Observations
from semcal_cli.observations.reading import read_clouds
from semcal_cli.pipeline import calibrate, initialize

FAR = make_pose((0.02, -0.015, 0.024), (0.1, -0.1, 0.14))
"""2 degrees and 0.2 m."""
UNMOVED = 0.95
"""Share of the levels that another exposure leaves where they were: rounded grey values move some."""


@pytest.fixture(scope="session")
def street(fine_street: Path) -> Path:
    """Few points have too few edges."""
    return fine_street


@pytest.fixture(scope="module")
def seen(street: Path) -> Observations:
    return observe_edges(read_drive(street))


@pytest.fixture
def bare(drive: Path) -> Path:
    """The drive without point labels."""
    return without(drive, "point_labels")


def test_without_intensities_only_ranges_step(street: Path, tmp_path: Path) -> None:
    drive = read_drive(street)
    points = read_clouds(drive)[0].points
    np.save(tmp_path / "bare.npy", points)
    (cloud,) = core.read_point_clouds([(tmp_path / "bare.npy", None)], len(points))
    assert edges_of_sweeps([cloud]).names == [
        "no edge",
        *(f"range step {level}" for level in (1, 2, 3)),
    ]


def test_exposure_and_light_change_no_level(street: Path, seen: Observations, tmp_path: Path) -> None:
    shutil.copytree(street, tmp_path / "dusk")
    drive = read_drive(tmp_path / "dusk")
    path = str(drive.resolve(str(drive.frames[0].image)))
    image = cv2.imread(path)
    assert image is not None
    light = np.linspace(1.0, 0.5, image.shape[1])[:, None]
    cv2.imwrite(path, (image * light).round().astype(np.uint8))
    dark = observe_edges(drive.model_copy(update={"frames": drive.frames[:1]}))
    before, after = seen.images[0].classes, dark.images[0].classes
    assert np.mean(np.abs(before.astype(int) - after.astype(int)) <= 1) > UNMOVED


def test_information_is_highest_at_the_truth_about_every_axis(seen: Observations, street_truth: Pose) -> None:
    own = information(seen, street_truth)
    for axis in np.eye(3):
        for side in (-0.02, 0.02):
            turned = make_pose(tuple(axis * side), (0.0, 0.0, 0.0)) @ street_truth
            assert information(seen, turned) < 0.9 * own


def information(seen: Observations, T_camera_lidar: Pose) -> float:
    agreement = core.agreement(seen.core, T_camera_lidar)
    return agreement.mutual_information - agreement.bias


def test_a_start_two_degrees_off_comes_back_and_few_scenes_are_not_trusted(
    street: Path, street_truth: Pose
) -> None:
    config = CalibrationConfig(cues=("edges",))
    data = load(street, config)
    start = InitialPose(FAR @ street_truth, "far")
    error = compare_poses(calibrate(data, config, initial_pose=start).pose, street_truth)
    # A few frames of images 5 pixels a ray: half of that, at 20 m.
    assert error.rotation_deg < 0.3
    assert error.camera_center_cm < 8.0
    few = calibrate(data.of_frames([0, 1]), config, initial_pose=start)
    assert any(
        "the frames show 2 places; at least 4 are needed for edges" in reason for reason in few.reasons
    )


def test_a_given_pose_is_never_left_for_a_worse_one(seen: Observations, street_truth: Pose) -> None:
    start = make_pose((0.05, 0.05, 0.05), (0.2, 0.2, 0.2)) @ street_truth
    single = replace(STARTS, num_starts=(1,))
    several = SeveralStarts(seen, ExactConfig(), 0, single, candidates=[street_truth])
    T = start
    for factor in (2, 1):
        T = several.ascend(factor, T, visible_only=True).T_camera_lidar
    least = newton(seen, street_truth, PolishConfig()).T_camera_lidar
    config = replace(ExactConfig(), steps=0)
    found, finished = core.align(seen.core, [T, least], config, factor=1, visible_only=True, seed=0)
    assert found.value >= finished.value - 1e-9


def with_painted_edges(seen: Observations, *painted: tuple[Pose, int]) -> Observations:
    """Observe images of random levels, in which steps in range lie on a level where they are seen from each pose."""
    rng = np.random.default_rng(0)
    images = []
    for cloud, image in zip(seen.clouds, seen.images, strict=True):
        levels = rng.integers(2, 6, image.classes.shape, dtype=np.uint8)
        edges = cloud.points[(cloud.classes != NO_CLASS) & (cloud.classes > 3)]
        for T_camera_lidar, level in painted:
            projected = core.project_points(core_camera(seen.camera), edges, T_camera_lidar)
            u, v = projected.pixels[np.isfinite(projected.ranges)].astype(int).T
            on_edges = np.zeros_like(levels)
            on_edges[v, u] = 1
            levels[cv2.dilate(on_edges, np.ones((3, 3))) > 0] = level
        images.append(LabelledImage(levels, core.ClassShares.certain(levels.ravel())))
    return seen.with_images(images)


def test_edges_on_weak_gradients_lead_a_search_by_information_away_and_not_one_by_contrast(
    seen: Observations, street_truth: Pose
) -> None:
    elsewhere = make_pose((0.0, 0.05, 0.0), (0.0, 0.0, 0.0)) @ street_truth
    # Steps in range lie on strong gradients from the right pose, and on far weaker ones from a wrong one.
    painted = with_painted_edges(seen, (street_truth, 6), (elsewhere, 0))
    assert information(painted, elsewhere) > information(painted, street_truth)
    start = make_pose((0.0, 0.02, 0.0), (0.05, 0.0, 0.05)) @ street_truth
    ends = [
        SeveralStarts(painted, ExactConfig(), 0, starts).coarse_maximum(start)
        for starts in (STARTS, STARTS_ALONE)
    ]
    by_information, by_contrast = (compare_poses(end, street_truth).rotation_deg for end in ends)
    assert by_contrast < 0.5
    assert by_information > 2.0


@pytest.mark.parametrize(
    ("missing", "expected"),
    [
        ((), ("labels",)),
        (("point_labels",), ("segments", "edges")),
        (("point_labels", "image_labels"), ("edges",)),
        (("point_labels", "image"), ("segments",)),
        (("point_labels", "image_labels", "image"), ("labels",)),
    ],
)
def test_the_cue_is_chosen_by_the_files_of_a_drive(
    drive: Path, missing: tuple[str, ...], expected: tuple[str, ...]
) -> None:
    assert choose_cues(AUTO, read_drive(without(drive, *missing)), SweepCache()) == expected
    assert choose_cues(("intensity",), read_drive(drive), SweepCache()) == ("intensity",)


def test_without_labels_of_points_edges_are_refined_from_where_segments_lead(
    bare: Path, tmp_path: Path
) -> None:
    result = invoke("calibrate", bare, "-o", tmp_path / "found.yaml")
    assert result.exit_code in (0, 3), result.output
    assert "by segments and edges, the best its files allow" in " ".join(result.stderr.split())
    cues = yaml.safe_load((tmp_path / "found.yaml").read_text())["settings"]["options"]["cues"]
    assert list(cues) == ["segments", "edges"]
    data = load(bare)
    assert data.coarse_cue is not None
    assert data.coarse_cue.has_partitions
    assert not data.observations.has_partitions
    assert data.of_cue("segments") is data.coarse_cue
    assert data.of_frames([0]).coarse_cue is not None
    assert data.of_frames([0]).coarse_cue.num_frames == 1
    other = data.drive.camera.zoomed(1.1)
    assert data.with_camera(other).observations.camera == other
    assert data.with_camera(other).coarse_cue == replace(data.coarse_cue, camera=other)
    assert data.coarse_cue.scenes == data.observations.scenes


def test_edges_alone_want_a_start(bare: Path, tmp_path: Path) -> None:
    asked = ("--from-nothing", "-o", tmp_path / "found.yaml", "-q")
    labelled = invoke("calibrate", bare, "--cue", "edges", *asked)
    assert "or segments beside them; the motion" in str(labelled.exception)
    assert f"`semcal calibrate {bare} --cue segments,edges`, by its image labels" in str(labelled.exception)
    drive = without(bare, "image_labels")
    result = invoke("calibrate", drive, *asked)
    assert result.exit_code == 1
    assert isinstance(result.exception, InputError)
    assert "drive.yaml: a calibration by edges needs a start within 5 degrees" in str(result.exception)
    assert "or image labels; the motion" in str(result.exception)


def test_segments_speak_against_edges_that_walked_away(bare: Path, street_truth: Pose) -> None:
    coarse_cue = load(bare).coarse_cue
    assert coarse_cue is not None
    assert check_coarse_cue(coarse_cue, street_truth, street_truth).findings == ()
    walked = make_pose((0.0, 0.09, 0.0), (0.3, 0.0, 0.3)) @ street_truth
    (finding,) = check_coarse_cue(coarse_cue, walked, street_truth).findings
    assert finding.topic == "cues-disagree"
    assert "5.2 degrees and 42 cm from" in finding.sentence


def test_a_mounting_that_edges_decide_for_leads_the_hypotheses(bare: Path) -> None:
    data = load(bare)
    found = initialize(data, CalibrationConfig().initialization)
    second = found.hypotheses[1]
    led = with_best(found, second, data.searched_by)
    assert np.array_equal(led.T_camera_lidar, second.T_camera_lidar)
    assert led.hypotheses[0].T_camera_lidar.tolist() == second.T_camera_lidar.tolist()
    assert led.hypotheses[0].rotation_from_best_deg == pytest.approx(0.0, abs=1e-6)
    assert led.hypotheses[1].rotation_from_best_deg == pytest.approx(second.rotation_from_best_deg)
    assert led.agreement.mutual_information == pytest.approx(second.mutual_information_nats)
    assert led.runner_up_margin is None or led.runner_up_margin < 0.0


def test_a_maximum_beside_the_result_is_a_rival(
    street: Path, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    observations = load(street, CalibrationConfig(cues=("edges",))).observations
    beside = make_pose((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)) @ street_truth
    uncertainty = SimpleNamespace(half_widths=np.full(6, 0.05))

    nums_polished = list[int]()

    def sentences(end: Pose) -> str:
        def ends_elsewhere(_: object, starts: list[Pose], __: object) -> list[Pose]:
            nums_polished.append(len(starts))
            return [end for _ in starts]

        monkeypatch.setattr(other_pose, "ends_elsewhere", ends_elsewhere)
        monkeypatch.setattr(
            other_pose,
            "sigmas_behind",
            lambda _, __, rivals: [1.0 if rival is end else 9.0 for rival in rivals],
        )
        measured = other_pose.check_rivals(observations, street_truth, uncertainty)  # type: ignore[arg-type]
        return " ".join(str(finding) for each in measured for finding in each.findings)

    assert "10 cm away" in sentences(beside)
    # Where one ends elsewhere, more are tried.
    assert nums_polished == [other_pose.FIRST_BESIDE, other_pose.MORE_BESIDE]
    # What comes back to the result is none.
    assert "10 cm away" not in sentences(street_truth)
    assert nums_polished[2:] == [other_pose.FIRST_BESIDE]


def test_a_polish_ends_elsewhere_unless_it_leads_back(seen: Observations, street_truth: Pose) -> None:
    T_maximum = newton(seen, street_truth, PolishConfig()).T_camera_lidar

    def is_back(T_end: Pose) -> bool:
        return compare_poses(T_end, T_maximum).is_within(0.05, 0.015)

    beside = [displace(T_maximum, 0.1, 0.02, np.random.default_rng(0))]
    assert not ends_elsewhere(seen, beside, is_back)
    # Where nothing counts as back, the polish ends at the maximum all the same.
    (T_end,) = ends_elsewhere(seen, beside, lambda _: False)
    assert is_back(T_end)


def test_a_higher_maximum_beside_is_found(seen: Observations, street_truth: Pose) -> None:
    lower = make_pose((0.0, np.radians(0.4), 0.0), (0.0, 0.0, 0.0)) @ street_truth
    # The right pose is painted over the other one, and fits better.
    painted = with_painted_edges(seen, (lower, 6), (street_truth, 6))

    def ascend(observations: Observations, T_start: Pose, searches_beside: bool = True) -> Level:
        starts = replace(STARTS_ALONE, num_starts=(1,), searches_beside=searches_beside)
        several = SeveralStarts(observations, ExactConfig(steps=0), 0, starts)
        return several.ascend(1, T_start, visible_only=True)

    for start in (lower, street_truth):
        found = ascend(painted, start)
        assert found.has_other_maxima
        assert compare_poses(found.T_camera_lidar, street_truth).is_within(0.1, 0.01)
    unsearched = ascend(painted, lower, searches_beside=False)
    assert not unsearched.has_other_maxima
    assert compare_poses(unsearched.T_camera_lidar, lower).is_within(0.1, 0.01)
    # That of the street itself is alone.
    assert not ascend(seen, street_truth).has_other_maxima


def test_searches_reach_farther_in_few_scenes_and_end_when_two_in_a_row_find_nothing(
    seen: Observations, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    higher = make_pose((0.0, 0.01, 0.0), (0.0, 0.0, 0.0)) @ street_truth
    searched = list[tuple[int, float]]()

    def search(_: object, T: Pose, around: higher_maxima._Around, *__: object) -> Pose:
        searched.append((around.number, around.spread_deg[1]))
        return higher

    monkeypatch.setattr(higher_maxima, "_search", search)
    for num_frames, number, farthest_deg in ((seen.num_frames, 12, 0.5), (1, 24, 1.5)):
        searched.clear()
        climb(seen.of_frames(range(num_frames)), street_truth, np.random.default_rng(0))
        assert searched == [(number, farthest_deg), (number, farthest_deg), (2 * number, farthest_deg)]


@pytest.mark.parametrize("seed", [90, 91])
def test_one_real_frame_is_right_from_different_starts(seed: int, tmp_path: Path) -> None:
    run_import("opencalib", real("opencalib_road"), "--sequence", "3", "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    published, config = np.array(drive.T_camera_lidar), CalibrationConfig(cues=("edges",))
    start = InitialPose(displace(published, 2.0, 0.2, np.random.default_rng(seed)), "start")
    found = calibrate(load(drive, config), config, initial_pose=start)
    assert compare_poses(found.pose, published).is_within(0.2, 0.05)


def test_the_search_around_a_pose_beside_finds_the_right_one(
    seen: Observations, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside = displace(street_truth, 0.3, 0.08, np.random.default_rng(0))
    found = climb(seen, beside, np.random.default_rng(0))
    # The polish ends a little beside the highest information.
    assert seen.information(found) >= 0.98 * seen.information(street_truth) > seen.information(beside)
    error = compare_poses(found, street_truth)
    assert error.rotation_deg < 0.2
    assert error.camera_center_m < 0.02
    monkeypatch.setattr(threads, "_num_threads", 5)
    np.testing.assert_array_equal(climb(seen, beside, np.random.default_rng(0)), found)
    # No end is near enough.
    assert climb(seen, beside, np.random.default_rng(0), is_allowed=lambda _: False) is beside
