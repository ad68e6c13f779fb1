"""The origin of the LiDAR's frame is arbitrary: moving it changes no pose in the world, and nothing that is said of it.

What a sweep shows depends on where its rays start, which moves as well; so do points, start and truth.
"""

import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Cli, edited
from laboratory.raw_drive import RawDrive

from semcal_cli import core
from semcal_cli.api.calls import calibrate
from semcal_cli.checks.families import check_consistency
from semcal_cli.checks.focal_length import WRONG_FOCAL_LENGTH
from semcal_cli.checks.inspection import inspect
from semcal_cli.checks.moved_camera import check_frames
from semcal_cli.checks.other_azimuth import OTHER_AZIMUTH
from semcal_cli.checks.other_pose import OTHER_POSE, check_rivals
from semcal_cli.config import MAX_BASELINE_M, CalibrationConfig, CueName, RefinementConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.lidar import Lidar
from semcal_cli.estimation.adjust.frame_offsets import FAR_PYRAMID, fit_part
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.labelling.sides import segment_side
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.observations import Observations
from semcal_cli.pipeline import assess, refine_and_polish, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.report.input import make_report_input
from semcal_cli.result.uncertainty import Uncertainty

SHIFT_M = np.array([4.0, 0.0, 0.0])
GRID_M = 2.0**-16
"""Coordinates below 128 m that are multiples of this can be moved by `SHIFT_M` without rounding."""
SAME_DEG, SAME_CM = 0.02, 0.3
"""Largest differences of poses that are the same. A point is hidden if the LiDAR, from the origin, sees past a nearer
one, so that a few other points count; that moved poses by up to 0.009 degrees and 0.14 cm."""
SAME_SHARE, SAME_VALUE = 0.05, 0.1
"""The same for what checks measure: relative differences, and those of values near zero."""
FAR = RefinementConfig(max_baseline_m=8.0)
WIDE_BAND = replace(FAR, edge_band_px=8)


def translation(by_m: np.ndarray) -> Pose:
    T = np.eye(4)
    T[:3, 3] = by_m
    return T


def on_grid(observations: Observations) -> Observations:
    """The same with points that can be moved without rounding."""
    clouds = observations.clouds
    points = [(np.round(cloud.points / GRID_M) * GRID_M).astype(np.float32) for cloud in clouds]
    return observations.with_clouds(
        cloud.with_points(each) for cloud, each in zip(clouds, points, strict=True)
    )


def moved(observations: Observations) -> Observations:
    """The same in a frame whose origin is elsewhere."""
    clouds = observations.clouds
    shift = SHIFT_M.astype(np.float32)
    elsewhere = observations.with_clouds(cloud.with_points(cloud.points + shift) for cloud in clouds)
    for before, after in zip(clouds, elsewhere.clouds, strict=True):
        np.testing.assert_array_equal(after.points - shift, before.points)
    return replace(elsewhere, lidar=Lidar(origin_m=tuple(SHIFT_M.tolist())))


def assert_same(T_far: Pose, T_near: Pose) -> None:
    """Check that a pose in the moved frame is the same in the world."""
    away = compare_poses(T_far @ translation(SHIFT_M), T_near)
    assert away.rotation_deg < SAME_DEG
    assert away.camera_center_cm < SAME_CM


def loaded(drive: Path | Drive, cues: tuple[CueName, ...], refinement: RefinementConfig = FAR) -> LoadedDrive:
    data = load(drive, CalibrationConfig(cues=cues, refinement=refinement))
    return replace(data, observations=on_grid(data.observations))


def moved_data(data: LoadedDrive) -> LoadedDrive:
    return replace(data, observations=moved(data.observations))


def judged(data: LoadedDrive, T_start: Pose, config: RefinementConfig = FAR) -> Stages:
    stages = refine_and_polish(data, start_at(data, InitialPose(T_start, "a start")), config)
    return assess(data, stages, config)


def values(stages: Stages) -> dict[tuple[str, str], float]:
    """What the checks measured, but for the one that turns the camera about the origin.

    Ascents to other maxima end elsewhere after a rounding, so that theirs is told to a quarter.
    """
    assert stages.assessment is not None
    measured = stages.assessment.measured
    return {
        (each.topic, each.limit): each.value
        for each in measured
        if each.value is not None and each.topic != OTHER_AZIMUTH.topic
    }


