"""How a rig went: it stays as it is, changes now and then, or drifts.

Which of the three explains the drives best is told by the Bayesian information criterion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli.fleet.changes import Drift, change_points, drift, misfit
from semcal_cli.fleet.consensus import Matrices, Vectors, robust_mean
from semcal_cli.geometry.twists import local_coordinates, pose_at

MIN_DRIFT_DRIVES = 6
"""Fewer do not tell a line from chance."""


@dataclass(frozen=True)
class RigHistory:
    """Where a rig was at each drive, in local coordinates."""

    expected: Vectors
    """(N, 6) at each drive."""
    covariances: Matrices
    """(N, 6, 6) of that."""
    starts: tuple[int, ...] = (0,)
    """Where parts begin."""
    drift: Drift | None = None


def find_history(
    times: npt.NDArray[np.float64], series: Vectors, covariances: Matrices, degrees_of_freedom: float
) -> RigHistory:
    """Find what explains the drives best: nothing happened, changes, or a drift.

    Args:
        times: In any unit, ascending.
        series: Local coordinates of the drives.
        covariances: Of each, with what they scatter beyond what they say.
        degrees_of_freedom: That this scatter is known with.
    """
    steady = _in_parts(series, covariances, (0,))
    found = [(misfit(series, steady.expected, covariances, 6), steady)]
    if starts := change_points(series, covariances, degrees_of_freedom):
        steps = _in_parts(series, covariances, (0, *starts))
        num_parameters = 6 * (len(starts) + 1) + len(starts)
        found.append((misfit(series, steps.expected, covariances, num_parameters), steps))
    line = drift(times, series, covariances, degrees_of_freedom) if len(series) >= MIN_DRIFT_DRIVES else None
    if line is not None and line.is_significant:
        along = np.array([line.covariance_at(time) for time in times])
        drifting = RigHistory(line.at(times), along, drift=line)
        found.append((misfit(series, drifting.expected, covariances, 12), drifting))
    return min(found, key=lambda pair: pair[0])[1]


def _in_parts(series: Vectors, covariances: Matrices, starts: tuple[int, ...]) -> RigHistory:
    """Take the robust mean of each part for what holds in it."""
    expected, known = np.zeros_like(series), np.zeros_like(covariances)
    for begin, end in zip(starts, (*starts[1:], len(series)), strict=True):
        # Local coordinates are far smaller than what would make their own frame matter.
        poses = [pose_at(np.eye(4), each) for each in series[begin:end]]
        mean = robust_mean(poses, covariances[begin:end])
        expected[begin:end] = local_coordinates([mean.T_camera_lidar], np.eye(4))
        known[begin:end] = mean.covariance
    return RigHistory(expected, known, starts)
