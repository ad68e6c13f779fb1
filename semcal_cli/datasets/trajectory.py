"""Positions and speeds of a rig, from the poses of a data set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.files.reading import MAX_TABLE_BYTES, read_text
from semcal_cli.formats.values import MAX_WORLD_M, number, parse_numbers

KITTI_PERIOD_S = 0.1
"""Time between two sweeps of KITTI's, KITTI-360's and RELLIS-3D's LiDARs."""


def read_positions(path: Path) -> npt.NDArray[np.float64]:
    """Read the positions (N, 3), metres, from poses of 12 numbers a line, as KITTI odometry writes them.

    Raises:
        InputError: the file does not exist, or a line does not hold 12 numbers.
    """
    lines = [line for line in read_text(path, limit=MAX_TABLE_BYTES).splitlines() if line.strip()]
    return np.array([_position(path, f"line {i}", line) for i, line in enumerate(lines, start=1)]).reshape(
        -1, 3
    )


def _position(path: Path, key: str, line: str) -> list[float]:
    values = parse_numbers(path, key, line, 12)[3::4].tolist()
    return [number(f"{path}: {key}", value, -MAX_WORLD_M, MAX_WORLD_M) for value in values]


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
