"""Whether the rotation of a pose is that of the motion of camera and LiDAR, which needs neither labels nor edges."""

from __future__ import annotations

import math

import numpy as np

from semcal_cli.estimation.search.hand_eye import HandEye
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import rotation_difference, rotation_error_deg

CAMERA_MOTION = Check(
    topic="camera-motion",
    advice=(
        "check with `semcal overlay` whether points lie on their objects, and check K, the clocks and the motion"
    ),
    entry=Entry(
        title="The motion of the camera contradicts the rotation",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "the motion of camera and LiDAR gives a rotation 1.72 degrees away, 8.3 standard errors "
                "(limit 4): check with `semcal overlay` whether points lie on their objects, and "
                "check K, the clocks and the motion"
            ),
        ),
        meaning=(
            "The motion of the camera, measured from the images alone, does not fit the motion of the "
            "LiDAR at this pose. Neither labels nor edges are used."
        ),
        cause="The pose, K, the clocks or `motion:` is wrong.",
        remedy=(
            "Look at an overlay. If points lie on their objects, check K and the times; if not, add "
            "frames or give `--init`."
        ),
        figure=(
            "Difference between the two rotations, in standard errors of both. The check needs "
            "`motion:` with turns, and consecutive images."
        ),
    ),
)
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
        f"the motion of camera and LiDAR gives a rotation {off_deg:.2f} degrees away, {sigmas:.1f} standard errors "
        f"(limit {CAMERA_MOTION.limit():g})"
    )
    return CAMERA_MOTION.measured(sigmas, sentence)


def standard_errors(by_motion: HandEye, T_camera_lidar: Pose, pose_covariance: Matrix | None = None) -> float:
    """Measure how far a rotation by motion is from that of a pose (4, 4), in standard errors of both.

    Args:
        by_motion: The rotation by motion.
        T_camera_lidar: (4, 4), metres.
        pose_covariance: (6, 6) covariance of the pose; None if it is unknown, as if the pose were exact.
    """
    off = rotation_difference(T_camera_lidar, by_motion.T_camera_lidar)
    covariance = by_motion.covariance[:3, :3] + SYSTEMATIC_SIGMA**2 * np.eye(3)
    if pose_covariance is not None:
        covariance = covariance + pose_covariance[3:, 3:]
    return math.sqrt(off @ np.linalg.solve(covariance, off))
