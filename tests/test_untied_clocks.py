"""Images of another moment: a rig that moves is trusted only if something ties its images to its sweeps."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import edited, make_pose, with_twists
from moving_street import MovingStreet

from semcal_cli import core
from semcal_cli.checks.families import check_recording
from semcal_cli.config import CalibrationConfig, PolishConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.stated_motion import Motion, Twist
from semcal_cli.estimation.adjust.clock import ClockUncertainty
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import camera_center
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline import calibrate

CONFIG = CalibrationConfig(cues=("labels",))
FAST = Motion(twist=Twist(linear_m_s=(10.0, 0.0, 0.0), angular_rad_s=(0.0, 0.0, 0.0)))
ADVICE = (
    ": add to drive.yaml `synchronization: hardware` if one triggers the other, `motion: {speed_m_s: 0}` if the rig "
    "stood, or motion.poses at different speeds (`semcal odometry`)"
)
UNTIED = "nothing ties the images to the moments of the sweeps, and "
UNSEEN = f"{UNTIED}whether the rig moved cannot be seen: 10 ms at 10 m/s are 10 cm{ADVICE}"
SPEED_M_S = 8.0


@pytest.fixture(scope="module")
def loaded(street: Path) -> LoadedDrive:
    return load(street, CONFIG)


def restated(data: LoadedDrive, **keys: Any) -> LoadedDrive:
    """The drive with other keys, and with the motion in its frames."""
    document = data.drive.model_dump(exclude_unset=True)
    drive = Drive.model_validate({**document, "synchronization": "unknown", **keys})
    drive._path, observations = data.drive.path, data.observations
    if drive.motion is not None and drive.motion.twist is not None:
        twist = [*drive.motion.twist.linear_m_s, *drive.motion.twist.angular_rad_s]
        observations = with_twists(observations, [twist] * observations.num_frames)
    return replace(data, drive=drive, observations=observations, recorded=None)


def sentences(data: LoadedDrive) -> list[str]:
    clock = ClockUncertainty.of(data, make_pose((0, 0, 0), (0, 0, 0)), PolishConfig())
    measured = check_recording(data, clock, with_clock=True)
    return [finding.sentence for value in measured for finding in value.findings]


@pytest.mark.parametrize(
    "keys",
    [
        {"synchronization": "hardware"},
        {"synchronization": "hardware", "motion": FAST},
        {"synchronization": "stamps", "motion": FAST},
        {"motion": FAST, "time_offset_sigma_s": 0.02},
        {"time_offset_sigma_s": 0.0},
        {"motion": Motion(speed_m_s=0.0)},
    ],
)
def test_tied_clocks_and_rigs_that_stand_are_not_doubted(loaded: LoadedDrive, keys: dict[str, Any]) -> None:
    assert sentences(restated(loaded, **keys)) == []


@pytest.mark.parametrize("keys", [{}, {"synchronization": "stamps"}, {"time_offset_sigma_s": 0.02}])
def test_a_motion_that_cannot_be_seen_is_doubted(loaded: LoadedDrive, keys: dict[str, Any]) -> None:
    """Frames of the synthetic street are of different streets."""
    assert sentences(restated(loaded, **keys)) == [UNSEEN]


def test_a_stated_motion_at_one_velocity_needs_a_known_clock(loaded: LoadedDrive) -> None:
    moving = restated(loaded, motion=FAST)
    assert sentences(moving) == [f"{UNTIED}the rig moves: 10 ms at 10 m/s are 10 cm{ADVICE}"]
    clock = ClockUncertainty.of(moving, make_pose((0, 0, 0), (0, 0, 0)), PolishConfig())
    assert clock is not None
    # Frames at different velocities tell the clock themselves.
    (of_clock,) = check_recording(moving, clock._replace(is_checked=True), with_clock=True)
    assert of_clock.finding is None
    assert check_recording(moving, clock, with_clock=False) == ()


def test_frames_of_one_scene_show_a_rig_that_stands_and_copies_do_not(loaded: LoadedDrive) -> None:
    (first, second, *_), rng = loaded.observations.frame_observations, np.random.default_rng(0)
    noisy = first.cloud.points + rng.normal(0.0, 0.01, first.cloud.points.shape).astype(np.float32)
    again = replace(first, cloud=first.cloud.with_points(noisy))

    def of(*frames: Any) -> LoadedDrive:
        unknown = restated(loaded)
        drive = unknown.drive.model_copy(update={"frames": unknown.drive.frames[: len(frames)]})
        observations = replace(unknown.observations, frame_observations=frames, known_scenes=None)
        return replace(unknown, drive=drive, observations=observations)

    assert sentences(of(first, again)) == []
    for frames in ((first, first), (first, again, second), (first,)):
        assert sentences(of(*frames)) == [UNSEEN]


def test_a_trigger_does_not_tie_sweeps_to_images_of_other_names(loaded: LoadedDrive) -> None:
    """As where the images of a data set are shifted by one frame."""
    names = [Path(frame.points).stem for frame in loaded.drive.frames]
    frames = [
        frame.model_copy(update={"image": f"images/{name}.png", "image_labels": None})
        for frame, name in zip(loaded.drive.frames, [*names[1:], "late"], strict=True)
    ]
    (sentence,) = sentences(restated(loaded, synchronization="hardware", frames=frames))
    assert sentence == (
        "sweep 000001.bin is paired with image 000002.png, and image 000001.png with another sweep: check that each "
        "sweep has the image of its name"
    )
    stamped = [frame.model_copy(update={"points_stamp": 1.0, "image_stamp": 1.0}) for frame in frames]
    assert sentences(restated(loaded, synchronization="hardware", frames=stamped)) == []


def test_what_sweeps_without_times_are_smeared_widens_the_interval(loaded: LoadedDrive) -> None:
    """A camera may see any part of a sweep of 0.1 s: 29 ms, beside the 20 ms of the clock."""

    def sigma_s(**keys: Any) -> float:
        data = restated(loaded, **keys)
        frames = [replace(frame, is_rigid=True) for frame in data.observations.frame_observations]
        data = replace(data, observations=replace(data.observations, frame_observations=tuple(frames)))
        clock = ClockUncertainty.of(data, make_pose((0, 0, 0), (0, 0, 0)), PolishConfig())
        assert clock is not None
        return clock.sigma_s

    smeared = pytest.approx(np.hypot(0.02, 0.1 / np.sqrt(12.0)))
    assert sigma_s(motion=FAST) == smeared
    assert sigma_s(motion=Motion(speed_m_s=10.0)) == smeared
    assert sigma_s(motion=FAST.model_copy(update={"point_times": "deskewed"})) == 0.02
    assert sigma_s(motion=FAST, synchronization="hardware") == 0.02
    # What the times of a spin tell at a speed is measured, and not counted again.
    measured = replace(loaded, observations=replace(loaded.observations, motion_error_px=2.0))
    clock = ClockUncertainty.of(
        restated(measured, motion=Motion(speed_m_s=10.0)), make_pose((0, 0, 0), (0, 0, 0)), PolishConfig()
    )
    assert clock is not None
    assert clock.sigma_s == 0.02


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Consecutive sweeps without times along a street at a steady speed, with the images of 0.1 s later."""
    folder = tmp_path_factory.mktemp("late") / "drive"
    MovingStreet(SPEED_M_S, 0.0, seed=2, points=40_000).write(folder, count=30, every=3, late_s=0.1)
    with edited(folder) as document:
        del document["synchronization"]
        for frame in document["frames"]:
            (cloud,) = read_point_clouds([(folder / frame["points"], None)], 10**6)
            frame["points"] = frame["points"].replace(".pcd", ".bin")
            np.pad(cloud.points[:, :3], ((0, 0), (0, 1))).astype("<f4").tofile(folder / frame["points"])
            del frame["points_stamp"], frame["image_stamp"]
    return folder


def test_the_way_between_sweeps_is_measured(late: Path) -> None:
    drive = read_drive(late)
    files = [(drive.resolve(frame.points), None) for frame in drive.frames[:3]]
    first, second, third = (cloud.points[:, :3] for cloud in read_point_clouds(files, 10**6))
    # A sweep every 0.3 s; the grid has steps of 5 cm.
    assert core.sweep_shifts([(first, second), (second, third)]) == pytest.approx([2.4, 2.4], abs=0.05)
    assert core.sweep_shifts([(first, first)]) == [0.0]


def test_images_one_frame_late_are_not_trusted(late: Path) -> None:
    """They were, with an interval of a few centimetres."""
    T = read_transform(late)
    start = InitialPose(displace(T, 1.0, 0.1, np.random.default_rng(0)), "start")
    found = calibrate(read_drive(late), CONFIG, initial_pose=start)
    assert np.linalg.norm(camera_center(found.pose) - camera_center(T)) > 0.5
    (reason,) = found.reasons
    assert reason.startswith(f"{UNTIED}the rig moves 2.4")
    assert "10 ms at 24 m/s are 24 cm, if these are 0.1 s apart: add to drive.yaml" in reason
    assert not any("the clock was not checked" in note for note in found.notes)
