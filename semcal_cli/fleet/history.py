"""The history of a rig, which is constant, changes at some times, or drifts.

The Bayesian information criterion chooses the model that explains the drives best.

Change points are found by binary segmentation (Scott and Knott, 1974): a series is split where two means explain it
best, if they explain it better than chance, and then each part is split again. The gain of a split is the likelihood
ratio statistic; for pure noise, the best of n splits exceeds the quantile of its distribution at 1 - alpha / n with a
probability of at most alpha (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.fleet.consensus import STUDENT_DOF, robust_mean
from semcal_cli.geometry.arrays import Matrices, Vectors
from semcal_cli.geometry.twists import local_coordinates, pose_at

ALPHA = 0.01
MIN_LENGTH = 3
"""Minimum number of calibrations between two changes, so that no single calibration counts as a period."""
NUM_ROUNDS = 10
"""Number of rounds that reweight drives by their distance from the line."""
WINDOW = 5
"""Number of calibrations whose median is the usual pose at a time."""
MIN_DRIFT_DRIVES = 6
"""Minimum number of drives that distinguish a line from chance."""


@dataclass(frozen=True)
class RigHistory:
    """Poses of a rig at each drive, in local coordinates."""

    expected: Vectors
    """(N, 6) pose of the rig at each drive."""
    covariances: Matrices
    """(N, 6, 6) covariance of the pose at each drive."""
    starts: tuple[int, ...] = (0,)
    """Indices of the drives at which periods without change begin."""
    drift: Drift | None = None


def find_history(
    times: npt.NDArray[np.float64], series: Vectors, covariances: Matrices, degrees_of_freedom: float
) -> RigHistory:
    """Find the model that explains the drives best: no change, changes, or a drift.

    Args:
        times: Times of the drives, ascending, in any unit.
        series: (N, 6) local coordinates of the drives.
        covariances: (N, 6, 6) covariance of each drive, including the scatter beyond the stated errors.
        degrees_of_freedom: Degrees of freedom of that scatter.
    """
    weighted = np.linalg.inv(covariances) * _weights(series, covariances)[:, None, None]

    def misfit(model: RigHistory, num_parameters: int) -> float:
        """Return the Bayesian information criterion (Schwarz, 1978), with the same weights for all models."""
        residuals = series - model.expected
        squared = float(np.einsum("ni,nij,nj->", residuals, weighted, residuals))
        return squared + num_parameters * float(np.log(len(series)))

    steady = _fit_parts(series, covariances, (0,))
    models = [(misfit(steady, 6), steady)]
    if starts := change_points(series, covariances, degrees_of_freedom):
        steps = _fit_parts(series, covariances, (0, *starts))
        models.append((misfit(steps, 6 * (len(starts) + 1) + len(starts)), steps))
    if len(series) >= MIN_DRIFT_DRIVES:
        line = fit_drift(times, series, covariances, degrees_of_freedom)
        line_covariances = np.array([line.covariance_at(time) for time in times])
        drifting = RigHistory(line.at(times), line_covariances, drift=line)
        models += [(misfit(drifting, 12), drifting)] if line.is_significant else []
    return min(models, key=lambda pair: pair[0])[1]


def _fit_parts(series: Vectors, covariances: Matrices, starts: tuple[int, ...]) -> RigHistory:
    """Take the robust mean of each part as the rig's pose in it."""
    expected, mean_covariances = np.zeros_like(series), np.zeros_like(covariances)
    for begin, end in zip(starts, (*starts[1:], len(series)), strict=True):
        # Local coordinates are small enough that the rotation of their own frame does not matter.
        poses = [pose_at(np.eye(4), coordinates) for coordinates in series[begin:end]]
        mean = robust_mean(poses, covariances[begin:end])
        expected[begin:end] = local_coordinates([mean.T_camera_lidar], np.eye(4))
        mean_covariances[begin:end] = mean.covariance
    return RigHistory(expected, mean_covariances, starts)


@dataclass(frozen=True)
class Drift:
    """A steady change over the whole series: a straight line of (rho, phi) over time."""

    per_unit: npt.NDArray[np.float64]
    """(6,) change of (rho, phi) per unit of time."""
    covariance: npt.NDArray[np.float64]
    """(6, 6) covariance of the change per unit of time."""
    level: npt.NDArray[np.float64]
    """(6,) value at the middle of the series, where it is hardly correlated with the slope."""
    level_covariance: npt.NDArray[np.float64]
    """(6, 6) covariance of the level."""
    middle: float
    is_significant: bool = False

    def at(self, times: npt.NDArray[np.float64]) -> Vectors:
        """Evaluate the line at some times, (N, 6)."""
        return self.level + (times - self.middle)[:, None] * self.per_unit

    def covariance_at(self, time: float) -> npt.NDArray[np.float64]:
        """Return the covariance (6, 6) of the line at a time."""
        covariance: npt.NDArray[np.float64] = (
            self.level_covariance + (time - self.middle) ** 2 * self.covariance
        )
        return covariance


