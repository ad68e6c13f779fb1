"""Prints a Markdown table: the time and the peak memory of an import that estimates the motion from the sweeps.

    python tests/benchmarks/odometry_speed.py -o DIR [--sweeps 60] [--sweeps 600] [--points 120000]

Writes recordings of ten sweeps a second into DIR, along three seconds of a synthetic street, there and back again and
again at 1.4 m/s. Needs the extras `bag` and `odometry`.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import rmtree

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from bag_imports import small
from bags import BagWriter
from benchmark import script, seconds_of, table
from moving_street import NUM_SWEEPS, SWEEP_S, MovingStreet

SPEED_M_S = 1.4
"""Slow enough that to turn back is no jump."""


def write(folder: Path, num_sweeps: int, points: int) -> Path:
    """Write a recording. On the way back, time runs backwards through the sweeps."""
    street = MovingStreet(SPEED_M_S, 0.0, seed=1, points=points, width=16)
    records = [street.sweep(index).records() for index in range(NUM_SWEEPS)]

    def sweep(bag: BagWriter, index: int, stamp: int) -> object:
        laps, place = divmod(index, NUM_SWEEPS)
        if laps % 2 == 0:
            return bag.cloud(records[place], stamp)
        back = records[NUM_SWEEPS - 1 - place].copy()
        back["time"] = np.float32(SWEEP_S) - back["time"]
        return bag.cloud(back, stamp)

    return small(folder, "mcap library", num_sweeps, points=sweep)


def row(path: Path, num_sweeps: int) -> tuple[str, ...]:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = seconds_of("import", "bag", path, "-o", path.parent / "drive", "--odometry")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    size, peak_mb = f"{path.stat().st_size / 1e9:.2f}", f"{after.ru_maxrss * 1024 / 1e6:.0f}"
    return str(num_sweeps), f"{num_sweeps * SWEEP_S:.0f}", size, f"{seconds:.1f}", f"{cpu_s:.1f}", peak_mb


def main(*, output: Path, sweeps: tuple[int, ...] = (60, 600), points: int = 120_000) -> Iterator[str]:
    """Print the table, a row for each number of sweeps, which ascend."""

    def rows() -> Iterator[tuple[str, ...]]:
        for num_sweeps in sweeps:
            folder = output / str(num_sweeps)
            yield row(write(folder, num_sweeps, points), num_sweeps)
            rmtree(folder)

    yield from table("sweeps | recording s | GB | import s | CPU s | peak MB", rows())


if __name__ == "__main__":
    script(main)
