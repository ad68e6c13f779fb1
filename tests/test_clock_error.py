"""A clock that nothing checks, where all frames have the same motion: the cost of 20 ms is part of the interval."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import edited, make_pose, run
from numpy.typing import NDArray
from scipy.linalg import expm

from semcal_cli.checks.prior import check_priors
from semcal_cli.config import CalibrationConfig, PolishConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.stated_motion import Motion, MotionSigma, Twist
from semcal_cli.estimation.adjust.clock import KNOW_MOTION, ClockUncertainty, notes_on_clock
from semcal_cli.estimation.adjust.priors import Prior, fuse_with_priors
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.uncertainty.motion_error import KNOW_POSES, covariance_of_motion
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, cross_matrix
from semcal_cli.geometry.twists import local_coordinates
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.motion import delayed
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.pipeline import calibrate
from semcal_cli.report.words import NOT_BELIEVED
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration
from semcal_cli.result.uncertainty import stated_error
from semcal_cli.synthetic.synthesis import synthesize

T = make_pose((0.4, -1.2, 0.8), (0.3, -0.2, 0.1))
CONFIG = CalibrationConfig(cues=("labels",))
STANDING = "the clock was not checked: the drive gives no motion"
MOVING = (
    "the clock was not checked: the drive gives no direction of motion. If images are 20 ms off, the camera is "
    "16 cm off at 8 m/s, which the interval includes"
)


def with_motion(drive: Drive, motion: Motion | None) -> Drive:
    return drive.model_copy(update={"motion": motion})


def at_speed(drive: Drive, speed_m_s: float) -> Drive:
    return with_motion(drive, Motion(speed_m_s=speed_m_s))


def moving(data: LoadedDrive, *twists: Sequence[float], motion: Motion | None = None) -> LoadedDrive:
    """The drive, by poses that tell of these motions (6,) a second by turns."""
    frames = data.observations.frame_observations
    moved = tuple(replace(each, twist_per_s=twists[index % len(twists)]) for index, each in enumerate(frames))
    drive = with_motion(data.drive, motion or Motion(poses="poses.txt"))
    return replace(data, drive=drive, observations=replace(data.observations, frame_observations=moved))


def clock_of(data: LoadedDrive | Drive, T_camera_lidar: Pose = T) -> ClockUncertainty:
    data = data if isinstance(data, LoadedDrive) else load(data, CONFIG)
    found = ClockUncertainty.of(data, T_camera_lidar, PolishConfig())
    assert found is not None
    return found


def covariance_of_clock(
    data: LoadedDrive | Drive, T_camera_lidar: Pose, label_gain: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    covariance = clock_of(data, T_camera_lidar).covariance(label_gain)
    assert covariance is not None
    return covariance


def found_by(data: LoadedDrive | Drive, start: Pose) -> CalibrationDocument:
    return calibrate(data, CONFIG, initial_pose=InitialPose(start, "start"))


@pytest.fixture(scope="module")
def loaded(street: Path) -> LoadedDrive:
    return load(street, CONFIG)


def test_the_place_may_be_off_along_any_level_direction(loaded: LoadedDrive) -> None:
    """At 8 m/s it is 16 cm, along any direction across the LiDAR's axis and none along it; no rotation."""

    def at(speed_m_s: float) -> LoadedDrive:
        return replace(loaded, drive=at_speed(loaded.drive, speed_m_s))

    covariance = covariance_of_clock(at(8.0), T)
    assert not covariance[3:].any()
    assert not covariance[:, 3:].any()
    in_lidar = T[:3, :3].T @ covariance[:3, :3] @ T[:3, :3]
    np.testing.assert_allclose(in_lidar, np.diag([0.0256, 0.0256, 0.0]), atol=1e-12)
    # A LiDAR that is turned about its axis, which no motion is stated along, makes no difference.
    turned = covariance_of_clock(at(8.0), T @ make_pose((0.0, 0.0, 1.1), (0.0, 0.0, 0.0)))
    np.testing.assert_allclose(turned, covariance, atol=1e-12)
    twice = covariance_of_clock(at(16.0), T, 0.5 * np.eye(6))
    np.testing.assert_allclose(twice, covariance)


