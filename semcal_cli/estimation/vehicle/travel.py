"""The direction of travel of a vehicle in the frame of its LiDAR, from straight driving."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.errors import CalibrationError, counted
from semcal_cli.estimation.vehicle.scatter import PROBABILITY, Estimate, independent_share
from semcal_cli.geometry.arrays import Matrix, Numbers, Pose
from semcal_cli.geometry.poses import inverse, rotation_difference

MIN_CHORD_M, MAX_CHORD_M = 2.0, 40.0
"""Length of the intervals: a shorter one shows the errors of the poses, and a longer one is a gap."""
MIN_SPEED_M_S = 1.0
MAX_CURVATURE = 0.02
"""Largest turn of a nearly straight interval, radians per metre: a radius of 50 m."""
MIN_INTERVALS = 5
MAX_SLOPE_DEG = 8.0
"""Largest angle between the motion and the ground: beyond it, one of them is not what it seems."""
AHEAD_SIGMA_M = 3.0
"""Standard deviation of how far the LiDAR is ahead of the axle that does not steer."""
MIN_SIGMA_RAD = 1e-4
MAX_SIGMAS = 4.0
"""Intervals farther off are left out: the vehicle slid, or the poses jump."""
NUM_ROUNDS = 10


class Travel(NamedTuple):
    """The yaw of a LiDAR on its vehicle, by the direction in which it moves."""

    yaw_rad: Estimate
    """Angle from the direction of travel to the LiDAR's x axis, radians, positive to the left."""
    num_intervals: int
    """Number of nearly straight intervals; 1 for a twist."""
    length_m: float | None
    """Their length together; None for a twist."""
    share_backward: float = 0.0
    """Share of the intervals in which the vehicle moved the other way."""


def yaw_from_poses(stamps: Sequence[float], poses: Sequence[Pose], R_level_lidar: Matrix) -> Travel:
    """Estimate yaw from the poses of the LiDAR, where it drives nearly straight; most of the time it drives forward.

    Args:
        stamps: Times of the poses, seconds.
        poses: (4, 4) each, metres, in a fixed frame.
        R_level_lidar: (3, 3) turns the LiDAR's z axis upright: see `level_axes`.

    Raises:
        CalibrationError: there are too few nearly straight intervals.
    """
    chords = _chords(stamps, poses, R_level_lidar)
    is_straight = np.abs(chords[:, 1]) <= MAX_CURVATURE
    angles, curvatures, lengths_m, slopes = chords[is_straight].T
    if len(angles) < MIN_INTERVALS:
        raise CalibrationError(
            f"found {counted(len(angles), 'interval')} of nearly straight driving in the motion, needed "
            f"{MIN_INTERVALS} of {MIN_CHORD_M:g} m each or more"
        )
    if (slope_deg := math.degrees(abs(float(np.median(slopes))))) > MAX_SLOPE_DEG:
        raise CalibrationError(f"found a motion that leads {slope_deg:.0f} degrees out of the ground")
    # The doubled angle is the same for both ways along a line.
    axis = 0.5 * float(np.angle(np.median(np.cos(2.0 * angles)) + 1j * np.median(np.sin(2.0 * angles))))
    is_along = np.cos(angles - axis) > 0.0
    if np.mean(is_along) < 0.5:
        axis, is_along = axis + math.pi, ~is_along
    offsets = np.angle(np.exp(1j * (angles - axis + np.where(is_along, 0.0, math.pi))))
    off = _straight(offsets, np.where(is_along, curvatures, -curvatures))
    yaw = math.remainder(-(axis + off.value), 2.0 * math.pi)
    backward = 1.0 - float(np.mean(is_along))
    return Travel(Estimate(yaw, off.half_width_95), len(angles), float(lengths_m.sum()), backward)


