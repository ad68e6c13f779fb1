"""A rolling shutter: points stand where the LiDAR would have seen them when the line was exposed on which they lie."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semcal_cli import core
from semcal_cli.api.calls import calibrate
from semcal_cli.checks.inspection import inspect
from semcal_cli.checks.motion_unstated import check_shutter, check_unstated
from semcal_cli.config import AdjustmentConfig, CalibrationConfig, RefinementConfig
from semcal_cli.config.directions import ReadoutDirection
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.motion import delayed, exposed_as, points_at, unrolled
from semcal_cli.observations.observations import FrameObservation, LabelledCloud, LabelledImage, Observations
from semcal_cli.observations.reading import load_observations, read_clouds
from semcal_cli.pipeline import refine_and_polish, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.report.input import make_report_input
from semcal_cli.report.overlays import Overlays
from semcal_cli.report.points import points_in_image
from semcal_cli.report.view.session import Session
from semcal_cli.synthetic.synthesis import synthesize

READOUT_S, SPEED_M_S = 0.06, 12.0
WIDTH, HEIGHT, FOCAL_PX, DEPTH_M = 320, 240, 200.0, 8.0
ROLLING = SynthConfig(
    num_frames=4,
    seed=5,
    channels=32,
    columns=400,
    width=320,
    height=180,
    motion="mixed",
    readout_ms=1e3 * READOUT_S,
)
DIRECTIONS: tuple[ReadoutDirection, ...] = ("down", "left")
OFF = np.array([0.05, -0.04, 0.03, 0.006, -0.004, 0.005])  # metres and radians from which poses are refined
AS_GOOD = 0.01  # label agreement: drives with other shutters see other parts of the same streets
ROUNDING_M = 2e-5  # of single precision at 100 m, twice
MAX_DEG, MAX_CM = (
    0.1,
    1.2,
)  # a pixel is a third of a degree; with a global shutter 0.01 degrees and 0.6 cm remain
MAX_CLOCK_S = 0.002


def pole(direction: ReadoutDirection) -> Observations:
    """A pole before a camera that slides to its right in the LiDAR's place, seen by each row of its image."""
    camera = Camera(
        model="plumb_bob",
        width=WIDTH,
        height=HEIGHT,
        K=((FOCAL_PX, 0.0, 159.5), (0.0, FOCAL_PX, 119.5), (0.0, 0.0, 1.0)),
        readout_s=READOUT_S,
        direction=direction,
    )
    rows = np.arange(HEIGHT)
    points = np.stack(
        [np.full(HEIGHT, 0.5), (rows - 119.5) * DEPTH_M / FOCAL_PX, np.full(HEIGHT, DEPTH_M)], 1
    )
    cloud = LabelledCloud(points.astype(np.float32), np.zeros(HEIGHT, np.uint8))
    image = LabelledImage(np.zeros((HEIGHT, WIDTH), np.uint8))
    frame = FrameObservation(cloud, image, twist_per_s=(SPEED_M_S, 0.0, 0.0, 0.0, 0.0, 0.0))
    return Observations(camera, None, (frame,), ("pole",), ("pole",))


@pytest.mark.parametrize(("direction", "sign"), [("down", 1.0), ("up", -1.0)])
def test_a_pole_that_is_passed_leans_by_speed_times_time(direction: ReadoutDirection, sign: float) -> None:
    observations = pole(direction)
    seconds = sign * READOUT_S * ((np.arange(HEIGHT) + 0.5) / HEIGHT - 0.5)
    points = points_at(observations, 0, np.eye(4)).astype(float)
    u, v = core_camera(observations.camera).project(points).T
    np.testing.assert_allclose(v, np.arange(HEIGHT), atol=1e-4)
    np.testing.assert_allclose(u, 159.5 + FOCAL_PX * (0.5 - SPEED_M_S * seconds) / DEPTH_M, atol=1e-4)
    (cloud,) = unrolled(observations, np.eye(4)).clouds
    assert cloud.exposed_s is not None
    np.testing.assert_allclose(cloud.exposed_s, seconds, atol=1e-7)


def test_without_a_rolling_shutter_or_a_motion_nothing_is_moved() -> None:
    observations = pole("down")
    still = replace(
        observations, frame_observations=(replace(observations.frame_observations[0], twist_per_s=None),)
    )
    at_once = replace(observations, camera=observations.camera.model_copy(update={"readout_s": 0.0}))
    for each in (still, at_once):
        assert unrolled(each, np.eye(4)) is each


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> LoadedDrive:
    return made(replace(ROLLING, readout_ms=0.0), tmp_path_factory.mktemp("still"))


@pytest.fixture(scope="module")
def rolling(tmp_path_factory: pytest.TempPathFactory) -> LoadedDrive:
    return made(ROLLING, tmp_path_factory.mktemp("rolling"))


