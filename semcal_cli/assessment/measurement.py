"""What labels measure: the place of their optimum, along the directions in which the mutual information curves.

Directions in which it does not curve carry no information of the labels, so that what is known otherwise decides there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli.assessment.sensitivity import Matrix, Scatter, Sensitivity, bending

LEAST_SPREAD = 1e-12
"""Smallest variance along a direction, as a share of that of a measurement alone. Less is rounding."""
MANY = 1e6
"""Degrees of freedom of what is known exactly."""


class Measurement(NamedTuple):
    """Measurement of n variables by the labels: `reads @ change` is normal with this mean and covariance."""

    reads: Matrix
    """(k, n) directions in which the mutual information curves."""
    scatter: Scatter
    """Scatter of the data along these directions."""
    mean: npt.NDArray[np.float64]
    """(k,) mean."""
    covariance: Matrix
    """(k, k) covariance."""
    systematic: Matrix | None = None
    """(k, k) part of the covariance that systematic errors add, which all frames share; None without them."""

    @property
    def information(self) -> Matrix:
        """Information (n, n) about a change, 0 in directions that are not measured."""
        return np.asarray(self.reads.T @ self._weight @ self.reads)

    @property
    def _weight(self) -> Matrix:
        """Inverse (k, k) of the covariance; nothing along directions in which too few parts scatter to tell it."""
        scale = np.sqrt(np.diag(self.covariance))
        scale = np.where(scale > 0.0, scale, np.inf)
        spreads, directions = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        is_known = spreads > LEAST_SPREAD
        basis = directions[:, is_known] / scale[:, None]
        return np.asarray(basis / spreads[is_known] @ basis.T)

    def systematic_part(self, covariance: Matrix) -> Matrix | None:
        """Compute the part (n, n) of a covariance (n, n) to which labels contribute that systematic errors make."""
        if self.systematic is None:
            return None
        gain = self._weight @ self.reads @ covariance
        return np.asarray(gain.T @ self.systematic @ gain)

    def degrees_of_freedom(self, covariance: Matrix) -> npt.NDArray[np.float64]:
        """Compute Satterthwaite's degrees of freedom (n,) of a covariance (n, n) to which labels contribute.

        Only the scatter of the labels is estimated.
        """
        of_labels = covariance @ self.information @ covariance
        if (systematic := self.systematic_part(covariance)) is not None:
            of_labels = of_labels - systematic
        share = np.diag(of_labels) / np.maximum(np.diag(covariance), np.finfo(float).tiny)
        estimated = self.scatter.along(self._weight @ self.reads @ covariance).degrees_of_freedom
        return np.asarray(np.clip(estimated / np.maximum(share, 1e-3) ** 2, 1.0, MANY))


def sum_of(*parts: Matrix | None) -> Matrix | None:
    """Add covariances (n, n) of errors that do not depend on one another; None if there are none."""
    known = [part for part in parts if part is not None]
    return np.asarray(np.sum(known, axis=0)) if known else None


def no_information(count: int) -> Measurement:
    """Make the measurement of `count` variables by labels without information."""
    nothing = np.zeros((0, 0))
    scatter = Scatter(np.zeros((1, 0)), np.ones(1), nothing, np.zeros((1, 0)), nothing)
    return Measurement(np.zeros((0, count)), scatter, np.zeros(0), nothing)


def measure(around: Sensitivity, systematic: Matrix | None = None) -> Measurement:
    """Measure the optimum of the labels.

    Args:
        around: Curvature and scores of the mutual information around the variables.
        systematic: (n, n) covariance that systematic errors add, such as stated ones of the intrinsics.
    """
    scale, bends, directions = bending(around.curvature, around.motions)
    if not around.has_scatter:
        return no_information(len(scale))
    influence = scale[:, None] * directions / bends
    scatter = around.scatter(influence)
    reads = (directions / scale[:, None]).T
    mean, covariance = around.scores.sum(axis=0) @ influence, scatter.covariance
    labels = Measurement(reads, scatter, mean, covariance)
    if systematic is None:
        return labels
    along = labels.reads @ systematic @ labels.reads.T
    return labels._replace(covariance=covariance + along, systematic=along)
