"""The history of a rig: it stays as it is, changes at some times, or drifts.

The Bayesian information criterion chooses the model that explains the drives best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli.fleet.changes import Drift, change_points, drift, misfit
from semcal_cli.fleet.consensus import Matrices, Vectors, robust_mean
from semcal_cli.geometry.twists import local_coordinates, pose_at

MIN_DRIFT_DRIVES = 6
"""Least number of drives that tell a line from chance."""


@dataclass(frozen=True)
class RigHistory:
    """Places of a rig at each drive, in local coordinates."""

    expected: Vectors
    """(N, 6) place of the rig at each drive."""
    covariances: Matrices
    """(N, 6, 6) covariance of the place at each drive."""
    starts: tuple[int, ...] = (0,)
    """Indices of the drives at which parts begin."""
    drift: Drift | None = None


def find_history(
    times: npt.NDArray[np.float64], series: Vectors, covariances: Matrices, degrees_of_freedom: float
) -> RigHistory:
    """Find the model that explains the drives best: no change, changes, or a drift.

    Args:
        times: Times of the drives in any unit, ascending.
        series: (N, 6) local coordinates of the drives.
        covariances: (N, 6, 6) covariance of each drive, including the scatter beyond the stated errors.
        degrees_of_freedom: Degrees of freedom of that scatter.
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
    """Take the robust mean of each part as the place of the rig in it."""
    expected, known = np.zeros_like(series), np.zeros_like(covariances)
    for begin, end in zip(starts, (*starts[1:], len(series)), strict=True):
        # Local coordinates are so small that the rotation of their own frame does not matter.
        poses = [pose_at(np.eye(4), each) for each in series[begin:end]]
        mean = robust_mean(poses, covariances[begin:end])
        expected[begin:end] = local_coordinates([mean.T_camera_lidar], np.eye(4))
        known[begin:end] = mean.covariance
    return RigHistory(expected, known, starts)
