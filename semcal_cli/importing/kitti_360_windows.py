"""KITTI-360's accumulated points: labelled PLY files in world coordinates, one per about 240 frames.

kitti360scripts/evaluation/semantic_3d/README.md: vertices have x y z red green blue semantic instance visible
confidence; `visible` is 0 for points that no image of the perspective pair shows. Files are named after their first and
last frame, such as 0000000002_0000000385.ply. The core's reader of clouds skips the column `visible`; this one reads
it, from files like KITTI-360's alone: vertices first, no lists (Turk, *The PLY Polygon File Format*, 1994).
"""

from __future__ import annotations

import re
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError, counted, listed
from semcal_cli.files.input_files import read_bytes, read_start
from semcal_cli.geometry.arrays import Array, Mask, Pose, Vectors
from semcal_cli.importing.recording import Cloud, Conversion

RADIUS_M = 60.0
"""Largest distance from the LiDAR at which a point is kept."""
CELL_DEG = 0.2
"""Angular size of a cell. Only the nearest point in a cell is kept: farther ones were seen from other places and are
hidden from here."""
MAX_HEADER = 65536
MAX_BYTES = 512 << 20
"""Largest size of a PLY file."""
BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4)},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
"""NumPy's names of PLY's types."""


class Windows:
    """All windows of accumulated points of a drive."""

    def __init__(self, folder: Path, *, visible_only: bool):
        self.folder = folder
        self._ranges = {_frames(path): path for path in sorted(folder.glob("*.ply"))}
        if not self._ranges:
            raise InputError(f"{folder}: found no windows, expected files such as 0000000002_0000000385.ply")
        self._visible_only = visible_only

    def __contains__(self, frame: int) -> bool:
        return any(frame in numbers for numbers in self._ranges)

    def around(self, frame: int, T_world_lidar: Pose) -> Conversion:
        """Cut the points around the LiDAR out of a window.

        Args:
            frame: Number of the frame. If two windows hold it, the one whose middle is nearer is used.
            T_world_lidar: (4, 4), metres.
        """
        containing = [numbers for numbers in self._ranges if frame in numbers]
        nearest = min(containing, key=lambda numbers: abs(numbers[0] + numbers[-1] - 2 * frame))
        cut = partial(_cut, self._ranges[nearest], T_world_lidar, self._visible_only)
        return Conversion(cut, has_labels=True, file=self._ranges[nearest], in_order=False)


def _cut(path: Path, T_world_lidar: Pose, visible_only: bool) -> Cloud:
    points_world, semantic, visible = _read_window(path)
    offsets = points_world - T_world_lidar[:3, 3]
    mask = np.einsum("ij,ij->i", offsets, offsets) < RADIUS_M**2
    if visible_only:
        mask &= visible
    points_lidar = offsets[mask] @ T_world_lidar[:3, :3]
    nearest = _nearest_in_each_direction(points_lidar)
    cloud = np.zeros((len(nearest), 4), dtype=np.float32)
    cloud[:, :3] = points_lidar[nearest]
    return Cloud(cloud, semantic[mask][nearest])


def _nearest_in_each_direction(points: Vectors) -> npt.NDArray[np.int64]:
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
) -> tuple[Vectors, npt.NDArray[np.uint32], Mask]:
    """Read points in the world (N, 3), their ids (N,), and whether an image shows them (N,)."""
    vertices = read_vertices(path)
    names = vertices.dtype.names or ()
    if missing := [name for name in (*"xyz", "semantic", "visible") if name not in names]:
        raise InputError(f"{path}: found properties {listed(names)}, expected {missing[0]}")
    points = np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=1)
    # -1 means a licence plate, which has no id.
    ids = np.maximum(vertices["semantic"].astype(np.int64), 0).astype(np.uint32)
    return points, ids, vertices["visible"].astype(np.int64) != 0


def _frames(path: Path) -> range:
    match = re.fullmatch(r"(\d+)_(\d+)", path.stem)
    if not match:
        raise InputError(
            f"{path}: found name {path.stem!r}, expected the first and last frame, such as 0000000002_0000000385"
        )
    return range(int(match.group(1)), int(match.group(2)) + 1)


def read_vertices(path: Path) -> Array:
    """Read the vertices as a structured array (N,).

    Raises:
        InputError: the file does not exist, is too short, or does not begin with vertices of plain numbers.
    """
    start = read_start(path, MAX_HEADER)
    end = re.search(rb"\nend_header\r?\n", start)
    if not start.startswith(b"ply") or not end:
        raise InputError(f"{path}: found no PLY header")
    count, dtype = _parse_header(path, start[: end.start()].decode("latin-1").splitlines())
    body = memoryview(read_bytes(path, limit=MAX_BYTES))[end.end() :]
    if count * dtype.itemsize > len(body):
        raise InputError(
            f"{path}: found {counted(len(body), 'byte')} after the header, needed {count:,} vertices"
        )
    return np.frombuffer(body, dtype, count)


def _parse_header(path: Path, lines: list[str]) -> tuple[int, np.dtype[Any]]:
    """Read the count and the layout of the vertices."""
    words = [line.split() for line in lines[1:]]
    form = next((line[1] for line in words if line[:1] == ["format"] and len(line) == 3), "none")
    if form not in BYTE_ORDERS:
        raise InputError(f"{path}: found format {form[:40]}, expected one of: {', '.join(BYTE_ORDERS)}")
    elements = [index for index, line in enumerate(words) if line[:1] == ["element"]]
    first = words[elements[0]] if elements else []
    if len(first) != 3 or first[1] != "vertex" or not first[2].isascii() or not first[2].isdigit():
        raise InputError(
            f"{path}: found first element {' '.join(first[1:])[:40] or 'none'}, expected vertex and a count"
        )
    last = elements[1] if len(elements) > 1 else len(words)
    properties = [line for line in words[elements[0] : last] if line[:1] == ["property"]]
    if not properties or any(len(line) != 3 or line[1] not in TYPES for line in properties):
        raise InputError(f"{path}: found vertices without properties or with lists, expected plain numbers")
    names = [line[2] for line in properties]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: found a property twice in {listed(names)}, expected each once")
    return (
        int(first[2][:18]),
        np.dtype([(n, BYTE_ORDERS[form] + TYPES[p[1]]) for n, p in zip(names, properties, strict=True)]),
    )
