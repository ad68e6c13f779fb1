"""KITTI-360's accumulated points: labelled PLY files in world coordinates, one for about 240 frames.

kitti360scripts/evaluation/semantic_3d/README.md: vertices have x y z red green blue semantic instance visible
confidence; `visible` is 0 for points that no image of the perspective pair shows. Files are named after their first and
last frame, as 0000000002_0000000385.ply.
"""

from __future__ import annotations

import re
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.datasets.ply import read_vertices, vertex_column
from semcal_cli.datasets.recording import Cloud, Conversion
from semcal_cli.errors import InputError
from semcal_cli.geometry.poses import Pose

RADIUS_M = 60.0
"""Largest distance of a point from the LiDAR that is kept."""
CELL_DEG = 0.2
"""Side of a cell of directions. Only the nearest point in a cell is kept; farther ones, seen from other places, are
hidden from here."""


class Windows:
    """All windows of accumulated points of a drive."""

    def __init__(self, folder: Path, *, visible_only: bool):
        self._ranges = {_frames(path): path for path in sorted(folder.glob("*.ply"))}
        if not self._ranges:
            raise InputError(f"{folder}: found no windows, needed files as 0000000002_0000000385.ply")
        self._visible_only = visible_only

    def __contains__(self, frame: int) -> bool:
        return any(frame in numbers for numbers in self._ranges)

    def around(self, frame: int, T_world_lidar: Pose) -> Conversion:
        """Cut the points around the LiDAR out of a window.

        Args:
            frame: Number of the frame; of two windows that hold it, the one with the nearer middle is used.
            T_world_lidar: (4, 4), metres.
        """
        containing = [numbers for numbers in self._ranges if frame in numbers]
        nearest = min(containing, key=lambda numbers: abs(numbers[0] + numbers[-1] - 2 * frame))
        cut = partial(_cut, self._ranges[nearest], T_world_lidar, self._visible_only)
        return Conversion(cut, has_labels=True, file=self._ranges[nearest], in_order=False)


def _cut(path: Path, T_world_lidar: Pose, visible_only: bool) -> Cloud:
    points_world, semantic, visible = _read_window(path)
    offsets = points_world - T_world_lidar[:3, 3]
    kept = np.einsum("ij,ij->i", offsets, offsets) < RADIUS_M**2
    if visible_only:
        kept &= visible
    points_lidar = offsets[kept] @ T_world_lidar[:3, :3]
    nearest = _nearest_in_each_direction(points_lidar)
    cloud = np.zeros((len(nearest), 4), dtype=np.float32)
    cloud[:, :3] = points_lidar[nearest]
    return Cloud(cloud, semantic[kept][nearest])


def _nearest_in_each_direction(points: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Find the points (N, 3) that a LiDAR at the origin would see; indices in ascending order."""
    ranges = np.linalg.norm(points, axis=1)
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    cell = np.radians(CELL_DEG)
    cells = (azimuth // cell).astype(np.int64) * 65536 + (elevation // cell).astype(np.int64)
    order = np.argsort(ranges, kind="stable")
    _, first = np.unique(cells[order], return_index=True)
    return np.sort(order[first])


@lru_cache(maxsize=1)
def _read_window(
    path: Path,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32], npt.NDArray[np.bool_]]:
    """Read points in the world (N, 3), their ids (N,), and whether an image shows them (N,)."""
    vertices = read_vertices(path)
    points = np.stack([vertex_column(path, vertices, axis, np.float64) for axis in "xyz"], axis=1)
    semantic = vertex_column(path, vertices, "semantic", np.int64)
    # -1 means a licence plate, which has no id.
    ids = np.where(semantic < 0, 0, semantic).astype(np.uint32)
    return points, ids, vertex_column(path, vertices, "visible", np.int64) != 0


def _frames(path: Path) -> range:
    found = re.fullmatch(r"(\d+)_(\d+)", path.stem)
    if not found:
        raise InputError(
            f"{path}: found name {path.stem!r}, needed the first and last frame as 0000000002_0000000385"
        )
    return range(int(found.group(1)), int(found.group(2)) + 1)
