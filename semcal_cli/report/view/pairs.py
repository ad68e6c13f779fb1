"""A start from pairs of a point and a pixel that a person clicks on, and the picture of a sweep to click on.

The picture is a panorama: columns are azimuths, from behind over left, front and right, and rows are elevations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.errors import InputError, counted
from semcal_cli.geometry.arrays import Image, Pose
from semcal_cli.geometry.poses import camera_center
from semcal_cli.report.colors import depth_levels, level_colors

COLUMNS = 1440
DEGREES_PER_ROW = 0.125
"""A row is half as high as a column is wide, because channels lie apart."""
MAX_ELEVATION_DEG = 60.0
DOT_ROWS = 5
REACH_PX = 12.0
"""Largest distance between a click and the point that it means, pixels of the panorama."""
MIN_PAIRS, MAX_PAIRS = 2, 50
PIXEL_SIGMA = 3.0
"""Error of a click, pixels."""
CENTER_SIGMA_M = 0.5
"""How far the camera may be from where the start has it: with two pairs, this decides its position."""
PARALLEL_DEG = 1.0
MIN_RANGE_M = 0.01
"""Distance of a point from the camera below which it has no direction."""


@dataclass(frozen=True)
class Panorama:
    """The points of a sweep in a picture."""

    points: npt.NDArray[np.float64]
    """(N, 3), metres, LiDAR frame; farthest first."""
    positions: npt.NDArray[np.float64]
    """(N, 2) column and row of each point."""
    rows: int

    @classmethod
    def of_points(cls, points: npt.NDArray[np.float32]) -> Panorama:
        """Place the points (N, 3), metres, LiDAR frame."""
        kept = np.asarray(points, np.float64)
        ranges = np.linalg.norm(kept, axis=1)
        kept = kept[np.argsort(-ranges, kind="stable")][: int((ranges > 0.0).sum())]
        ranges = np.linalg.norm(kept, axis=1)
        elevations = np.degrees(np.arcsin(np.clip(kept[:, 2] / ranges, -1.0, 1.0)))
        elevations = np.clip(elevations, -MAX_ELEVATION_DEG, MAX_ELEVATION_DEG)
        azimuths = np.degrees(np.arctan2(kept[:, 1], kept[:, 0]))
        top = float(elevations.max(initial=0.0)) + 1.0
        positions = np.column_stack(
            [(180.0 - azimuths) * COLUMNS / 360.0, (top - elevations) / DEGREES_PER_ROW]
        )
        return cls(kept, positions, int(positions[:, 1].max(initial=1.0)) + round(1.0 / DEGREES_PER_ROW))

    def draw(self) -> Image:
        """Draw the points, coloured by distance: (rows, columns, 3), blue, green, red."""
        image = np.zeros((self.rows, COLUMNS, 3), np.uint8)
        colors = level_colors(depth_levels(np.linalg.norm(self.points, axis=1)))
        columns = np.clip(self.positions[:, 0].astype(int), 0, COLUMNS - 1)
        for offset in range(-(DOT_ROWS // 2), DOT_ROWS // 2 + 1):
            rows = np.clip(self.positions[:, 1].astype(int) + offset, 0, self.rows - 1)
            image[rows, columns] = colors
        return image

    def pick(self, column: float, row: float) -> tuple[list[float], list[float]]:
        """Find the point next to a click: its coordinates, metres, and its column and row.

        Raises:
            InputError: there is none.
        """
        distances = np.hypot(*(self.positions - [column, row]).T)
        if not len(distances) or distances.min() > REACH_PX:
            raise InputError("view: no point is there; click on one")
        index = int(distances.argmin())
        return self.points[index].tolist(), self.positions[index].tolist()


def read_pairs(value: Any) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Read the pairs that the page sends: points (N, 3) and pixels (N, 2).

    Raises:
        InputError: they are not.
    """
    try:
        points = np.array([pair["point"] for pair in value], float)
        pixels = np.array([pair["pixel"] for pair in value], float)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError("view: found no pairs of a point and a pixel") from None
    count = len(points)
    if not MIN_PAIRS <= count <= MAX_PAIRS:
        raise InputError(f"view: found {counted(count, 'pair')}, needed {MIN_PAIRS} to {MAX_PAIRS}")
    if points.shape != (count, 3) or pixels.shape != (count, 2):
        raise InputError("view: found pairs of other sizes, needed 3 coordinates of a point and 2 of a pixel")
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise InputError("view: found a number that is not finite, expected points and pixels")
    return points, pixels


def pose_of_pairs(
    points_lidar: npt.NDArray[np.float64], pixels: npt.NDArray[np.float64], camera: Camera, T_start: Pose
) -> tuple[Pose, float]:
    """Find the pose that maps points onto their pixels, with the camera near where the start has it.

    Two pairs determine the rotation. The more there are, and the nearer the points, the more of the position do
    they determine, too.

    Args:
        points_lidar: (N, 3), metres, LiDAR frame.
        pixels: (N, 2), (u, v), integer = pixel centre.
        camera: The camera, with its lens.
        T_start: (4, 4) T_camera_lidar whose camera centre is known to `CENTER_SIGMA_M`; its rotation is not used.

    Returns:
        T_camera_lidar (4, 4), metres, and the largest distance between a pixel and its point, pixels.

    Raises:
        InputError: pixels are beyond the lens, or all pairs lie in one direction.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    lens = core_camera(camera)
    rays = lens.unproject(pixels)
    if not np.isfinite(rays).all():
        raise InputError("view: found a pixel that the lens does not reach; choose another")
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    center = np.array(camera_center(T_start))
    if np.linalg.norm(points_lidar - center, axis=1).min() < MIN_RANGE_M:
        raise InputError("view: found a point where the camera is; choose one farther away")

    def directions(center: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        offsets = points_lidar - center
        return np.asarray(offsets / np.linalg.norm(offsets, axis=1, keepdims=True))

    for seen in (rays, directions(center)):
        if np.linalg.norm(seen - seen.mean(axis=0), axis=1).max() < np.radians(PARALLEL_DEG):
            raise InputError("view: found pairs in one direction; choose some farther apart")
    initial, _ = Rotation.align_vectors(rays, directions(center))

    def residuals(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        turned = (Rotation.from_rotvec(x[:3]) * initial).apply(directions(center + x[3:]))
        angles = np.cross(turned, rays) * lens.pixels_per_radian / PIXEL_SIGMA
        return np.concatenate([angles.ravel(), x[3:] / CENTER_SIGMA_M])

    solution = least_squares(residuals, np.zeros(6)).x
    R = (Rotation.from_rotvec(solution[:3]) * initial).as_matrix()
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, -R @ (center + solution[3:])
    errors = residuals(solution)[:-3].reshape(-1, 3)
    return T, float(PIXEL_SIGMA * np.linalg.norm(errors, axis=1).max())
