"""The mounting's rotation by motion: closed forms, what turns and ways leave open, and what a user sees."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import invoke
from conftest import make_pose
from consecutive_images import LongSweeps, write_images

from semcal_cli.checks.camera_motion import check_camera_motion
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.hand_eye import (
    MAX_HALF_WIDTH_DEG,
    HandEye,
    NotDetermined,
    Pair,
    choose_pairs,
    hand_eye,
    rotation_between,
    solve,
)
from semcal_cli.estimation.search.visual_motion import across, refined
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse, pose_from_mounting, rotation_error_deg
from semcal_cli.synthetic.street_motion import VehicleMotion

TRUTH = pose_from_mounting((2.0, -5.0, 70.0), (0.4, 0.3, -0.2))
EXACT_DEG = math.degrees(1e-9)
KNOWN = np.diag([1e-3**2] * 3 + [4e-3**2] * 2)
TURNS = [
    (10.0, 0.3),
    (6.0, -0.3),
    (12.0, 0.1),
    (8.0, -0.2),
    (9.0, 0.0),
    (3.0, 0.4),
    (14.0, 0.0),
    (11.0, -0.1),
]
"""Speeds and turns, metres and radians a second."""


def pairs_of(T_camera_lidar: Pose, motions: list[tuple[float, float]], seed: int | None = None) -> list[Pair]:
    """Motions of half a second, as camera and LiDAR make them; with a seed, seen with errors as `KNOWN` says."""
    rng, found = np.random.default_rng(seed), []
    for speed_m_s, turn_rad_s in motions:
        T_B = VehicleMotion(speed_m_s, turn_rad_s).displacement(0.5)
        T_A = T_camera_lidar @ T_B @ inverse(T_camera_lidar)
        direction = T_A[:3, 3] / np.linalg.norm(T_A[:3, 3])
        R, basis = T_A[:3, :3], across(direction)
        if seed is not None:
            off = rng.multivariate_normal(np.zeros(5), KNOWN)
            R = cv2.Rodrigues(off[:3])[0] @ R
            direction = direction + basis.T @ off[3:]
            direction /= np.linalg.norm(direction)
        found.append(Pair(R, direction, across(direction), KNOWN, T_B))
    return found


def test_turns_about_two_axes_determine_the_rotation_in_closed_form() -> None:
    source = np.random.default_rng(0).standard_normal((5, 3))
    R = TRUTH[:3, :3]
    found = rotation_between(source @ R.T, source, np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    assert np.abs(found - R).max() < 1e-9


def test_exact_motions_in_a_plane_give_the_exact_rotation() -> None:
    at_lidar = pose_from_mounting((2.0, -5.0, 70.0), (0.0, 0.0, 0.0))
    found = solve(pairs_of(at_lidar, TURNS))
    assert rotation_error_deg(found.T_camera_lidar, at_lidar) < EXACT_DEG
    assert found.half_width_deg < MAX_HALF_WIDTH_DEG


def test_a_camera_beside_the_lidar_bends_ways_but_not_the_rotation() -> None:
    found = solve(pairs_of(TRUTH, TURNS))
    # The camera is taken to be near the LiDAR, which pulls its place, and the rotation by little of its interval.
    assert rotation_error_deg(found.T_camera_lidar, TRUTH) < 0.03 * found.half_width_deg
    # How far it is in front shows where the car turns; how high it is never does.
    assert found.covariance[3, 3] < 0.1**2
    assert found.covariance[5, 5] == pytest.approx(1.0, rel=1e-3)


def test_intervals_hold_and_a_wrong_pair_hardly_counts() -> None:
    errors = []
    for seed in range(20):
        pairs = pairs_of(TRUTH, 3 * TURNS, seed)
        wrong = pairs[0]._replace(R_A=cv2.Rodrigues(np.array([0.0, 0.5, 0.0]))[0])
        found = solve([wrong, *pairs[1:]])
        errors.append(rotation_error_deg(found.T_camera_lidar, TRUTH) / found.half_width_deg)
    # Errors about three axes beside the interval of the widest one.
    assert max(errors) < 1.5
    assert np.median(errors) > 0.1


def test_straight_ways_leave_the_rotation_about_them_open() -> None:
    straight = [(speed, 0.0) for speed, _ in TURNS]
    assert solve(pairs_of(TRUTH, straight)).half_width_deg > MAX_HALF_WIDTH_DEG
    assert solve(pairs_of(TRUTH, 3 * straight, seed=1)).half_width_deg > MAX_HALF_WIDTH_DEG


def test_turns_on_the_spot_leave_the_rotation_about_their_axis_open() -> None:
    turns = [pair._replace(covariance=np.diag([1e-6] * 3 + [1.0] * 2)) for pair in pairs_of(TRUTH, TURNS)]
    assert solve(turns).half_width_deg > MAX_HALF_WIDTH_DEG


def test_rays_of_two_images_tell_the_motion_and_its_error() -> None:
    T = make_pose((0.02, -0.05, 0.01), (0.1, 0.05, 1.0))
    rng = np.random.default_rng(3)
    points = rng.uniform((-8.0, -3.0, 5.0), (8.0, 3.0, 40.0), (300, 3))
    second = (points - T[:3, 3]) @ T[:3, :3]
    first, second = (each / np.linalg.norm(each, axis=1)[:, None] for each in (points, second))
    noisy = second + 5e-4 * rng.standard_normal(second.shape)
    noisy /= np.linalg.norm(noisy, axis=1)[:, None]
    near = np.array([0.15, 0.0, 1.0]) / np.linalg.norm([0.15, 0.0, 1.0])
    exact = refined(first, second, np.eye(3), near, 1e-6)
    assert np.abs(exact.R - T[:3, :3]).max() < 1e-9
    found = refined(first, noisy, np.eye(3), near, 1e-6)
    off = cv2.Rodrigues(found.R @ T[:3, :3].T)[0].ravel()
    sigma = math.sqrt(np.trace(np.linalg.inv(found.information)[:3, :3]))
    assert 0.1 * sigma < np.linalg.norm(off) < 3.0 * sigma


def test_a_rotation_that_motion_contradicts_is_doubted() -> None:
    found = HandEye(TRUTH, 1e-5 * np.eye(6), 20, 90.0)

    def compared(turn_rad: float) -> tuple[str, ...]:
        T_turned = make_pose((turn_rad, 0.0, 0.0), (0.0, 0.0, 0.0)) @ TRUTH
        return tuple(finding.sentence for finding in check_camera_motion(found, T_turned).findings)

    assert compared(0.005) == ()
    (sentence,) = compared(0.03)
    assert "gives a rotation 1.72 degrees away, 8.3 standard errors (limit 4)" in sentence


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Turns of ten streets, whose camera looks forward."""
    folder = tmp_path_factory.mktemp("turning") / "drive"
    size = {"width": 640, "height": 360, "channels": 32}
    write_images(LongSweeps(num_frames=10, seed=7, motion="mixed", camera_azimuth_deg=0.0, **size), folder)
    return folder