@pytest.mark.parametrize(
    ("cues", "zoom"),
    [
        (("labels",), 1.0),
        (("labels",), 1.04),
        pytest.param(("segments",), 1.0, marks=pytest.mark.slow),
        pytest.param(("edges",), 1.0, marks=pytest.mark.slow),
    ],
)
def test_the_origin_of_the_frame_changes_nothing(
    cues: tuple[CueName, ...], zoom: float, fine_street: Path, T_off: Pose
) -> None:
    near = loaded(fine_street, cues)
    near = near.with_camera(near.drive.camera.zoomed(zoom))
    before, after = judged(near, T_off), judged(moved_data(near), T_off @ translation(-SHIFT_M))
    assert_same(after.T_camera_lidar, before.T_camera_lidar)
    assert [each.topic for each in after.findings] == [each.topic for each in before.findings]
    found, expected = values(after), values(before)
    of_other = (OTHER_POSE.topic, "")
    assert found.pop(of_other, 0.0) == pytest.approx(expected.pop(of_other, 0.0), rel=0.25, abs=SAME_VALUE)
    assert found == pytest.approx(expected, rel=SAME_SHARE, abs=SAME_VALUE)
    assert (WRONG_FOCAL_LENGTH.topic in {each.topic for each in before.findings}) == (zoom > 1.0)


def test_parts_of_a_drive_are_fitted_wherever_the_origin_is(knocked: RawDrive, knocked_drive: Path) -> None:
    near, T = loaded(knocked_drive, ("labels",)).observations, knocked.truths[0]
    names = [f"{frame.name}.bin" for frame in knocked.frames]
    far, T_far = moved(near), T @ translation(-SHIFT_M)
    before, after = check_frames(near, T, names).parts, check_frames(far, T_far, names).parts
    assert len(before) == 2
    assert [part.num_frames for part in after] == [part.num_frames for part in before]
    for part, other in zip(before, after, strict=True):
        assert_same(np.array(other.T_camera_lidar), np.array(part.T_camera_lidar))


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> set[tuple[float, int]]:
    """Maximum baseline and edge band of all observations that the core was given since."""
    made, seen = core.Observations, set[tuple[float, int]]()

    def spy(*arguments: Any) -> core.Observations:
        *_, max_baseline_m, edge_band_px, _, _ = arguments
        seen.add((max_baseline_m, edge_band_px))
        return made(*arguments)

    monkeypatch.setattr(core, "Observations", spy)
    return seen


def checked(observations: Observations, T: Pose, uncertainty: Uncertainty | None) -> dict[str, float | None]:
    """What checks with an edge band measure, and the turn of the pose that two frames fit."""
    names = [f"{index}.bin" for index in range(observations.num_frames)]
    measured = (
        *check_rivals(observations, T, uncertainty),
        *check_consistency(observations, T, estimated_s=0.0),
        *check_frames(observations, T, names).measured,
    )
    part = fit_part(observations, range(2), T, FAR_PYRAMID)
    assert part is not None
    return {each.topic: each.value for each in measured} | {
        "part": compare_poses(part.T_camera_lidar, T).rotation_deg
    }


