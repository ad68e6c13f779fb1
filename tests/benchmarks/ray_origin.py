"""Prints a Markdown table: where rays start, as found from the points of each real drive, and moved ones of KITTI.

python tests/benchmarks/ray_origin.py ../shared/data [--only NAME]
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script
from real_data import real_drives

from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.search.ray_origin import find_ray_origin
from semcal_cli.geometry.arrays import Points
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.reading import read_clouds

NUM_SWEEPS = 2
MOVED_M = np.array([1.2, -0.3, 1.7], np.float32)


def main(data: Path, *, only: tuple[str, ...] = ()) -> Iterator[str]:
    """Print the table."""
    yield "| drive | x, m | y, m | z, m | jumps seen from 0, by those seen from there |"
    yield "|---|---|---|---|---|"
    with TemporaryDirectory() as folder:
        for name, points in _sweeps(data.resolve(), Path(folder), only):
            found = find_ray_origin(points)
            place = " | ".join(f"{x:.2f}" for x in found.origin_m)
            yield f"| {name} | {place} | {found.roughness_stated / found.roughness:.2f} |"


def _sweeps(data: Path, folder: Path, only: tuple[str, ...]) -> Iterator[tuple[str, list[Points]]]:
    """Yield the first sweeps of each set of clouds, and those of KITTI object in a frame that was moved."""
    seen: set[tuple[str, ...]] = set()
    for real in real_drives(data, folder):
        if only and not any(name in real.name for name in only):
            continue
        drive = read_drive(real.path)
        files = tuple(frame.points for frame in drive.frames)
        if files in seen:
            continue
        seen.add(files)
        points = [
            cloud.points for cloud in read_clouds(with_frames(drive, range(len(drive.frames))[:NUM_SWEEPS]))
        ]
        yield real.name, points
        if real.name.startswith("KITTI object"):
            yield f"{real.name}, moved by {MOVED_M.tolist()}", [sweep + MOVED_M for sweep in points]


if __name__ == "__main__":
    script(main)