def test_edges_start_from_nothing_where_the_car_turns(turning: Path, tmp_path: Path) -> None:
    result = invoke("calibrate", turning, "--cue", "edges", "-o", tmp_path / "found.yaml")
    assert result.exit_code in (0, 3), result.output
    words = " ".join(result.stderr.split())
    assert "the motion of camera and LiDAR gives the rotation to ±" in words
    assert "which agrees with the pose" in words
    error = compare_poses(read_transform(tmp_path / "found.yaml"), read_transform(turning))
    # Small images of few streets: as in tests of edges.
    assert error.rotation_deg < 0.3
    assert error.camera_center_cm < 8.0
    found = hand_eye(read_drive(turning))
    assert isinstance(found, HandEye)
    assert rotation_error_deg(found.T_camera_lidar, read_transform(turning)) < 1.0


def test_without_turns_or_images_that_follow_one_another_a_start_is_asked_for(
    turning: Path, tmp_path: Path
) -> None:
    drive = read_drive(turning)
    sparse = drive.model_copy(update={"frames": drive.frames[1::3]})
    assert choose_pairs(sparse) == []
    found = hand_eye(sparse)
    assert isinstance(found, NotDetermined)
    assert "no frames are consecutive, expected images at most 0.75 s apart" in found.why
    assert isinstance(hand_eye(drive.model_copy(update={"motion": None})), NotDetermined)
    size = {"width": 160, "height": 90, "channels": 16, "columns": 600}
    write_images(LongSweeps(num_frames=8, motion="steady", **size), tmp_path / "straight")
    options = ["--cue", "edges", "--from-nothing", "-o", tmp_path / "none.yaml", "-q"]
    result = invoke("calibrate", tmp_path / "straight", *options)
    assert result.exit_code == 1
    assert isinstance(result.exception, InputError)
    assert "the drive has too few turns, 0.0 degrees in" in str(result.exception)