@pytest.mark.parametrize(
    ("cue", "with_band"),
    [
        ("labels", {"other-pose", "focal-length", "part"}),
        pytest.param(
            "segments",
            {"other-pose", "focal-length", "part", "wrong-pairing", "other-azimuth"},
            marks=pytest.mark.slow,
        ),
        pytest.param("edges", set[str](), marks=pytest.mark.slow),
    ],
)
def test_every_check_uses_the_edge_band_that_was_asked_for(
    cue: CueName, with_band: set[str], fine_street: Path, T_off: Pose, solved: set[tuple[float, int]]
) -> None:
    """What a calibration measures is what each check measures of observations with this band.

    Three frames have rivals by labels, too. Edges have probabilities of pixels, and no band.
    """
    few = with_frames(read_drive(fine_street), range(3))
    usual = loaded(few, (cue,)).observations
    stages = judged(loaded(few, (cue,), WIDE_BAND), T_off, WIDE_BAND)
    assert solved == {(8.0, 8), (8.0, 0)}
    assert stages.assessment is not None
    measured = {each.topic: each.value for each in stages.assessment.measured}
    T, uncertainty = stages.T_camera_lidar, stages.uncertainty
    wide, narrow = (checked(replace(usual, edge_band_px=px), T, uncertainty) for px in (8, 1))
    assert {topic: measured[topic] for topic in wide if topic != "part"} == {
        topic: value for topic, value in wide.items() if topic != "part"
    }
    assert wide.keys() == narrow.keys()
    assert {topic for topic in wide if wide[topic] != narrow[topic]} == with_band


def test_all_solvers_of_a_calibration_get_its_settings(
    street: Path, T_off: Pose, solved: set[tuple[float, int]]
) -> None:
    """All of them, and what the result records; coarse blocks alone have no edge band."""
    config = CalibrationConfig(refinement=RefinementConfig(max_baseline_m=8.0, edge_band_px=2))
    result = calibrate(street, config, initial_pose=InitialPose(T_off, "a start"))
    assert solved == {(8.0, 2), (8.0, 0)}
    options: Any = result.settings.options
    assert options["initialization"]["alignment"]["max_baseline_m"] == 8.0
    for settings in (options["refinement"]["exact"], options["polish"]):
        assert (settings["max_baseline_m"], settings["edge_band_px"]) == (8.0, 2)
    shown = make_report_input(read_drive(street), "c.yaml", result.T_camera_lidar, result).observations
    assert (shown.max_baseline_m, shown.edge_band_px) == (8.0, 2)
    wrong = result.settings.model_copy(update={"options": {"polish": {"max_baseline_m": "far"}}})
    record = result.model_copy(update={"settings": wrong})
    shown = make_report_input(read_drive(street), "c.yaml", result.T_camera_lidar, record).observations
    assert shown.max_baseline_m == MAX_BASELINE_M


ROOF_M = np.array([1.2, -0.3, 1.7], np.float32)


def with_sweeps_moved(street: Path, folder: Path, by_m: np.ndarray) -> Path:
    """A copy of a drive whose points are moved."""
    shutil.copytree(street, folder)
    for path in (folder / "points").iterdir():
        columns = np.fromfile(path, np.float32).reshape(-1, 4)
        is_return = columns[:, :3].any(axis=1)
        columns[is_return, :3] += by_m
        columns.tofile(path)
    return folder


@pytest.fixture
def vehicle(fine_street: Path, tmp_path: Path) -> Path:
    """The street in the frame of a vehicle, whose LiDAR is on the roof."""
    return with_sweeps_moved(fine_street, tmp_path / "drive", ROOF_M)


def stating(drive: Path, origin_m: Sequence[float]) -> Path:
    with edited(drive) as document:
        document["lidar"] = {"origin_m": [*origin_m]}
    return drive


def test_the_origin_is_found_from_the_points_and_stated(vehicle: Path, cli: Cli) -> None:
    (said,) = (text for text in inspect(read_drive(vehicle)).suspicions if "origin_m" in text)
    (line,) = re.findall(r"`origin_m: \[(.*?)\]` under `lidar:`", said)
    origin_m = [float(number) for number in line.split(", ")]
    np.testing.assert_allclose(origin_m, ROOF_M, atol=0.3)
    assert cli("inspect", vehicle, "--find-origin")[:2] == (0, f"origin_m: [{line}]\n")
    assert not inspect(read_drive(stating(vehicle, origin_m))).suspicions


def test_a_doubtful_pose_by_edges_is_explained_by_the_origin(
    fine_street: Path, vehicle: Path, street_truth: Pose
) -> None:
    def topics(drive: Path, by_m: np.ndarray) -> list[str]:
        data = load(with_frames(read_drive(drive), range(3)), CalibrationConfig(cues=("edges",)))
        return [finding.topic for finding in judged(data, street_truth @ translation(-by_m)).findings]

    assert "wrong-origin" in topics(vehicle, ROOF_M)
    usual = topics(fine_street, np.zeros(3))
    assert "few-scenes" in usual
    assert "wrong-origin" not in usual