@pytest.mark.parametrize("by_poses", [True, False])
def test_one_twist_moves_the_place_along_it(loaded: LoadedDrive, by_poses: bool) -> None:
    """An image that is late by its standard deviation is taken from where the LiDAR will be."""
    twist = Twist(linear_m_s=(9.0, -1.0, 0.5), angular_rad_s=(0.0, 0.1, 0.4))
    one = (*twist.linear_m_s, *twist.angular_rad_s)
    data = moving(loaded, one, motion=None if by_poses else Motion(twist=twist))
    data = replace(data, drive=data.drive.model_copy(update={"time_offset_sigma_s": 0.01}))
    covariance = covariance_of_clock(data, T)
    step = np.zeros((4, 4))
    step[:3, :3] = 0.01 * cross_matrix(np.array(twist.angular_rad_s))
    step[:3, 3] = 0.01 * np.array(twist.linear_m_s)
    (offset,) = local_coordinates([T @ expm(step)], T)
    np.testing.assert_allclose(covariance, np.outer(offset, offset), rtol=2e-2, atol=1e-8)
    (note,) = notes_on_clock(data, clock_of(data))
    assert (
        "all frames have the same motion. If images are 10 ms off, the camera is 9.1 cm off at 9.07 m/s"
        in note
    )
    exact = replace(data, drive=data.drive.model_copy(update={"time_offset_sigma_s": 0.0}))
    assert clock_of(exact).covariance() is None
    assert notes_on_clock(exact, clock_of(exact)) == ()