def made(config: SynthConfig, folder: Path) -> LoadedDrive:
    synthesize(config, folder, force=True)
    return load(folder)


def truth(data: LoadedDrive) -> Pose:
    return np.array(data.drive.T_camera_lidar)


def agreement(data: LoadedDrive) -> float:
    return core.agreement(data.observations.core, truth(data)).label_agreement


def found(data: LoadedDrive, config: RefinementConfig | None = None) -> Stages:
    """Refine and polish from a pose that is somewhat off."""
    start = start_at(data, InitialPose(apply_twist(truth(data), OFF), "somewhat off"))
    return refine_and_polish(data, start, config or RefinementConfig())


def error(data: LoadedDrive, stages: Stages) -> tuple[float, float]:
    off = compare_poses(stages.T_camera_lidar, truth(data))
    return off.rotation_deg, off.camera_center_cm


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_pose_is_as_good_as_without_a_rolling_shutter(
    still: LoadedDrive, direction: ReadoutDirection, tmp_path: Path
) -> None:
    data = made(replace(ROLLING, readout_direction=direction), tmp_path)
    by_line = agreement(data.unrolled(truth(data)))
    assert abs(by_line - agreement(still)) < AS_GOOD
    assert by_line > agreement(data) + 0.02
    stages = found(data)
    rotation_deg, center_cm = error(data, stages)
    assert rotation_deg < MAX_DEG
    assert center_cm < MAX_CM
    assert stages.seen_refined is not None
    assert core.agreement(stages.seen_refined.core, truth(data)).label_agreement > by_line - 1e-3
    at_middle_deg, at_middle_cm = error(data, found(at_middle_line(data)))
    assert at_middle_deg > 2.0 * rotation_deg
    assert at_middle_cm > 1.2 * center_cm


def at_middle_line(data: LoadedDrive) -> LoadedDrive:
    """The same drive, of which nothing is known but the moment of the middle line."""
    camera = data.drive.camera.model_copy(update={"readout_s": 0.0})
    return replace(data, observations=replace(data.observations, camera=camera))


def test_a_wide_lens_tells_its_lines(tmp_path: Path) -> None:
    changes: dict[str, object] = {"lens": "equirectangular", "width": 640, "height": 320, "readout_ms": 100.0}
    data = made(replace(ROLLING, readout_direction="right", **changes), tmp_path)  # type: ignore[arg-type]
    assert agreement(data.unrolled(truth(data))) > agreement(data) + AS_GOOD


def test_points_are_never_moved_twice(rolling: LoadedDrive) -> None:
    T, elsewhere = truth(rolling), apply_twist(truth(rolling), 5.0 * OFF)
    once = rolling.unrolled(T)
    for again in (once.unrolled(T), rolling.unrolled(elsewhere).unrolled(T)):
        for cloud, expected in zip(again.observations.clouds, once.observations.clouds, strict=True):
            seen = points_in_image(expected.points, T, rolling.drive.camera)
            moved_m = np.linalg.norm(cloud.points - expected.points, axis=1)[seen.indices]
            assert moved_m.max() < ROUNDING_M


def test_lines_can_be_taken_from_a_later_clock(rolling: LoadedDrive) -> None:
    T, later_s = truth(rolling), 0.04
    lines = unrolled(delayed(rolling.observations, later_s), T)
    moved = delayed(exposed_as(rolling.observations, lines), later_s)
    for cloud, expected in zip(moved.clouds, lines.clouds, strict=True):
        assert np.linalg.norm(cloud.points - expected.points, axis=1).max() < ROUNDING_M


def test_a_late_clock_is_found_with_the_lines_that_it_tells(tmp_path: Path) -> None:
    data = made(replace(ROLLING, delay_ms=40.0), tmp_path)
    joint = found(data, RefinementConfig(jointly=AdjustmentConfig((), with_delay=True))).joint
    assert joint is not None
    assert joint.clock is not None
    assert joint.is_kept
    assert abs(joint.clock.time_offset_s - 0.04) < MAX_CLOCK_S
    lines = unrolled(joint.observations, joint.T_camera_lidar)
    for cloud, expected in zip(joint.observations.clouds, lines.clouds, strict=True):
        assert cloud.exposed_s is not None
        assert expected.exposed_s is not None
        # A line takes a third of a millisecond; points that pass close by may be off by some.
        assert np.quantile(np.abs(cloud.exposed_s - expected.exposed_s), 0.9) < 1e-3 * READOUT_S


