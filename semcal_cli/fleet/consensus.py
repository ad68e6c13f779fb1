"""The mean of the calibrations of one rig: a robust mean of transforms, weighted by their covariances.

Transforms are compared in local coordinates about a reference (`geometry.twists.local_coordinates`), in which their
covariances are expressed.

The mean is that of a multivariate Student distribution (Lange, Little and Taylor, 1989), which gives outliers a small
weight. Calibrations of one rig scatter by more than their stated errors, because the labels of a drive share errors.
The differences between neighbours in time measure this scatter, since a single change of the rig hardly affects them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2, t as student_t

from semcal_cli.geometry.arrays import Matrices, Pose, Vectors
from semcal_cli.geometry.twists import local_coordinates, pose_at

STUDENT_DOF = 4.0
WIDENING = 1.23
"""Factor from the inverse of the weighted information to the covariance of this mean for normal errors (the sandwich
of an M-estimator: E[w^2 d^2] / 6 divided by the square of E[w + w' d^2 / 3], times E[w]; d^2 is chi-square)."""
MAX_SQUARE = 4.0
"""Limit on the squared difference between neighbours, in variances."""
EFFICIENCY, MEDIAN_EFFICIENCY = 0.6, 0.25
"""Efficiency of the variance of the differences between neighbours, and of their median, relative to the variance about
a known mean."""
FAR_PROBABILITY = 0.0005
"""Probability, on each side, below which a difference is not due to chance and is left out of the scatter."""
NUM_HALVINGS = 80
MAX_ROUNDS = 50
MAX_LAST_STEP = 1e-12
"""Largest entry of the last step, metres and radians, at which the mean has converged."""


class Mean(NamedTuple):
    """A robust mean of transforms."""

    T_camera_lidar: Pose
    covariance: npt.NDArray[np.float64]
    """(6, 6) covariance of (rho, phi) about the mean."""


class ExtraScatter(NamedTuple):
    """The scatter of a series beyond its stated covariances."""

    variances: npt.NDArray[np.float64]
    """(6,) extra variance along each axis."""
    degrees_of_freedom: npt.NDArray[np.float64]
    """(6,) degrees of freedom of the whole scatter, stated and extra together (Satterthwaite)."""


def extra_scatter(series: Vectors, covariances: Matrices) -> ExtraScatter:
    """Estimate the scatter of a series beyond its stated covariances.

    The extra variance makes the differences between neighbours as large as those of a normal distribution. First their
    median is matched, which a minority of wrong drives cannot spoil. Differences that are then too large for chance are
    left out: there a drive is an outlier, or the rig changed. The squares of the others count up to a limit (Huber's
    second proposal, 1964), which uses more of the data than the median does.
    """
    num_differences = len(series) - 1
    if num_differences < 2:
        return ExtraScatter(np.zeros(6), np.ones(6))
    squared = np.diff(series, axis=0) ** 2
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    stated_variances = variances[1:] + variances[:-1]
    median = float(chi2.ppf(0.5, 1))
    first_variances = _solve(stated_variances, squared, lambda squares: np.median(squares, axis=0) - median)
    far = student_t.isf(FAR_PROBABILITY, MEDIAN_EFFICIENCY * num_differences) ** 2
    is_near = np.flatnonzero((squared / (stated_variances + 2.0 * first_variances) < far).all(axis=1))
    if not is_near.size:
        is_near = np.arange(num_differences)
    mean = float(chi2.cdf(MAX_SQUARE, 3) + MAX_SQUARE * chi2.sf(MAX_SQUARE, 1))
    extra = _solve(
        stated_variances[is_near],
        squared[is_near],
        lambda squares: np.minimum(squares, MAX_SQUARE).mean(axis=0) - mean,
    )
    # Even an extra variance of zero is known no better than this number of differences allows; the least share has a
    # square.
    share = np.maximum(extra / (extra + variances.mean(axis=0)), 1e-3)
    return ExtraScatter(extra, np.minimum(EFFICIENCY * len(is_near) / share**2, len(is_near)))


def _solve(
    stated_variances: Vectors,
    squared_differences: Vectors,
    excess: Callable[[Vectors], npt.NDArray[np.float64]],
) -> npt.NDArray[np.float64]:
    """Find the extra variances (6,) at which the excess of the squared differences, in variances, is zero.

    They are zero where the stated variances suffice.
    """
    low, high = np.zeros(6), squared_differences.max(axis=0) * len(squared_differences)
    for _ in range(NUM_HALVINGS):
        middle = 0.5 * (low + high)
        is_too_small = excess(squared_differences / (stated_variances + 2.0 * middle)) > 0.0
        low, high = np.where(is_too_small, middle, low), np.where(is_too_small, high, middle)
    solution: npt.NDArray[np.float64] = 0.5 * (low + high)
    return solution


def robust_mean(poses: Sequence[Pose], covariances: Matrices) -> Mean:
    """Compute the robust mean of transforms.

    Args:
        poses: T_camera_lidar (4, 4) of each.
        covariances: (N, 6, 6) of (rho, phi) of each, including the scatter beyond the stated errors.
    """
    information = np.linalg.inv(covariances)
    # The start is the pose nearest to the medians, which outliers do not move.
    coordinates = local_coordinates(poses, poses[0])
    distances = np.abs(coordinates - np.median(coordinates, axis=0))
    scale = np.maximum(np.median(distances, axis=0), np.finfo(float).eps)
    T = poses[int(np.argmin((distances / scale).sum(axis=1)))]
    for _ in range(MAX_ROUNDS):
        coordinates = local_coordinates(poses, T)
        squared = np.einsum("ni,nij,nj->n", coordinates, information, coordinates)
        weights = (STUDENT_DOF + 6.0) / (STUDENT_DOF + squared)
        normal = np.einsum("n,nij->ij", weights, information)
        step = np.linalg.solve(normal, np.einsum("n,nij,nj->i", weights, information, coordinates))
        T = pose_at(T, step)
        if np.abs(step).max() < MAX_LAST_STEP:
            break
    return Mean(T, WIDENING * np.linalg.inv(normal))
