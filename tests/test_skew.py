"""Sweeps that a speed skews which the drive does not give: the speed is found, and no longer moves the pose."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Cli, edited, make_pose, with_twists
from laboratory.raw_drive import RawDrive, write_raw_drive

from semcal_cli.config import CalibrationConfig, PolishConfig
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.lidar import Lidar, Spin
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.estimation.adjust import deskewed as speeds
from semcal_cli.estimation.adjust.deskewed import deskew
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import Level, Refinement
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.uncertainty.information import information_by_squares
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_points
from semcal_cli.observations.skew import Skew
from semcal_cli.pipeline.motion_assessment import compare_speed
from semcal_cli.pipeline.pose_stages import deskew_sweeps, start_at
from semcal_cli.pipeline.stages import Assessment, Stages
from semcal_cli.report.input import read_report_input

SPIN: dict[str, Any] = {"rate_hz": 10.0, "clockwise": True, "seam_deg": 180.0}
CAMERA = Camera(model="plumb_bob", width=64, height=32, K=((50, 0, 31.5), (0, 50, 15.5), (0, 0, 1)))
AHEAD = make_pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
AHEAD[:3, :3] = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
"""A camera that looks along the LiDAR's x axis."""
FAST_M_S = 20.0


def array_drive(**others: Any) -> Drive:
    arrays: dict[str, Any] = {
        "points": [np.float32([[10.0, 0.0, 0.0], [0.0, 10.0, 1.0], [0.0, -10.0, 2.0]])],
        "camera": CAMERA,
        "lidar": {"spin": SPIN},
        "synchronization": "hardware",
    }
    return Drive.from_arrays(**(arrays | others))


def spin_at(T_camera_lidar: Pose) -> dict[str, Any]:
    """A spin whose seam is behind the camera."""
    x, y = T_camera_lidar[2, :2]
    return SPIN | {"seam_deg": float(np.degrees(np.arctan2(-y, -x)))}


def skew_at(T_camera_lidar: Pose) -> Skew:
    x, y = T_camera_lidar[2, :2]
    view = np.float32([x, y, 0.0]) / np.float32(np.hypot(x, y))
    return Skew(Spin.model_validate(spin_at(T_camera_lidar)), view, (0.0,))


@pytest.fixture(scope="module")
def skewed(street_observations: Observations, street_truth: Pose) -> Observations:
    """A street as a rig sees it that drives fast along the view."""
    return skew_at(street_truth).deskewed(street_observations, -FAST_M_S)


def test_points_move_by_the_time_since_the_lidar_faced_the_camera() -> None:
    """Ahead, and 25 ms before and after; all are seen a little later in the image of a camera that exposes late."""
    drive = array_drive()
    observations = load_points(drive)

    def moved_m(drive: Drive) -> np.ndarray:
        (cloud,) = Skew.undone(observations, drive, AHEAD, 8.0).clouds
        return cloud.points - observations.clouds[0].points

    expected = np.array([[0.0, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]])
    np.testing.assert_allclose(moved_m(drive), expected, atol=1e-6)
    for late in ({"time_offset_s": 0.01}, {"points_stamps": [5.0], "image_stamps": [5.01]}):
        np.testing.assert_allclose(moved_m(array_drive(**late)), expected - [0.08, 0.0, 0.0], atol=1e-6)


def test_nothing_is_deskewed_without_a_spin_or_with_a_motion_or_at_the_seam() -> None:
    drives: list[dict[str, Any]] = [
        {"lidar": None},
        {"synchronization": "stamps"},
        {"motion": {"speed_m_s": 0.0}},
        {"motion": {"speed_m_s": 8.0}},
        {"lidar": {"spin": SPIN | {"seam_deg": 80.0}}},
    ]
    assert [Skew.of(array_drive(**others), AHEAD) for others in drives] == [None] * 5
    # A camera that looks up is never faced.
    assert Skew.of(array_drive(), np.eye(4)) is None


