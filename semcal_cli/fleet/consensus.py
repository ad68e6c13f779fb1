"""What calibrations of one rig agree on: a robust mean of transforms, weighted by how sure each is.

Transforms are compared in local coordinates about a reference, (rho, phi): a twist on the left to first order, metres
and radians along the camera's axes, in which their covariances are stated. rho moves the centre c, phi turns:

    phi = log(R R_ref^T),   rho = -R_ref (c - c_ref)

The mean is that of a multivariate Student distribution (Lange, Little and Taylor, 1989), whose weights fall for what
lies far off. Calibrations of one rig scatter by more than each says of itself, since labels of one drive err alike. How
much more is told by how much neighbours in time differ, which a rig that changes once hardly alters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from semcal_cli.poses import Pose, camera_center, rotation_difference

Vectors = npt.NDArray[np.float64]
"""(N, 6) local coordinates."""
Matrices = npt.NDArray[np.float64]
"""(N, 6, 6) covariances of them."""

STUDENT_DOF = 4.0
WIDENING = 1.23
"""Of the inverse of the weighted information: makes it the covariance of this mean of normal transforms (the
sandwich of an M-estimator: E[w^2 d^2] / 6 by the square of E[w + w' d^2 / 3], times E[w]; d^2 is chi squared)."""
MAX_SQUARE = 4.0
"""Of a difference of neighbours, in variances."""
EFFICIENCY = 0.6
"""Of the variance of neighbours' differences, beside the variance about a mean that is known."""
MAX_ROUNDS = 50
SETTLED = 1e-12
"""Metres and radians of the last step."""


@dataclass(frozen=True)
class Mean:
    """A robust mean of transforms."""

    T_camera_lidar: Pose
    covariance: npt.NDArray[np.float64]
    """(6, 6) of (rho, phi) about it."""
    weights: npt.NDArray[np.float64]
    """(N,) of each transform, about 1 for those that agree."""


def local_coordinates(poses: Sequence[Pose], T_reference: Pose) -> Vectors:
    """Give (rho, phi) of transforms about a reference."""
    center, R_reference = camera_center(T_reference), T_reference[:3, :3]
    found = [
        np.concatenate([-R_reference @ (camera_center(T) - center), rotation_difference(T, T_reference)])
        for T in poses
    ]
    return np.array(found).reshape(-1, 6)


def moved(T_reference: Pose, coordinates: npt.NDArray[np.float64]) -> Pose:
    """Give the transform that has these local coordinates about a reference."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(coordinates[3:]).as_matrix() @ T_reference[:3, :3]
    T[:3, 3] = -T[:3, :3] @ (camera_center(T_reference) - T_reference[:3, :3].T @ coordinates[:3])
    return T


@dataclass(frozen=True)
class Scatter:
    """By how much a series scatters more than its covariances say."""

    variances: npt.NDArray[np.float64]
    """(6,) along each axis."""
    degrees_of_freedom: npt.NDArray[np.float64]
    """(6,) that the whole scatter is known with, stated and extra together (Satterthwaite)."""


def extra_scatter(series: Vectors, covariances: Matrices) -> Scatter:
    """Tell how much a series scatters beyond what is stated.

    With it, differences of neighbours are as large as a normal distribution's, by Huber's second proposal (1964): their
    squares count up to a limit, so that what lies alone, or a change, counts as little as anything that is far.
    """
    num_differences = len(series) - 1
    if num_differences < 2:
        return Scatter(np.zeros(6), np.ones(6))
    squared = np.diff(series, axis=0) ** 2
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    stated = variances[1:] + variances[:-1]
    mean = float(chi2.cdf(MAX_SQUARE, 3) + MAX_SQUARE * chi2.sf(MAX_SQUARE, 1))
    low, high = np.zeros(6), squared.max(axis=0) / (2.0 * mean) * num_differences
    for _ in range(60):
        middle = 0.5 * (low + high)
        clipped = np.minimum(squared / (stated + 2.0 * middle), MAX_SQUARE)
        is_too_small = clipped.mean(axis=0) > mean
        low, high = np.where(is_too_small, middle, low), np.where(is_too_small, high, middle)
    # Where stated variances are enough, the search ends at nothing.
    found: npt.NDArray[np.float64] = 0.5 * (low + high)
    share = np.maximum(found / (found + variances.mean(axis=0)), np.finfo(float).tiny)
    # That there is none is not known any better than by so many drives.
    return Scatter(found, np.minimum(EFFICIENCY * num_differences / share**2, num_differences))


def robust_mean(poses: Sequence[Pose], covariances: Matrices) -> Mean:
    """Average transforms.

    Args:
        poses: T_camera_lidar (4, 4) of each.
        covariances: (N, 6, 6) of (rho, phi), with what they scatter beyond that.
    """
    information = np.linalg.inv(covariances)
    # From the one that is nearest to the others: a start that outliers do not move.
    T = poses[_medoid(poses)]
    weights = np.ones(len(poses))
    for _ in range(MAX_ROUNDS):
        coordinates = local_coordinates(poses, T)
        squared = np.einsum("ni,nij,nj->n", coordinates, information, coordinates)
        weights = (STUDENT_DOF + 6.0) / (STUDENT_DOF + squared)
        normal = np.einsum("n,nij->ij", weights, information)
        step = np.linalg.solve(normal, np.einsum("n,nij,nj->i", weights, information, coordinates))
        T = moved(T, step)
        if np.abs(step).max() < SETTLED:
            break
    return Mean(T, WIDENING * np.linalg.inv(normal), weights)


def _medoid(poses: Sequence[Pose]) -> int:
    """The one whose rotation and centre are nearest to the medians."""
    coordinates = local_coordinates(poses, poses[0])
    off = np.abs(coordinates - np.median(coordinates, axis=0))
    scale = np.maximum(np.median(off, axis=0), np.finfo(float).eps)
    return int(np.argmin((off / scale).sum(axis=1)))
