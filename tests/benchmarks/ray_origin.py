"""Prints a Markdown table: where rays start, as found from the points of each real drive, and moved ones of KITTI.

python tests/benchmarks/ray_origin.py ../shared/data [--only NAME] [--quarters]

With `--quarters`, the front, left, rear and right quarter of each sweep are searched alone, about the stated place. For
one LiDAR, all of them should start there.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script
from real_data import real_drives

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.estimation.search.ray_origin import find_ray_origin
from semcal_cli.geometry.arrays import Points
from semcal_cli.observations.frame_selection import with_few_frames, with_frames
from semcal_cli.observations.reading import read_clouds

NUM_SWEEPS = 2
MOVED_M = np.array([1.2, -0.3, 1.7], np.float32)
NUM_QUARTERED = 4
QUARTERS = ("front", "left", "rear", "right")
"""In the order of their azimuths, from the x axis."""


def main(data: Path, *, only: tuple[str, ...] = (), quarters: bool = False) -> Iterator[str]:
    """Print the table."""
    if quarters:
        yield from _quarters(data.resolve(), only)
        return
    yield "| drive | x, m | y, m | z, m | jumps seen from 0, by those seen from there |"
    yield "|---|---|---|---|---|"
    with TemporaryDirectory() as folder:
        for name, points in _sweeps(data.resolve(), Path(folder), only):
            found = find_ray_origin(points)
            place = " | ".join(f"{x:.2f}" for x in found.origin_m)
            yield f"| {name} | {place} | {found.roughness_stated / found.roughness:.2f} |"


def _quarters(data: Path, only: tuple[str, ...]) -> Iterator[str]:
    """Print where the rays of each quarter seem to start, from the stated place, together and in each sweep alone."""
    yield "| drive | quarter | x, y, z, m, of all sweeps | farthest of one sweep, m |"
    yield "|---|---|---|---|"
    with TemporaryDirectory() as folder:
        for name, drive in _drives(data, Path(folder), only):
            rays = [drive.rays(cloud.points) for cloud in read_clouds(with_few_frames(drive, NUM_QUARTERED))]
            for index, quarter in enumerate(QUARTERS):
                parts = [sweep[_quarter(sweep) == index] for sweep in rays]
                if not all(map(len, parts)):
                    continue
                place = ", ".join(f"{x:.2f}" for x in find_ray_origin(parts).origin_m)
                farthest = max(np.linalg.norm(find_ray_origin([part]).origin_m) for part in parts)
                yield f"| {name} | {quarter} | {place} | {farthest:.2f} |"


def _quarter(points: Points) -> np.ndarray:
    """Number the quarter (N,) of each point, as in `QUARTERS`."""
    return np.round(np.arctan2(points[:, 1], points[:, 0]) / (np.pi / 2.0)).astype(int) % len(QUARTERS)


def _sweeps(data: Path, folder: Path, only: tuple[str, ...]) -> Iterator[tuple[str, list[Points]]]:
    """Yield the first sweeps of each set of clouds, and those of KITTI object in a frame that was moved."""
    for name, drive in _drives(data, folder, only):
        points = [
            cloud.points for cloud in read_clouds(with_frames(drive, range(len(drive.frames))[:NUM_SWEEPS]))
        ]
        yield name, points
        if name.startswith("KITTI object"):
            yield f"{name}, moved by {MOVED_M.tolist()}", [sweep + MOVED_M for sweep in points]


def _drives(data: Path, folder: Path, only: tuple[str, ...]) -> Iterator[tuple[str, Drive]]:
    """Yield a drive of each set of clouds."""
    seen: set[tuple[str, ...]] = set()
    for real in real_drives(data, folder):
        if only and not any(name in real.name for name in only):
            continue
        drive = read_drive(real.path)
        files = tuple(frame.points for frame in drive.frames)
        if files in seen:
            continue
        seen.add(files)
        yield real.name, drive


if __name__ == "__main__":
    script(main)