def test_what_is_shown_is_what_was_exposed(rolling: LoadedDrive) -> None:
    T = truth(rolling)
    at_truth = core.agreement(rolling.unrolled(T).observations.core, T)
    overlays = Overlays(rolling.drive, rolling.observations, {"truth": T}, "agreement")
    by_line = Overlays(rolling.drive, rolling.unrolled(T).observations, {"truth": T}, "agreement")
    middle = Overlays(rolling.drive, at_middle_line(rolling).observations, {"truth": T}, "agreement")
    assert overlays.strip(1, "truth") == by_line.strip(1, "truth") != middle.strip(1, "truth")
    session = Session(rolling, read_clouds(rolling.drive), CalibrationConfig(), T)
    shown = session.points({"base": T.tolist(), "offsets": [0.0] * 6, "frame": 1})
    assert shown["information"] == pytest.approx(at_truth.mutual_information - at_truth.bias, rel=1e-12)
    report = make_report_input(rolling.drive, "truth", T, None)
    of_report = core.agreement(report.observations.core, T)
    assert of_report.mutual_information == pytest.approx(at_truth.mutual_information, rel=1e-12)


def without_direction(data: LoadedDrive, motion: Motion | None) -> LoadedDrive:
    """The drive with another motion, whose points stay where they are."""
    drive = data.drive.model_copy(update={"motion": motion})
    return LoadedDrive(drive, load_observations(drive))


NOT_COMPENSATED = "the rolling shutter is not compensated, because the drive gives no direction of motion"
ADVICE = (
    "run `semcal odometry DRIVE`, give motion.poses or motion.twist, or write `motion: {speed_m_s: 0"
    "}` if the rig stood still"
)


def test_a_shutter_that_is_not_compensated_is_told(rolling: LoadedDrive) -> None:
    assert found(rolling).notes_on_data == ()
    unknown = without_direction(rolling, None)
    assert {each.topic for each in found(unknown).of_data} == {"shutter", "motion"}
    assert found(unknown).notes_on_data == ()
    assert inspect(unknown.drive).suspicions[-1] == (
        "the rolling shutter cannot be compensated without poses or a twist in motion"
    )
    slow = found(without_direction(rolling, Motion(speed_m_s=1.0)))
    (note,) = slow.notes_on_data
    assert re.fullmatch(
        rf"{NOT_COMPENSATED}, so half of the points are off by \d\.\d pixels or more: {re.escape(ADVICE)}",
        note,
    )
    (fast,) = check_shutter(*fields_of(without_direction(rolling, Motion(speed_m_s=60.0))))[0]
    assert fast.topic == "shutter"
    assert "(limit 3)" in fast.sentence
    findings, notes = check_shutter(rolling.drive, rolling.observations, is_compensated=False)
    assert findings == ()
    assert notes == (
        "this method does not compensate for the rolling shutter: all rows count as the middle one",
    )


def unstated_of(drive: Drive, observations: Observations) -> tuple[Finding, ...]:
    num_scenes = len(set(observations.scenes))
    return check_unstated(drive, num_scenes, observations.num_frames, have_times=observations.have_times)


def test_a_motion_that_is_not_given_is_doubted_unless_the_rig_stands(rolling: LoadedDrive) -> None:
    """Sweeps from the side at a steady 12 m/s were trusted 34 cm off, and a shutter of 30 ms at 10 m/s 18 cm."""
    unknown = without_direction(rolling, None)
    for measured in (check_shutter(*fields_of(unknown))[0], unstated_of(*fields_of(unknown))):
        (finding,) = measured
        assert (
            "the drive has no `motion:`, so skew cannot be corrected: run `semcal odometry"
            in finding.sentence
        )
    standing = unknown.of_frames([0, 0])
    assert check_shutter(*fields_of(standing)) == ((), (f"{NOT_COMPENSATED}: {ADVICE}",))
    assert unstated_of(*fields_of(standing)) == ()
    for stated in (rolling, without_direction(rolling, Motion(speed_m_s=0.0))):
        assert unstated_of(*fields_of(stated)) == check_shutter(*fields_of(stated))[0] == ()
    alone = unknown.of_frames([0])
    assert unstated_of(*fields_of(alone))
    without_times = replace(unknown.observations, have_times=False)
    assert unstated_of(unknown.drive, without_times) == ()


def fields_of(data: LoadedDrive) -> tuple[Drive, Observations]:
    return data.drive, data.observations


def test_a_shutter_that_does_not_roll_changes_no_bit(still: LoadedDrive) -> None:
    document = still.drive.path.read_text()
    assert "readout_s" not in document
    start = InitialPose(apply_twist(truth(still), OFF), "somewhat off")
    expected = calibrate(still, initial_pose=start)
    camera = still.drive.camera.model_copy(update={"readout_s": 0.0, "direction": "left"})
    other = calibrate(still.drive.model_copy(update={"camera": camera}), initial_pose=start)
    of_file = {"input"}
    assert other.model_dump(exclude=of_file) == expected.model_dump(exclude=of_file)
    assert found(still).seen_refined is None