def test_sweeps_show_the_speed(
    skewed: Observations, street_observations: Observations, street_truth: Pose
) -> None:
    skew = skew_at(street_truth)
    before, standing = (
        newton(observations, street_truth, PolishConfig()).T_camera_lidar
        for observations in (skewed, street_observations)
    )
    deskewed = deskew(skewed, skew._replace(moment_sigma_s=0.002), before)
    speed = deskewed.speed
    assert speed is not None
    assert speed.is_used
    assert abs(speed.along_view_m_s - FAST_M_S) < 3.0 * speed.sigma_m_s
    after = newton(deskewed.observations, deskewed.T_camera_lidar, PolishConfig()).T_camera_lidar
    off_m = [compare_poses(T, standing).camera_center_m for T in (before, after)]
    assert off_m[1] < 0.5 * off_m[0]
    # 2 ms at 20 m/s are 4 cm along the view.
    assert deskewed.covariance is not None
    along_view = street_truth[:3, :3] @ skew.view
    assert along_view @ deskewed.covariance[:3, :3] @ along_view > 0.036**2


def test_where_maxima_are_many_the_highest_is_searched_for_at_each_speed(
    skewed: Observations, street: Path, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = read_drive(street)
    lidar = Lidar.model_validate({"spin": spin_at(street_truth)})
    data = replace(load(drive), observations=skewed, drive=drive.model_copy(update={"lidar": lidar}))
    beside = displace(street_truth, 0.4, 0.15, np.random.default_rng(0))
    initial = start_at(data, InitialPose(beside, "beside"))
    level = Level(1, beside, drift=0.0, num_points=1000, has_other_maxima=True)
    refined = Refinement(
        T_camera_lidar=beside, agreement=initial.agreement, levels=(level,), max_drift=0.5, converged=True
    )
    stages = Stages.from_refined(data, initial, refined, is_compensated=True)
    monkeypatch.setattr(speeds, "newton", lambda *_: pytest.fail("polished only"))
    seen, stages = deskew_sweeps(data, stages)
    assert stages.deskewed is not None
    speed, T = stages.deskewed.speed, stages.T_camera_lidar
    assert speed is not None
    assert speed.is_used
    assert abs(speed.along_view_m_s - FAST_M_S) < 3.0 * speed.sigma_m_s
    at_truth = newton(seen.observations, street_truth, PolishConfig()).T_camera_lidar
    assert compare_poses(T, at_truth).is_within(0.03, 0.01)
    # Priors hold the pose, so that only polishes follow it.
    with pytest.raises(pytest.fail.Exception, match="polished only"):
        deskew_sweeps(data, stages, with_priors=True)


def test_a_higher_maximum_is_kept_where_no_speed_is_found(
    street_observations: Observations, street_truth: Pose
) -> None:
    beside = displace(street_truth, 0.4, 0.15, np.random.default_rng(0))
    deskewed = deskew(street_observations, skew_at(street_truth), beside, np.random.default_rng(0))
    assert deskewed.speed is not None
    assert not deskewed.speed.is_used
    assert deskewed.observations is street_observations
    assert compare_poses(deskewed.T_camera_lidar, street_truth).is_within(0.05, 0.02)


def test_an_error_of_the_speed_is_part_of_the_interval(
    skewed: Observations, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A speed that is not used because it is uncertain counts as an error, along what it does to the pose."""
    skew = skew_at(street_truth)._replace(moment_sigma_s=0.0)
    used = deskew(skewed, skew, street_truth)
    monkeypatch.setattr(speeds, "MIN_SIGMAS", np.inf)
    unused = deskew(skewed, skew, street_truth)
    assert used.speed is not None
    assert unused.speed is not None
    assert (unused.observations, unused.T_camera_lidar) == (skewed, street_truth)
    assert used.covariance is not None
    assert unused.covariance is not None
    errors_m_s = np.hypot(unused.speed.sigma_m_s, unused.speed.along_view_m_s), used.speed.sigma_m_s
    np.testing.assert_allclose(
        unused.covariance, used.covariance * (errors_m_s[0] / errors_m_s[1]) ** 2, rtol=1e-6
    )


def test_a_rig_that_stands_stays_as_it_is(street_observations: Observations, street_truth: Pose) -> None:
    skew = skew_at(street_truth)
    deskewed = deskew(street_observations, skew, street_truth)
    assert deskewed.observations is street_observations
    assert deskewed.T_camera_lidar is street_truth
    assert deskewed.speed is not None
    assert not deskewed.speed.is_used
    assert "no speed" in deskewed.note
    # Three scenes tell none.
    few = deskew(street_observations.of_frames([0, 1, 2]), skew, street_truth)
    assert (few.speed, few.covariance) == (None, None)


def test_all_cues_show_the_speed(street: Path, street_truth: Pose) -> None:
    observations = load(read_drive(street), CalibrationConfig(cues=("labels", "edges"))).observations
    fits = speeds._fit_speeds(observations, skew_at(street_truth), street_truth, speeds.POLISH)
    assert fits is not None
    mean = information_by_squares(observations, fits.first.T_camera_lidar).mean
    assert fits.first.information == pytest.approx(mean)


def test_a_stated_motion_that_leaves_a_speed_is_doubted(
    skewed: Observations, street_observations: Observations, street: Path, street_truth: Pose
) -> None:
    """Sweeps at 20 m/s of a rig that is said to stand, and unskewed ones of a rig that stands."""
    data = load(read_drive(street))
    stated = {
        "lidar": Lidar.model_validate({"spin": spin_at(street_truth)}),
        "synchronization": "hardware",
        "motion": Motion(speed_m_s=0.0),
    }

    def compared(observations: Observations, **others: object) -> Assessment:
        drive = data.drive.model_copy(update=stated | others)
        seen = replace(data, drive=drive, observations=observations)
        stages = Stages.from_refined(
            seen, start_at(seen, InitialPose(street_truth, "truth")), None, is_compensated=True
        )
        checked = compare_speed(seen, replace(stages, assessment=Assessment())).assessment
        assert checked is not None
        return checked

    def topics(observations: Observations, **others: object) -> list[str]:
        return [finding.topic for finding in compared(observations, **others).findings]

    assert topics(skewed) == ["wrong-motion"]
    assert topics(street_observations) == []
    # A speed without a direction deskews nothing.
    assert topics(skewed, motion=Motion(speed_m_s=20.0)) == []
    # A camera that is triggered by the LiDAR exposes within some milliseconds.
    moving = with_twists(
        street_observations, [[8.0, 0.0, 0.0, 0.0, 0.0, 0.0]] * street_observations.num_frames
    )
    assert not compared(moving, time_offset_s=0.004).notes
    (note,) = compared(moving, time_offset_s=-0.05).notes
    assert "images are taken 50 ms before the LiDAR faces where the camera looks" in note
    assert "the camera is 40 cm off at 8.0 m/s" in note


def test_a_result_is_deskewed_and_states_the_speed(
    raw: RawDrive, street_truth: Pose, cli: Cli, tmp_path: Path
) -> None:
    skew, folder = skew_at(street_truth), tmp_path / "drive"
    folder.mkdir()
    moved = []
    for frame in raw.frames:
        since_s = skew.spin.times(np.float32(frame.points))
        points = frame.points - np.float32(FAST_M_S * since_s[:, None]) * skew.view
        moved.append(replace(frame, points=points))
    drive = write_raw_drive(replace(raw, frames=tuple(moved)), folder)
    with edited(folder) as document:
        document["lidar"]["spin"] = spin_at(street_truth)
        document["time_offset_sigma_s"] = 0.0
    result = tmp_path / "found.yaml"
    code, out, err = cli("calibrate", folder, "-o", result, "--json")
    assert code == 0, err
    found = json.loads(out)
    speed = found["speed"]
    assert speed["is_used"]
    assert abs(speed["along_view_m_s"] - FAST_M_S) < 3.0 * speed["sigma_m_s"]
    assert any("deskewed by the speed" in note for note in found["notes"])
    assert [*found["stages"]] == ["initial", "refined", "deskewed", "polished"]
    assert compare_poses(np.array(found["T_camera_lidar"]), street_truth).camera_center_m < 0.01
    assert "deskewed" in " ".join(err.split())
    # The report shows the sweeps that the pose belongs to.
    report = read_report_input(read_drive(folder), result)
    information = report.observations.information(report.T_camera_lidar)
    assert information == pytest.approx(found["quality"]["mutual_information_nats"], rel=0.02)
    code, _, err = cli("verify", drive, result)
    assert code != 3, err
    assert "deskewed by the speed" in " ".join(err.split())
