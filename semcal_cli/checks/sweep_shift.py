"""How far a rig drives from one sweep to the next, seen from the sweeps alone.

What stands above the ground is shifted over the ground until most directions see it at the same range in both sweeps.
The ground itself looks the same from everywhere, and neither poses nor times are needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.geometry.arrays import Matrix, Vector
from semcal_cli.observations.scenes import nearest_ranges, share_alike

MIN_HEIGHT_M = 0.5
"""Smallest height of points that do not count as ground, which slopes and bends."""
OWN_RANGE_M = 2.0
"""Range within which points may lie on the rig itself, which moves along."""
NUM_POINTS = 8_000
"""Number of points that are shifted."""
GRIDS = ((0.25, 12), (0.1, 3), (0.05, 2))
"""Steps, metres, and number of steps to each side, of the grids of shifts, each around the best one before. The first
reaches 3 m, or 30 m/s at 10 sweeps per second."""
MIN_SHARE = 0.5
"""Smallest share of directions with the same range after the best shift. It is 0.51 to 0.75 for consecutive sweeps of
KITTI raw at 7 to 9 m/s and KITTI-360 at 10 m/s, where the shift is right within 5 cm, and at most 0.34 for sweeps of
DDAD a second apart and of different places of KITTI (`tests/benchmarks/clocks.py`)."""
STEP_M = GRIDS[-1][0]
"""Precision of a shift."""


def shifts_m(pairs: Sequence[tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]]) -> list[float | None]:
    """Measure how far the LiDAR moves over the ground between the two sweeps (N, 3) of each pair, metres.

    Returns:
        A distance for each pair; None where it cannot be seen.
    """
    if not pairs:
        return []
    up = core.estimate_up([points for pair in pairs for points in pair])
    if up is None:
        return [None] * len(pairs)
    across = _across(np.asarray(up.direction))
    above = (tuple(_above_ground(points, up) for points in pair) for pair in pairs)
    return [_shift_m(first, second, across) for first, second in above]


def _above_ground(points: npt.NDArray[np.float32], up: core.Up) -> npt.NDArray[np.float32]:
    is_above = points @ np.float32(up.direction) > MIN_HEIGHT_M - up.height_m
    above: npt.NDArray[np.float32] = points[is_above & (np.linalg.norm(points, axis=1) > OWN_RANGE_M)]
    return above


def _across(up: Vector) -> Matrix:
    """Make two unit vectors (2, 3) that span the ground."""
    side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    side /= np.linalg.norm(side)
    return np.array([side, np.cross(up, side)])


def _shift_m(first: npt.NDArray[np.float32], second: npt.NDArray[np.float32], across: Matrix) -> float | None:
    few, seen = first[:: max(len(first) // NUM_POINTS, 1)], nearest_ranges(second)

    def share(shift: Vector) -> float:
        moved = nearest_ranges(few - np.float32(shift @ across))
        return float(share_alike(moved[None], seen)[0])

    best = np.zeros(2)
    highest = share(best)
    for grid in GRIDS:
        for shift in list(_around(best, *grid)):
            if (alike := share(shift)) > highest:
                highest, best = alike, shift
    return float(np.linalg.norm(best)) if highest >= MIN_SHARE else None


def _around(centre: Vector, step_m: float, count: int) -> Iterator[Vector]:
    steps = step_m * np.arange(-count, count + 1)
    return (centre + np.array([x, y]) for x in steps for y in steps)
