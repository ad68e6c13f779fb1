"""A check of the pose by the motion of camera and LiDAR, which needs neither labels nor edges."""

from __future__ import annotations

import math

import numpy as np

from semcal_cli.estimation.search.hand_eye import HandEye
from semcal_cli.findings.check import CAMERA_MOTION, Measured
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import rotation_difference, rotation_error_deg

SYSTEMATIC_SIGMA = math.radians(0.1)
"""Error of a rotation by motion that all pairs share: that of a principal point one pixel off, at a focal length of 600
pixels."""


def check_camera_motion(
    by_motion: HandEye, T_camera_lidar: Pose, covariance: Matrix | None = None
) -> Measured:
    """Check that the rotation of a pose is the one that the motion of camera and LiDAR gives.

    Args:
        by_motion: The rotation by motion.
        T_camera_lidar: (4, 4) pose, metres.
        covariance: (6, 6) covariance of the pose; None if it is unknown, as if the pose were exact.
    """
    sigmas = standard_errors(by_motion, T_camera_lidar, covariance)
    off_deg = rotation_error_deg(T_camera_lidar, by_motion.T_camera_lidar)
    sentence = (
        f"the motion of camera and LiDAR gives a rotation {off_deg:.2f} degrees away, {sigmas:.1f} standard errors, "
        f"needed at most {CAMERA_MOTION.limit():g}"
    )
    return CAMERA_MOTION.measured(sigmas, sentence)


def standard_errors(found: HandEye, T_camera_lidar: Pose, of_pose: Matrix | None = None) -> float:
    """Measure how far a rotation by motion is from that of a pose (4, 4), in standard errors of both.

    Args:
        found: The rotation by motion.
        T_camera_lidar: (4, 4), metres.
        of_pose: (6, 6) covariance of the pose; None if it is unknown, as if the pose were exact.
    """
    off = rotation_difference(T_camera_lidar, found.T_camera_lidar)
    covariance = found.covariance[:3, :3] + SYSTEMATIC_SIGMA**2 * np.eye(3)
    if of_pose is not None:
        covariance = covariance + of_pose[3:, 3:]
    return math.sqrt(off @ np.linalg.solve(covariance, off))