def test_an_origin_at_the_limit_of_the_search_is_not_proposed(fine_street: Path, tmp_path: Path) -> None:
    far = with_sweeps_moved(fine_street, tmp_path / "drive", np.array([5.0, 0.0, 1.7], np.float32))
    (said,) = (text for text in inspect(read_drive(far)).suspicions if "neighbouring rays" in text)
    assert "the rays seem to start farther away, or the columns of the files are mixed up" in said
    assert "origin_m" not in said


@pytest.mark.parametrize("stated_m", [(0.0, 60.0, 0.0), (4.0, 4.0, 4.0)])
def test_a_stated_origin_far_beside_the_true_one_is_named_once(
    stated_m: tuple[float, ...], fine_street: Path, tmp_path: Path
) -> None:
    """Seen from the second one, the height of the sensor is unusual, too."""
    drive = stating(shutil.copytree(fine_street, tmp_path / "drive"), stated_m)
    (said,) = (text for text in inspect(read_drive(drive)).suspicions if "origin" in text)
    proposed = re.findall(r"`origin_m: \[(.*?)\]` under `lidar:` states", said)
    np.testing.assert_allclose([float(number) for number in proposed[0].split(", ")], np.zeros(3), atol=0.3)


def test_a_viewpoint_of_pcd_files_is_named(fine_street: Path, tmp_path: Path) -> None:
    drive = shutil.copytree(fine_street, tmp_path / "drive")
    columns = np.fromfile(next((drive / "points").iterdir()), np.float32).reshape(-1, 4)
    header = (
        "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(columns)}\nHEIGHT 1\nVIEWPOINT {{}} 1 0 0 0\nPOINTS {len(columns)}\nDATA binary\n"
    )

    def advice(place: str) -> str:
        (drive / "sweep.pcd").write_bytes(header.format(place).encode() + columns.tobytes())
        with edited(drive) as document:
            document["frames"] = [
                frame | {"points": "sweep.pcd", "point_labels": None} for frame in document["frames"][:1]
            ]
        return " ".join(inspect(read_drive(drive)).advice)

    assert "sweep.pcd: VIEWPOINT states [1.40, 0.10, 1.70], which is not used" in advice("1.4 0.1 1.7")
    # What is no place is ignored, as by the reader of the points.
    for place in ("0 0 0", "1.4 - e"):
        assert "VIEWPOINT" not in advice(place)


def test_an_inspection_survives_a_missing_first_pcd(fine_street: Path, tmp_path: Path) -> None:
    drive = shutil.copytree(fine_street, tmp_path / "drive")
    with edited(drive) as document:
        document["frames"][0]["points"] = "missing.pcd"
    report = inspect(read_drive(drive))
    assert "missing.pcd" in " ".join(report.frames[0].suspicions)


def test_segments_are_labelled_as_seen_from_where_rays_start(fine_street: Path, vehicle: Path) -> None:
    near, far = (read_drive(drive) for drive in (fine_street, stating(vehicle, ROOF_M.tolist())))
    before, after = (
        np.frombuffer(segment_side().label(drive, drive.frames[0]), "<u4") for drive in (near, far)
    )
    # Segments are numbered above their kinds.
    assert np.mean(before & 0xFFFF != after & 0xFFFF) < 0.01


def test_edges_are_those_seen_from_where_rays_start(fine_street: Path, vehicle: Path) -> None:
    near = load(fine_street, CalibrationConfig(cues=("edges",))).observations
    stated = stating(vehicle, ROOF_M.tolist())
    far = load(stated, CalibrationConfig(cues=("edges",))).observations
    for before, after in zip(near.clouds, far.clouds, strict=True):
        # Coordinates are rounded once more, so that a few steps are on the other side of a limit.
        assert np.mean(before.classes != after.classes) < 1e-3
        same = before.classes == after.classes
        np.testing.assert_allclose(after.points[same] - ROOF_M, before.points[same], atol=1e-3)
