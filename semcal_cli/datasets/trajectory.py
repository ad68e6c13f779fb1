"""Rows of numbers, and positions and speeds of a rig from the poses of a data set."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.files.reading import MAX_TABLE_BYTES, read_text
from semcal_cli.formats.node import MAX_WORLD_M, number, parse_numbers
from semcal_cli.geometry.poses import Vector

KITTI_PERIOD_S = 0.1
"""Time between two sweeps of KITTI's, KITTI-360's and RELLIS-3D's LiDARs."""


def read_rows(path: Path, count: int, *, is_needed: bool = False) -> Iterator[tuple[str, Vector]]:
    """Read the finite numbers (count,) of each line, with the file and the line as messages name them.

    Raises:
        InputError: the file is needed and does not exist, or a line does not hold so many numbers.
    """
    if not is_needed and not path.exists():
        return
    lines = [line for line in read_text(path, limit=MAX_TABLE_BYTES).splitlines() if line.strip()]
    for index, line in enumerate(lines, start=1):
        yield f"{path}: line {index}", parse_numbers(path, f"line {index}", line, count)


def read_speeds(path: Path) -> list[float]:
    """Derive the speeds, metres a second, from poses of 12 numbers a line, one for each sweep of KITTI's period.

    Returns:
        A speed for each line; none if the file does not exist.

    Raises:
        InputError: a line does not hold 12 numbers, or a position is nowhere on Earth.
    """
    positions = [
        [number(where, value, -MAX_WORLD_M, MAX_WORLD_M) for value in row[3::4].tolist()]
        for where, row in read_rows(path, 12)
    ]
    speeds = speeds_mps(np.reshape(positions, (-1, 3)), KITTI_PERIOD_S)
    return [float(speed) for speed in speeds]


def speeds_mps(
    positions: npt.NDArray[np.float64], period_s: float | npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Compute the speed at each position by central differences.

    Args:
        positions: (N, 3) metres.
        period_s: Seconds from each position to the next, one value or (N - 1,).

    Returns:
        (N,) metres a second.
    """
    if len(positions) < 2:
        return np.zeros(len(positions))
    # Two positions at one time give an infinite speed, so they do not count as slow.
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1) / period_s
    speeds: npt.NDArray[np.float64] = 0.5 * (np.append(steps, steps[-1]) + np.insert(steps, 0, steps[0]))
    return speeds