def change_points(series: Vectors, covariances: Matrices, degrees_of_freedom: float) -> list[int]:
    """Find the ascending indices at which the rig changes: each begins a part that differs from the one before.

    Args:
        series: (N, 6) local coordinates, in chronological order.
        covariances: (N, 6, 6) covariance of each, including the scatter beyond the stated errors.
        degrees_of_freedom: Degrees of freedom of that scatter.
    """
    weighted = np.linalg.inv(covariances) * _weights(series, covariances)[:, None, None]
    splits: list[int] = []
    parts = [(0, len(series))]
    while parts:
        begin, end = parts.pop()
        threshold = joint_quantile(ALPHA / len(series), degrees_of_freedom)
        split = _split(series[begin:end], weighted[begin:end], threshold)
        if split is not None:
            splits.append(begin + split)
            parts += [(begin, begin + split), (begin + split, end)]
    return sorted(splits)


def fit_drift(
    times: npt.NDArray[np.float64], series: Vectors, covariances: Matrices, degrees_of_freedom: float
) -> Drift:
    """Fit a straight line robustly; `times` are in any unit, the other arguments are those of `change_points`."""
    information = np.linalg.inv(covariances)
    weights = _weights(series, covariances)
    for _ in range(NUM_ROUNDS):
        line = _fit_line(times, series, information * weights[:, None, None])
        residuals = series - line.at(times)
        weights = _student_weights(np.einsum("ni,nij,nj->n", residuals, information, residuals))
    statistic = float(line.per_unit @ np.linalg.pinv(line.covariance, hermitian=True) @ line.per_unit)
    return replace(line, is_significant=statistic > joint_quantile(ALPHA, degrees_of_freedom))


def _fit_line(times: npt.NDArray[np.float64], series: Vectors, weighted: Matrices) -> Drift:
    total = weighted.sum(0)
    # Counting times from their weighted mean, the same for all axes, nearly decorrelates slope and level.
    middle = float(np.average(times, weights=np.trace(weighted, axis1=1, axis2=2)))
    centered = times - middle
    crossed = np.einsum("n,nij->ij", centered, weighted)
    design = np.block([[total, crossed], [crossed, np.einsum("n,nij->ij", centered**2, weighted)]])
    right = np.concatenate(
        [np.einsum("nij,nj->i", weighted, series), np.einsum("n,nij,nj->i", centered, weighted, series)]
    )
    inverse = np.linalg.pinv(design, hermitian=True)
    solution = inverse @ right
    return Drift(solution[6:], inverse[6:, 6:], solution[:6], inverse[:6, :6], middle)


def _split(series: Vectors, weighted: Matrices, threshold: float) -> int | None:
    """Find the best place to split the series; None if no split explains more than chance."""
    count = len(series)
    if count < 2 * MIN_LENGTH:
        return None
    information = np.cumsum(weighted, axis=0)
    pull = np.cumsum(np.einsum("nij,nj->ni", weighted, series), axis=0)
    places = np.arange(MIN_LENGTH, count - MIN_LENGTH + 1)
    left, right = information[places - 1], information[-1] - information[places - 1]
    left_pull, right_pull = pull[places - 1], pull[-1] - pull[places - 1]
    gain = _explained(left, left_pull) + _explained(right, right_pull)
    gain -= _explained(information[-1:], pull[-1:])
    best = int(np.argmax(gain))
    return int(places[best]) if gain[best] > threshold else None


def _explained(information: Matrices, pull: Vectors) -> npt.NDArray[np.float64]:
    """Compute the part of the squared series that a weighted mean explains: b^T A^-1 b."""
    explained: npt.NDArray[np.float64] = (pull * np.linalg.solve(information, pull[..., None])[..., 0]).sum(1)
    return explained


def _weights(series: Vectors, covariances: Matrices) -> npt.NDArray[np.float64]:
    """Compute Student weights about the usual pose at each time, so that a single outlier is not a change."""
    # At either end, drives share the window of the nearest drive that has a whole window around it.
    count = len(series)
    begins = np.clip(np.arange(count) - WINDOW // 2, 0, max(count - WINDOW, 0))
    medians = np.array([np.median(series[begin : begin + WINDOW], axis=0) for begin in begins])
    deviations = series - medians
    return _student_weights(np.einsum("ni,nij,nj->n", deviations, np.linalg.inv(covariances), deviations))


def _student_weights(squared: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    weights: npt.NDArray[np.float64] = np.minimum((STUDENT_DOF + 6.0) / (STUDENT_DOF + squared), 1.0)
    return weights
