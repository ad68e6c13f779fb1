"""How a rig moved, from the poses of a data set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.files.reading import read_text
from semcal_cli.formats.values import MAX_WORLD_M, number, parse_numbers

KITTI_PERIOD_S = 0.1
"""Between the sweeps of KITTI's, KITTI-360's and RELLIS-3D's LiDARs."""


def read_positions(path: Path) -> npt.NDArray[np.float64]:
    """Read the positions (N, 3) of poses of 12 numbers a line, as KITTI odometry writes them.

    Raises:
        InputError: there is no such file, or a line holds something else.
    """
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    return np.array([_position(path, f"line {i}", line) for i, line in enumerate(lines, start=1)]).reshape(
        -1, 3
    )


def _position(path: Path, key: str, line: str) -> list[float]:
    values = parse_numbers(path, key, line, 12)[3::4].tolist()
    return [number(f"{path}: {key}", value, -MAX_WORLD_M, MAX_WORLD_M) for value in values]


def speeds_mps(
    positions: npt.NDArray[np.float64], period_s: float | npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Speed at each position (N, 3), by central differences; `period_s` lies between two of them."""
    if len(positions) < 2:
        return np.zeros(len(positions))
    with np.errstate(divide="ignore", invalid="ignore"):  # two at one time: not a slow place
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1) / period_s
    speeds: npt.NDArray[np.float64] = 0.5 * (np.append(steps, steps[-1]) + np.insert(steps, 0, steps[0]))
    return speeds
