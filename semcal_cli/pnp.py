"""The pose from pixels and the points they show (Alg. 2, line 8)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.camera import core_camera
from semcal_cli.drive import Camera
from semcal_cli.errors import CalibrationError
from semcal_cli.poses import Pose

MIN_DEPTH = 0.2
"""Rays farther than 78 degrees from the optical axis are left out: in a pinhole picture they run away."""


@dataclass(frozen=True)
class PnpConfig:
    """How the robust estimator works."""

    max_error_deg: float = 1.0
    """Pairs within this angle of the pose are its inliers."""
    min_inliers: int = 12
    confidence: float = 0.999
    max_iterations: int = 1000


def solve_pnp(
    points_lidar: npt.NDArray[np.float64],
    pixels: npt.NDArray[np.float64],
    camera: Camera,
    config: PnpConfig,
) -> tuple[Pose, int]:
    """Find the pose that maps LiDAR points onto their pixels: SQPnP inside RANSAC, then Levenberg-Marquardt.

    The lens is undone first, so that one solver in normalised coordinates serves every model.

    Args:
        points_lidar: (N, 3) float64, metres, LiDAR frame.
        pixels: (N, 2) float64, (u, v), integer = pixel centre.
        camera: The camera, with its lens.
        config: How the robust estimator works.

    Returns:
        T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, and the number of inliers.

    Raises:
        CalibrationError: fewer pairs or inliers than `config.min_inliers`, or points that determine no pose.
    """
    rays = core_camera(camera).unproject(pixels)
    in_front = rays[:, 2] > MIN_DEPTH
    points, rays = points_lidar[in_front], rays[in_front]
    if len(points) < config.min_inliers:
        raise CalibrationError(f"PnP: found {len(points)} pairs, needed {config.min_inliers}")
    image = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    identity, no_distortion = np.eye(3), np.zeros(4)
    try:
        found, rotation, translation, inliers = cv2.solvePnPRansac(
            points,
            image,
            identity,
            no_distortion,
            flags=cv2.SOLVEPNP_SQPNP,
            reprojectionError=float(np.radians(config.max_error_deg)),
            confidence=config.confidence,
            iterationsCount=config.max_iterations,
        )
    except cv2.error:
        raise CalibrationError("PnP: the points do not determine a pose") from None
    num_inliers = 0 if inliers is None else len(inliers)
    if not found or num_inliers < config.min_inliers:
        raise CalibrationError(f"PnP: found {num_inliers} inliers, needed {config.min_inliers}")
    kept = inliers[:, 0]
    rotation, translation = cv2.solvePnPRefineLM(
        points[kept], image[kept], identity, no_distortion, rotation, translation
    )
    T_camera_lidar = np.eye(4)
    T_camera_lidar[:3, :3] = cv2.Rodrigues(rotation)[0]
    T_camera_lidar[:3, 3] = translation[:, 0]
    if not np.isfinite(T_camera_lidar).all():
        raise CalibrationError("PnP: the points do not determine a pose")
    return T_camera_lidar, num_inliers
