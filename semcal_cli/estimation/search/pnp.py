"""The perspective-n-point problem: the pose from pairs of points and pixels (Alg. 2, line 8)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.config import PnpConfig
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.errors import CalibrationError, counted
from semcal_cli.geometry.arrays import Pose, Rays
from semcal_cli.geometry.twists import apply_motion

MIN_DEPTH = 0.2
"""Minimum z of a unit ray, at 78 degrees from the optical axis; beyond, pinhole coordinates grow without bound."""

VIRTUAL_MIN_DEPTH = math.cos(math.radians(50.0))
"""Minimum z of a unit ray in a virtual pinhole camera of 100 degrees, which sees the pairs of a wide lens."""

NUM_DIRECTIONS = 64
"""Number of rays along which a virtual camera may look."""

MAX_VIEWS = 4
"""Maximum number of virtual cameras. Several are tried because wrong pairs may cluster in one direction."""

MAX_STEPS = 20
"""Maximum number of steps of the joint refinement; it takes about five from a good start."""

MIN_RANGE = 1e-6
"""Minimum range of a point, in metres, because a point at the camera centre has no direction."""

SETTLED = 1e-10
"""Maximum component of the last step, metres and radians."""


def solve_pnp(
    points_lidar: npt.NDArray[np.float64],
    pixels: npt.NDArray[np.float64],
    camera: Camera,
    config: PnpConfig,
) -> tuple[Pose, int]:
    """Find the pose that maps LiDAR points onto their pixels, with SQPnP in RANSAC and then Levenberg-Marquardt.

    Pixels are first converted to rays, so that one solver in normalised coordinates serves every camera model. These
    coordinates end at 90 degrees. The pairs of a wide lens are therefore seen through virtual pinhole cameras, and the
    pose is then refined over all pairs by angles.

    Args:
        points_lidar: (N, 3) float64, metres, LiDAR frame.
        pixels: (N, 2) float64, (u, v), integer = pixel centre.
        camera: The camera, with its lens.
        config: Settings of the robust estimator.

    Returns:
        T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres, and the number of inliers.

    Raises:
        CalibrationError: there are fewer pairs or inliers than `config.min_inliers`, or the points do not determine a
            pose.
    """
    lens = core_camera(camera)
    rays = lens.unproject(pixels)
    reached = np.isfinite(rays).all(1)
    points, rays = points_lidar[reached], rays[reached]
    if lens.limit <= math.pi / 2:
        return _solve_pinhole(points, rays, MIN_DEPTH, config)
    return _solve_wide(points, rays, config)


def _solve_wide(points_lidar: npt.NDArray[np.float64], rays: Rays, config: PnpConfig) -> tuple[Pose, int]:
    """Solve PnP in virtual pinhole cameras, refine each pose over all pairs, and take the one with the most inliers."""
    poses: list[tuple[Pose, int]] = []
    failure = f"PnP: found {counted(len(rays), 'pair')}, needed {config.min_inliers}"
    for R_virtual_camera in _views(rays, config):
        T_camera_lidar = np.eye(4)
        try:
            T_virtual_lidar, _ = _solve_pinhole(
                points_lidar, rays @ R_virtual_camera.T, VIRTUAL_MIN_DEPTH, config
            )
            T_camera_lidar[:3] = R_virtual_camera.T @ T_virtual_lidar[:3]
            poses.append(_refine_angles(points_lidar, rays, T_camera_lidar, config))
        except CalibrationError as error:
            failure = str(error)
    if not poses:
        raise CalibrationError(failure)
    return max(poses, key=lambda pose_and_inliers: pose_and_inliers[1])


def _solve_pinhole(
    points_lidar: npt.NDArray[np.float64], rays: Rays, min_depth: float, config: PnpConfig
) -> tuple[Pose, int]:
    """Solve PnP with the rays whose z is larger than `min_depth`."""
    inside = rays[:, 2] > min_depth
    points, rays = points_lidar[inside], rays[inside]
    if len(points) < config.min_inliers:
        raise CalibrationError(f"PnP: found {counted(len(points), 'pair')}, needed {config.min_inliers}")
    image = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    identity, no_distortion = np.eye(3), np.zeros(4)
    try:
        is_solved, rotation, translation, inliers = cv2.solvePnPRansac(
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
    if not is_solved or num_inliers < config.min_inliers:
        raise CalibrationError(f"PnP: found {counted(num_inliers, 'inlier')}, needed {config.min_inliers}")
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


def _views(rays: Rays, config: PnpConfig) -> Iterator[npt.NDArray[np.float64]]:
    """Yield R_virtual_camera (3, 3) of cameras, each looking at the most rays that no previous camera has seen."""
    directions = rays[:: -(-len(rays) // NUM_DIRECTIONS) or 1]
    is_in_view = rays @ directions.T > VIRTUAL_MIN_DEPTH
    for _ in range(MAX_VIEWS):
        num_in_view = is_in_view.sum(0)
        if not num_in_view.size or num_in_view.max() < config.min_inliers:
            return
        chosen = is_in_view[:, np.argmax(num_in_view)].copy()
        yield _looking_along(rays[chosen].mean(0))
        is_in_view[chosen] = False


def _looking_along(forward: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Compute R_virtual_camera (3, 3) of a camera with a given optical axis."""
    aside = np.eye(3)[np.argmin(np.abs(forward))]
    right = np.cross(aside, forward)
    rows = np.stack([right, np.cross(forward, right), forward])
    R_virtual_camera: npt.NDArray[np.float64] = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return R_virtual_camera


def _refine_angles(
    points_lidar: npt.NDArray[np.float64], rays: Rays, T_start: Pose, config: PnpConfig
) -> tuple[Pose, int]:
    """Refine a pose over the inliers by Gauss-Newton on the chords between rays and the directions of their points."""
    max_chord = 2.0 * math.sin(0.5 * math.radians(config.max_error_deg))
    T_camera_lidar = T_start
    for _ in range(MAX_STEPS):
        points_camera = points_lidar @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
        ranges = np.maximum(np.linalg.norm(points_camera, axis=1, keepdims=True), MIN_RANGE)
        directions = points_camera / ranges
        chords = rays - directions
        kept = np.linalg.norm(chords, axis=1) <= max_chord
        if kept.sum() < config.min_inliers:
            raise CalibrationError(f"PnP: found {counted(kept.sum(), 'inlier')}, needed {config.min_inliers}")
        slopes = _direction_slopes(directions[kept], ranges[kept]).reshape(-1, 6)
        # The pseudo-inverse of the normal equations does not change the pose along undetermined directions.
        twist, *_ = np.linalg.lstsq(slopes.T @ slopes, slopes.T @ chords[kept].ravel(), rcond=None)
        T_camera_lidar = apply_motion(T_camera_lidar, cv2.Rodrigues(twist[3:])[0], twist[:3])
        if np.abs(twist).max() < SETTLED:
            break
    return T_camera_lidar, int(kept.sum())


def _direction_slopes(directions: Rays, ranges: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Compute the derivatives (N, 3, 6) of directions with respect to a twist (rho, phi) on the left of the pose."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    by_rotation = -np.cross(directions[:, None, :], np.eye(3)).transpose(0, 2, 1)
    return np.concatenate([across / ranges[:, :, None], by_rotation], 2)
