"""KITTI-360's accumulated points: a PLY for some 240 frames, labelled, in world coordinates.

kitti360scripts/evaluation/semantic_3d/README.md: vertices of x y z red green blue semantic instance visible confidence;
`visible` is 0 for points that no picture of the perspective pair shows. Files are named after their frames, as
0000000002_0000000385.ply.
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
from semcal_cli.poses import Pose, inverse

RADIUS_M = 60.0
"""Farther points of a window are left out: walls in between that a LiDAR sees are not all in it."""


class Windows:
    """The windows of a drive."""

    def __init__(self, folder: Path, *, visible_only: bool):
        self._ranges = {_frames(path): path for path in sorted(folder.glob("*.ply"))}
        if not self._ranges:
            raise InputError(f"{folder}: found no windows, needed files as 0000000002_0000000385.ply")
        self._visible_only = visible_only

    def __contains__(self, frame: int) -> bool:
        return any(frame in numbers for numbers in self._ranges)

    def around(self, frame: int, T_world_lidar: Pose) -> Conversion:
        """Cut the points around the LiDAR out of the window in whose middle a frame is."""
        holding = [numbers for numbers in self._ranges if frame in numbers]
        nearest = min(holding, key=lambda numbers: abs(numbers[0] + numbers[-1] - 2 * frame))
        return partial(_cut, self._ranges[nearest], T_world_lidar, self._visible_only)


def _cut(path: Path, T_world_lidar: Pose, visible_only: bool) -> Cloud:
    points_world, semantic, visible = _read_window(path)
    near = np.linalg.norm(points_world - T_world_lidar[:3, 3], axis=1) < RADIUS_M
    kept = near & visible if visible_only else near
    T_lidar_world = inverse(T_world_lidar)
    points = points_world[kept] @ T_lidar_world[:3, :3].T + T_lidar_world[:3, 3]
    cloud = np.zeros((len(points), 4), dtype=np.float32)
    cloud[:, :3] = points
    return Cloud(cloud, semantic[kept])


@lru_cache(maxsize=1)
def _read_window(
    path: Path,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32], npt.NDArray[np.bool_]]:
    """Read points in the world, their ids, and whether a picture shows them."""
    vertices = read_vertices(path)
    points = np.stack([vertex_column(path, vertices, axis, np.float64) for axis in "xyz"], axis=1)
    semantic = vertex_column(path, vertices, "semantic", np.int64)
    # -1 is a licence plate, which has no id.
    ids = np.where(semantic < 0, 0, semantic).astype(np.uint32)
    return points, ids, vertex_column(path, vertices, "visible", np.int64) != 0


def _frames(path: Path) -> range:
    found = re.fullmatch(r"(\d+)_(\d+)", path.stem)
    if not found:
        raise InputError(
            f"{path}: found name {path.stem!r}, needed the first and last frame as 0000000002_0000000385"
        )
    return range(int(found.group(1)), int(found.group(2)) + 1)
