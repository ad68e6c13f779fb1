"""Sweeps that a speed skews which the drive does not give: the speed is found, and skews the pose no more."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from conftest import Cli, edited, make_pose

from semcal_cli.config import PolishConfig
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.lidar import Spin
from semcal_cli.estimation.adjust.deskewed import deskew
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_points
from semcal_cli.observations.skew import Skew

SPIN: dict[str, Any] = {"rate_hz": 10.0, "clockwise": True, "seam_deg": 180.0}
CAMERA = Camera(model="plumb_bob", width=64, height=32, K=((50, 0, 31.5), (0, 50, 15.5), (0, 0, 1)))
AHEAD = make_pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
AHEAD[:3, :3] = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
"""A camera that looks along the LiDAR's x axis."""


def array_drive(**others: Any) -> Drive:
    arrays: dict[str, Any] = {
        "points": [np.float32([[10.0, 0.0, 0.0], [0.0, 10.0, 1.0], [0.0, -10.0, 2.0]])],
        "camera": CAMERA,
        "lidar": {"spin": SPIN},
        "synchronization": "hardware",
    }
    return Drive.from_arrays(**(arrays | others))


def skew_at(T_camera_lidar: Pose) -> Skew:
    """The skew of a LiDAR whose seam is behind the camera."""
    x, y = T_camera_lidar[2, :2]
    view = np.float32([x, y, 0.0]) / np.float32(np.hypot(x, y))
    seam_deg = float(np.degrees(np.arctan2(-y, -x)))
    return Skew(Spin.model_validate(SPIN | {"seam_deg": seam_deg}), view, 0.0)


def test_points_move_by_the_time_since_the_lidar_faced_the_camera() -> None:
    """Ahead, and 25 ms before and after; all are seen a little later in the image of a camera that exposes late."""
    drive = array_drive()
    observations, skew = load_points(drive), Skew.of(drive, AHEAD)
    assert skew is not None
    (cloud,) = skew.removed(observations, 8.0).clouds
    moved = cloud.points - observations.clouds[0].points
    np.testing.assert_allclose(moved, [[0.0, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]], atol=1e-6)
    late = Skew.of(array_drive(time_offset_s=0.01), AHEAD)
    assert late is not None
    (cloud,) = late.removed(observations, 8.0).clouds
    np.testing.assert_allclose(
        cloud.points - observations.clouds[0].points, moved - [0.08, 0.0, 0.0], atol=1e-6
    )


def test_what_the_drive_says_of_its_motion_counts() -> None:
    says: list[dict[str, Any]] = [
        {"lidar": None},
        {"synchronization": "stamps"},
        {"motion": {"speed_m_s": 0.0}},
        {"motion": {"speed_m_s": 8.0}},
    ]
    assert [Skew.of(array_drive(**others), AHEAD) for others in says] == [None] * 4
    # A camera that looks up is never faced.
    up = np.eye(4)
    assert Skew.of(array_drive(), up) is None


def test_sweeps_show_the_speed(street_observations: Observations, street_truth: Pose) -> None:
    skew = skew_at(street_truth)
    skewed = skew.removed(street_observations, -20.0)
    before = newton(skewed, street_truth, PolishConfig()).T_camera_lidar
    deskewed = deskew(skewed, skew, before, moment_sigma_s=0.002)
    speed = deskewed.speed
    assert speed is not None
    assert speed.is_moving
    assert abs(speed.along_view_m_s - 20.0) < 3.0 * speed.sigma_m_s
    after = newton(deskewed.observations, deskewed.T_camera_lidar, PolishConfig()).T_camera_lidar
    standing = newton(street_observations, street_truth, PolishConfig()).T_camera_lidar
    off_m = [compare_poses(T, standing).camera_center_m for T in (before, after)]
    assert off_m[1] < 0.4 * off_m[0]
    # 2 ms at 20 m/s are 4 cm along the view.
    assert deskewed.covariance is not None
    along_view = street_truth[:3, :3] @ skew.view
    assert along_view @ deskewed.covariance[:3, :3] @ along_view > 0.036**2


def test_a_rig_that_stands_stays_as_it_is(street_observations: Observations, street_truth: Pose) -> None:
    skew = skew_at(street_truth)
    deskewed = deskew(street_observations, skew, street_truth)
    assert deskewed.observations is street_observations
    assert deskewed.T_camera_lidar is street_truth
    assert deskewed.speed is not None
    assert not deskewed.speed.is_moving
    assert "no speed" in deskewed.note
    # Three scenes tell none.
    few = deskew(street_observations.of_frames([0, 1, 2]), skew, street_truth)
    assert (few.speed, few.covariance) == (None, None)


def test_a_result_states_the_speed(drive: Path, cli: Cli, tmp_path: Path) -> None:
    with edited(drive) as document:
        document["lidar"]["spin"] = SPIN
    result, report = tmp_path / "found.yaml", tmp_path / "found.html"
    code, out, _ = cli("calibrate", drive, "-o", result, "--json", "--report", report)
    assert code == 0
    found = json.loads(out)
    speed = found["speed"]
    assert abs(speed["along_view_m_s"]) < 3.0 * speed["sigma_m_s"]
    assert not speed["is_used"]
    assert any("the images show no speed" in note for note in found["notes"])
