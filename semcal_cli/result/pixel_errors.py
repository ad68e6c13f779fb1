"""Errors in the image: how far points land from where they should, in pixels, over the image and by their range.

Both maps are mrcal's (D. Kogan, https://mrcal.secretsauce.net): that of `show-projection-uncertainty`, in the worst
direction, and that of `show-projection-diff`. A range is the distance from the camera along the ray of a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from semcal_cli.drive.camera import Camera, core_camera, sigma_of
from semcal_cli.files.validation import StrictModel, Width
from semcal_cli.geometry.arrays import Matrices, Matrix, Numbers, Pose, Vectors
from semcal_cli.geometry.poses import inverse

RANGES_M = 5.0, 10.0, 30.0
"""Ranges at which errors are stated."""
NUM_NODES = 61
"""Number of nodes of a map along the longer side of the image."""
STEP = 1e-4
"""Step of the differences, as a share of the range."""
AHEAD = np.array([[0.0, 0.0, 1.0]])
"""The optical axis."""
ELLIPSE_95 = 2.447747
"""Standard errors that contain 95 % of a normal distribution in two dimensions: root of the chi-square quantile."""


class PixelErrors(StrictModel):
    """Half widths of the 95 % intervals in the image, in the worst direction, for points at one range."""

    range_m: Width
    """Distance of the points from the camera, in metres."""
    ahead_px: Width | None
    """Half width for a point straight ahead, in pixels; null for a lens that does not show its optical axis."""
    median_px: Width
    """Median over the image, in pixels."""
    worst_px: Width
    """Largest half width over the image, in pixels."""


@dataclass(frozen=True)
class PixelMap:
    """Errors of points at one range, at nodes over the image."""

    range_m: float
    columns: Numbers
    """(N,) u of the nodes, pixels."""
    rows: Numbers
    """(M,) v of the nodes, pixels."""
    errors_px: Matrix
    """(M, N) error at each node, pixels; NaN where the lens shows nothing."""
    ahead_px: float | None
    """Error of a point on the optical axis, pixels; None for a lens that does not show it."""

    @property
    def is_empty(self) -> bool:
        """Whether no node has an error."""
        return not np.isfinite(self.errors_px).any()

    @property
    def median_px(self) -> float:
        """Median of the errors over the image, pixels."""
        return float(np.nanmedian(self.errors_px))

    @property
    def worst_px(self) -> float:
        """Largest error over the image, pixels."""
        return float(np.nanmax(self.errors_px))


def half_axes_px(
    camera: Camera, covariance: Matrix, points_camera: Vectors, by_intrinsics: Matrix | None = None
) -> Numbers:
    """Compute the longest half axes (N,) of the 95 % ellipses of points in the image, in pixels.

    They are sqrt(q lambda), with the largest eigenvalue lambda of the pixel's covariance and the chi-square quantile q
    for two degrees of freedom. To first order, that is J C J^T, where J is the derivative of a pixel by the twist.

    Points are projected with the K that the pose was found with. An error of K moves them, and moves the pose so that
    they stay where the data are: what it does to both largely cancels. With K's part S of the twist and the motion M of
    a pixel by the same errors, the covariance is J C J^T + J S M^T + M S^T J^T + M M^T, in which S S^T is part of C.

    Args:
        camera: The camera.
        covariance: (6, 6) covariance C of the twist xi of exp(xi) T_camera_lidar, metres and radians.
        points_camera: (N, 3) points in the camera frame, metres.
        by_intrinsics: (6, 4) S, twist by an error of one standard deviation of fx, fy, cx and cy; None if K is exact.

    Returns:
        (N,), NaN where the lens model does not hold.
    """
    J = _motions(camera, points_camera)
    scatter = J @ covariance @ np.swapaxes(J, 1, 2)
    if by_intrinsics is not None:
        M = _motions_by_intrinsics(camera, points_camera) * by_intrinsics.any(axis=0)
        cross = J @ by_intrinsics @ np.swapaxes(M, 1, 2)
        scatter = scatter + cross + np.swapaxes(cross, 1, 2) + M @ np.swapaxes(M, 1, 2)
    uu, uv, vv = scatter[:, 0, 0], scatter[:, 0, 1], scatter[:, 1, 1]
    largest = 0.5 * (uu + vv) + np.hypot(0.5 * (uu - vv), uv)
    return np.asarray(ELLIPSE_95 * np.sqrt(np.maximum(largest, 0.0)))


def uncertainty_maps(
    camera: Camera, covariance: Matrix, by_intrinsics: Matrix | None = None
) -> list[PixelMap]:
    """Map the half axes of 95 % ellipses over the image, at each of `RANGES_M`: see `half_axes_px`."""
    return _maps(camera, lambda points: half_axes_px(camera, covariance, points, by_intrinsics))


def difference_maps(a: tuple[Pose, Camera], b: tuple[Pose, Camera]) -> list[PixelMap]:
    """Map how far apart two calibrations put the same points of the LiDAR in the image, at each of `RANGES_M`.

    Args:
        a: T_camera_lidar (4, 4) and its camera; nodes and ranges are those of this camera.
        b: The other ones, of an image of the same size.
    """
    (T_a, camera_a), (T_b, camera_b) = a, b
    T_b_a = T_b @ inverse(T_a)

    def differences_px(points_a: Vectors) -> Numbers:
        points_b = np.ascontiguousarray(points_a @ T_b_a[:3, :3].T + T_b_a[:3, 3])
        pixels = core_camera(camera_a).project(points_a), core_camera(camera_b).project(points_b)
        return np.asarray(np.linalg.norm(_offsets(camera_a, *pixels), axis=-1))

    return _maps(camera_a, differences_px)


def summarise(maps: Sequence[PixelMap]) -> tuple[PixelErrors, ...]:
    """Summarise maps for a document; those without any error are left out."""
    return tuple(
        PixelErrors(
            range_m=each.range_m,
            ahead_px=each.ahead_px,
            median_px=each.median_px,
            worst_px=each.worst_px,
        )
        for each in maps
        if not each.is_empty
    )


def _maps(camera: Camera, errors_px: Callable[[Vectors], Numbers]) -> list[PixelMap]:
    """Evaluate errors (N,) of points (N, 3) in the camera frame at the nodes and on the optical axis, by range."""
    longer = max(camera.size)
    columns, rows = (
        np.linspace(0.0, max(1.0, side - 1.0), max(2, round(NUM_NODES * side / longer)))
        for side in camera.size
    )
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1)
    rays = core_camera(camera).unproject(nodes.reshape(-1, 2))
    maps = []
    for range_m in RANGES_M:
        *errors, ahead = errors_px(range_m * np.concatenate([rays, AHEAD])).tolist()
        over_image = np.reshape(errors, nodes.shape[:2])
        maps.append(PixelMap(range_m, columns, rows, over_image, ahead if math.isfinite(ahead) else None))
    return maps


def _motions(camera: Camera, points_camera: Vectors) -> Matrices:
    """Compute the pixels (N, 2, 6) by which a twist, in metres and radians, moves points (N, 3)."""
    steps = STEP * np.linalg.norm(points_camera, axis=1)[:, None, None]
    ends = points_camera[:, None] + steps * np.concatenate([np.eye(3), -np.eye(3)])
    pixels = core_camera(camera).project(ends.reshape(-1, 3)).reshape(-1, 6, 2)
    jacobians = np.swapaxes(_offsets(camera, pixels[:, 3:], pixels[:, :3]) / (2.0 * steps), 1, 2)
    # p moves by rho + phi x p = rho - [p]_x phi.
    (x, y, z), zero = points_camera.T, np.zeros(len(points_camera))
    crosses = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0).copy()
    return np.concatenate([jacobians, -jacobians @ crosses], axis=2)


def _motions_by_intrinsics(camera: Camera, points_camera: Vectors) -> Matrices:
    """Compute the pixels (N, 2, 4) by which errors of a standard deviation of fx, fy, cx and cy move points (N, 3).

    Those of a panorama are along the sphere, as in `_offsets`.
    """
    (fx, skew, cx), (_, fy, cy), _ = camera.K
    u, v = core_camera(camera).project(points_camera).T
    y = (v - cy) / fy
    zero, one = np.zeros_like(u), np.ones_like(u)
    across = np.cos(y) if camera.model == "equirectangular" else one
    columns = [[across * (u - cx - skew * y) / fx, zero, across, zero], [zero, y, zero, one]]
    sigma = sigma_of(camera)
    return np.asarray(np.moveaxis(np.array(columns), 2, 0) * [sigma.fx, sigma.fy, sigma.cx, sigma.cy])


def _offsets(camera: Camera, start: Numbers, end: Numbers) -> Numbers:
    """Compute the offsets between pixels (..., 2); of a panorama, along the sphere.

    A panorama's left and right borders meet, and its rows shrink towards the poles.
    """
    offsets = end - start
    if camera.model != "equirectangular":
        return offsets
    (fx, _, _), (_, fy, cy), _ = camera.K
    turn = 2.0 * math.pi * fx
    across = (offsets[..., 0] + 0.5 * turn) % turn - 0.5 * turn
    elevation = (0.5 * (start + end)[..., 1] - cy) / fy
    return np.stack([across * np.cos(elevation), offsets[..., 1]], axis=-1)