def yaw_from_twist(
    linear_m_s: Sequence[float],
    angular_rad_s: Sequence[float],
    R_level_lidar: Matrix,
    sigma_m_s: float | None,
) -> Travel:
    """Estimate yaw from a constant motion of the LiDAR.

    Args:
        linear_m_s: (3,) velocity, LiDAR frame.
        angular_rad_s: (3,) angular velocity, LiDAR frame.
        R_level_lidar: (3, 3), see `level_axes`.
        sigma_m_s: Standard deviation of the velocity along each axis, if the drive states one.

    Raises:
        CalibrationError: the vehicle stands or turns.
    """
    x, y, _ = (R_level_lidar @ np.array(linear_m_s)).tolist()
    speed_m_s = math.hypot(x, y)
    turn_rad_s = float((R_level_lidar @ np.array(angular_rad_s))[2])
    if speed_m_s < MIN_SPEED_M_S or abs(turn_rad_s) > MAX_CURVATURE * speed_m_s:
        raise CalibrationError(
            f"found a twist of {speed_m_s:.2g} m/s that turns by {math.degrees(turn_rad_s):.2g} degrees per second, "
            "needed nearly straight driving"
        )
    half_width = None
    if sigma_m_s is not None:
        # A turn shows as a side slip of the LiDAR as far as it is ahead of the axle: dx k.
        slip_rad = AHEAD_SIGMA_M * turn_rad_s / speed_m_s
        half_width = 1.96 * math.hypot(sigma_m_s / speed_m_s, slip_rad)
    return Travel(Estimate(-math.atan2(y, x), half_width), 1, None)


def _chords(stamps: Sequence[float], poses: Sequence[Pose], R_level_lidar: Matrix) -> Matrix:
    """Cut a path into moving intervals.

    Each row of (N, 4) is the direction in the level frame, radians, the curvature, radians per metre, the length,
    metres, and the slope, radians. The chord of an arc has the direction of travel in the middle of the arc.
    """
    places = np.array([pose[:3, 3] for pose in poses])
    rows, start = list[tuple[float, float, float, float]](), 0
    for end in range(1, len(poses)):
        length_m = float(np.linalg.norm(places[end] - places[start]))
        if length_m < MIN_CHORD_M and stamps[end] - stamps[start] < MIN_CHORD_M / MIN_SPEED_M_S:
            continue
        is_moving = length_m >= MIN_SPEED_M_S * (stamps[end] - stamps[start])
        if is_moving and length_m <= MAX_CHORD_M:
            T_start_end = inverse(poses[start]) @ poses[end]
            turn = R_level_lidar @ rotation_difference(T_start_end, np.eye(4))
            x, y, z = (R_level_lidar @ T_start_end[:3, 3]).tolist()
            angle, slope = math.atan2(y, x) - 0.5 * float(turn[2]), math.atan2(z, math.hypot(x, y))
            rows.append((angle, float(turn[2]) / length_m, length_m, slope))
        start = end
    return np.array(rows).reshape(-1, 4)


def _straight(offsets: Numbers, curvatures: Numbers) -> Estimate:
    """Estimate the direction at zero curvature, t = t0 + d k, where d is how far the LiDAR is ahead of the axle.

    Args:
        offsets: (N,) directions of travel t, radians.
        curvatures: (N,) curvatures k, radians per metre.
    """
    A = np.column_stack([np.ones(len(offsets)), curvatures])
    estimate, is_used = np.array([np.median(offsets), 0.0]), np.ones(len(offsets), bool)
    for _ in range(NUM_ROUNDS):
        off = offsets - A @ estimate
        scale = max(1.4826 * float(np.median(np.abs(off))), MIN_SIGMA_RAD)
        is_used = np.abs(off) <= MAX_SIGMAS * scale
        # The prior d ~ N(0, AHEAD_SIGMA_M^2) decides where all intervals are alike.
        information = A[is_used].T @ A[is_used] / scale**2 + np.diag([0.0, AHEAD_SIGMA_M**-2])
        estimate = np.linalg.solve(information, A[is_used].T @ offsets[is_used] / scale**2)
    off = (offsets - A @ estimate)[is_used]
    freedom = len(off) - 2.0
    sigma = max(float(np.sqrt(off @ off / freedom)), MIN_SIGMA_RAD)
    share = independent_share(off)
    information = A[is_used].T @ A[is_used] * (share / sigma**2) + np.diag([0.0, AHEAD_SIGMA_M**-2])
    quantile = core.student_quantile(PROBABILITY, max(share * freedom, 1.0))
    return Estimate(float(estimate[0]), quantile * math.sqrt(np.linalg.inv(information)[0, 0]))