SLOW, FAST = (2.0, 0.0, 0.0, 0.0, 0.0, 0.0), (16.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("late_ms", [0.0, 4.0])
def test_frames_that_move_differently_tell_the_clock(
    loaded: LoadedDrive, street_truth: Pose, late_ms: float
) -> None:
    """The pose stays at the drive's clock, so the interval holds the second moment about that."""
    data = moving(loaded, SLOW, FAST)
    late = replace(data, observations=delayed(data.observations, -1e-3 * late_ms))
    found = clock_of(late, street_truth)
    assert found.is_checked
    assert 1e3 * found.offset_s == pytest.approx(late_ms, abs=1.0)
    assert 0.0 < found.sigma_s < 1e-3
    covariance = found.covariance()
    assert covariance is not None
    off_m = 9.0 * np.hypot(found.offset_s, found.sigma_s)
    assert np.sqrt(np.trace(covariance[:3, :3])) == pytest.approx(off_m)
    notes = notes_on_clock(late, found)
    assert len(notes) == (late_ms > 0.0)
    assert all("ms late; the interval allows for it" in note for note in notes)
    exact = replace(late, drive=late.drive.model_copy(update={"time_offset_sigma_s": 0.0}))
    assert notes_on_clock(exact, clock_of(exact, street_truth)) == ()


def test_what_tells_no_clock(loaded: LoadedDrive, street_truth: Pose) -> None:
    """Neither frames that hardly differ, nor images without labels: what is stated counts."""
    blind = loaded.observations.with_images(
        image.with_classes(np.full_like(image.classes, NO_CLASS)) for image in loaded.observations.images
    )
    alike, open_ = "all frames have the same motion", "the frames do not determine it"
    for data, why in (
        (moving(loaded, (9.0, *SLOW[1:])), alike),
        (moving(loaded, (8.99, *SLOW[1:]), (9.01, *SLOW[1:])), open_),
        (moving(replace(loaded, observations=blind), SLOW, FAST), open_),
    ):
        found = clock_of(data, street_truth)
        assert (found.is_checked, found.offset_s, found.sigma_s) == (False, 0.0, 0.02)
        assert found.speed_m_s == pytest.approx(9.0)
        assert f"the clock was not checked: {why}." in notes_on_clock(data, found)[0]


@pytest.mark.parametrize("motion", [None, Motion(speed_m_s=0.0), Motion(poses="poses.txt")])
def test_nothing_is_added_without_a_speed(loaded: LoadedDrive, motion: Motion | None) -> None:
    data = replace(loaded, drive=with_motion(loaded.drive, motion))
    for each in (data, moving(loaded, (0.0,) * 6)):
        assert ClockUncertainty.of(each, T, PolishConfig()) is None


def test_a_stated_speed_widens_the_interval(street: Path, street_truth: Pose) -> None:
    """By the same for all frames and for few: they share the clock."""
    drive = read_drive(street)
    for each in (drive, drive.model_copy(update={"frames": drive.frames[:2]})):
        fast = at_speed(each, 8.0)
        standing, moving = found_by(each, street_truth), found_by(fast, street_truth)
        assert standing.uncertainty is not None
        assert moving.uncertainty is not None
        np.testing.assert_array_equal(moving.T_camera_lidar, standing.T_camera_lidar)
        of_clock = np.array(moving.uncertainty.covariance) - np.array(standing.uncertainty.covariance)
        np.testing.assert_allclose(of_clock, covariance_of_clock(load(fast, CONFIG), moving.pose), atol=1e-12)
        assert moving.uncertainty.covariance_of_intrinsics == standing.uncertainty.covariance_of_intrinsics
        assert MOVING in moving.notes
        assert STANDING in standing.notes


def test_what_the_motion_may_be_off_widens_the_interval(loaded: LoadedDrive) -> None:
    """By what it moves across the time between points and image, and turns the camera about the LiDAR."""
    lags_s = (0.03, 0.01)
    frames = loaded.observations.frame_observations
    late = tuple(replace(each, lag_s=lags_s[index % 2]) for index, each in enumerate(frames))
    data = replace(loaded, observations=replace(loaded.observations, frame_observations=late))

    def by_motion(T_camera_lidar: Pose, later_s: float = 0.0, **sigma: float) -> NDArray[np.float64]:
        motion = Motion(poses="poses.txt", sigma=MotionSigma(**sigma))
        found = covariance_of_motion(
            replace(data, drive=with_motion(data.drive, motion)), T_camera_lidar, later_s=later_s
        )
        assert found is not None
        return found

    squared = 0.5 * (0.03**2 + 0.01**2)
    shifted = np.diag([0.04 * squared] * 3 + [0.0] * 3)
    np.testing.assert_allclose(by_motion(T, linear_m_s=0.2), shifted, atol=1e-15)
    later = by_motion(T, linear_m_s=0.2, later_s=0.03)
    np.testing.assert_allclose(later, shifted * (1.0 + 9e-4 / squared), atol=1e-15)
    # The camera's centre stays where it is on the axis through the LiDAR, and goes round it elsewhere.
    turned = by_motion(T, angular_rad_s=0.5)
    np.testing.assert_allclose(turned[3:, 3:], 0.25 * squared * np.eye(3), atol=1e-15)
    lever_m = cross_matrix(T[:3, 3])
    np.testing.assert_allclose(turned[:3, :3], 0.25 * squared * lever_m @ lever_m.T, atol=1e-15)
    assert covariance_of_motion(data, T) is None


def test_the_motion_is_part_of_the_interval(tmp_path: Path) -> None:
    """Velocities that may be off by 8 m/s make it wider, and the advice is to know them better."""
    synthesize(SynthConfig(num_frames=2, seed=11, width=320, height=180, motion="mixed"), tmp_path / "drive")
    drive, truth = read_drive(tmp_path / "drive"), read_transform(tmp_path / "drive")
    assert drive.motion is not None
    rough = with_motion(drive, drive.motion.model_copy(update={"sigma": MotionSigma(linear_m_s=8.0)}))
    found = [found_by(each, truth) for each in (drive, rough)]
    sure, unsure = (np.array(each.uncertainty.covariance) for each in found if each.uncertainty is not None)
    # A sweep of 0.1 s is moved to its middle.
    lag_s = 0.1 / np.sqrt(12.0)
    wider = np.diag([(8.0 * lag_s) ** 2] * 3 + [0.0] * 3)
    np.testing.assert_allclose(unsure - sure, wider, rtol=0.02, atol=1e-9)
    assert found[1].reasons[0].endswith(KNOW_POSES)


def test_a_delay_at_one_speed_is_within_the_interval(tmp_path: Path) -> None:
    """Straight on at 12 m/s, images that are 20 ms late put the camera 24 cm farther on, and every frame agrees."""
    config = SynthConfig(num_frames=4, seed=11, width=640, height=360, motion="steady", delay_ms=20.0)
    synthesize(config, tmp_path / "drive")
    truth = read_transform(tmp_path / "drive")
    data = load(tmp_path / "drive", CONFIG)
    still = tuple(replace(each, twist_per_s=None) for each in data.observations.frame_observations)
    data = replace(data, observations=replace(data.observations, frame_observations=still))
    for speed_m_s, is_held in ((None, False), (12.0, True)):
        motion = None if speed_m_s is None else Motion(speed_m_s=speed_m_s)
        found = found_by(replace(data, drive=with_motion(data.drive, motion)), truth)
        assert found.uncertainty is not None
        off = found.pose[:3, :3] @ (camera_center(found.pose) - camera_center(truth))
        assert np.linalg.norm(off) == pytest.approx(0.24, abs=0.02)
        assert (np.abs(off) <= found.uncertainty.half_width_95_camera_center_m).all() == is_held


def test_a_clock_that_makes_the_interval_too_wide(
    drive: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """More frames would not help, and are not advised. The interval is in the file, and nobody is shown it."""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    with edited(drive) as document:
        document["motion"] = {"speed_m_s": 15}
    page = tmp_path / "r.html"
    code, _, err = run(
        capfd, "calibrate", drive, "--init", drive, "-o", tmp_path / "c.yaml", "--report", page
    )
    assert code == 3
    found = read_calibration(tmp_path / "c.yaml")
    assert found.topics == ("wide-interval",)
    assert found.reasons[0].endswith(f": {KNOW_MOTION}")
    assert "the camera is 30 cm off at 15 m/s, which the interval includes" in " ".join(err.split())
    assert found.uncertainty is not None
    assert "::error title=semcal calibrate::fail; not_trusted 1 doubt; the interval is too wide, " in err
    assert NOT_BELIEVED in page.read_text()
    for said in (err, page.read_text()):
        assert stated_error(found.uncertainty, found.used_camera).replace("+-", "\u00b1") not in said
        assert "px at 10 m" not in said


def test_labels_with_a_clock_that_is_not_checked_weigh_less_than_a_prior(
    street_observations: Observations, street_truth: Pose, street: Path
) -> None:
    """A tape measure that disagrees with the labels by what the clock may cost is no contradiction."""
    polished = newton(street_observations, street_truth, PolishConfig()).T_camera_lidar
    measured = polished.copy()
    measured[:3, 3] -= polished[:3, :3] @ (0.15, 0.0, 0.0)
    tape = Prior("tape", measured, (0.01, 0.01, 0.01, np.inf, np.inf, np.inf))
    of_clock = covariance_of_clock(load(at_speed(read_drive(street), 8.0), CONFIG), polished)
    sure = fuse_with_priors(street_observations, polished, [tape])
    unsure = fuse_with_priors(street_observations, polished, [tape], motion_covariance=of_clock)
    assert [finding.topic for finding in check_priors(sure)] == ["prior"]
    assert check_priors(unsure) == ()
    assert unsure.twist_by_intrinsics is None
    off_m = camera_center(unsure.T_camera_lidar) - camera_center(measured)
    assert np.linalg.norm(off_m) < 0.01
    assert unsure.uncertainty is not None
    assert max(unsure.uncertainty.half_width_95_camera_center_m) < 0.03


def frames_at(drive: Drive, gaps_s: Sequence[float | None]) -> Drive:
    """The drive with a stamp of each sweep, and of the image some time after it, if there is one."""
    frames = [
        frame.model_copy(update={"points_stamp": 1.0, "image_stamp": None if gap_s is None else 1.0 + gap_s})
        for frame, gap_s in zip(drive.frames, gaps_s, strict=True)
    ]
    return drive.model_copy(update={"frames": tuple(frames)})


def test_what_to_state_is_said_of_stamped_frames_of_different_scenes(
    street: Path, street_observations: Observations
) -> None:
    drive, num_frames = read_drive(street), street_observations.num_frames
    advice = (
        "; in drive.yaml, give motion.poses, or motion.speed_m_s for an interval that includes clock errors"
    )
    standing = replace(street_observations, known_scenes=[0] * num_frames)
    for gaps_s, observations, expected in (
        ([0.01] * num_frames, street_observations, STANDING + advice),
        ([0.01] * num_frames, standing, STANDING),
        ([None] * num_frames, street_observations, STANDING),
    ):
        assert notes_on_clock(LoadedDrive(frames_at(drive, gaps_s), observations), None) == (expected,)
    assert notes_on_clock(LoadedDrive(at_speed(drive, 0.0), street_observations), None) == ()
    moving_on = LoadedDrive(at_speed(drive, 8.0), street_observations)
    assert notes_on_clock(moving_on, clock_of(moving_on)) == (MOVING,)
