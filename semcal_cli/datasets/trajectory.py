"""How a rig moved, from the poses of a data set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.datasets.files import parse_numbers
from semcal_cli.documents import read_text
from semcal_cli.poses import Pose

KITTI_PERIOD_S = 0.1
"""Between the sweeps of KITTI's, KITTI-360's and RELLIS-3D's LiDARs."""


def pose_from_rows(values: npt.NDArray[np.float64]) -> Pose:
    """Make a transform (4, 4) of the 12 numbers of its first three rows."""
    return np.vstack([values.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])


def read_poses(path: Path) -> npt.NDArray[np.float64]:
    """Read poses (N, 4, 4) of 12 numbers a line, as KITTI odometry writes them.

    Raises:
        InputError: there is no such file, or a line holds something else.
    """
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    rows = [parse_numbers(path, f"line {i}", line, 12) for i, line in enumerate(lines, start=1)]
    return np.array([pose_from_rows(row) for row in rows]).reshape(-1, 4, 4)


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
