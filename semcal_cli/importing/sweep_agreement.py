"""How far one sweep is from another: the small displacement that puts its points onto the surfaces of the other.

The normal distributions transform (Biber and Strasser, IROS 2003): the points of each cell of space are a normal
distribution, flat where they lie on a surface, and a displacement is found at which the points of the other sweep fit
these distributions best.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from semcal_cli.geometry.arrays import Matrices, Numbers, Points, Pose, Vectors
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.importing.cell_shapes import CELL_M, MIN_SHARE, cell_shapes, constraint_shares, voxel_keys
from semcal_cli.importing.sweep_odometry import RANGES_M

SURFACE_NOISE_M = 0.05
"""Standard deviation that is added to that of a cell's points: twice the range noise of usual LiDARs, 2 to 3 cm."""
FAR = 9.0
"""Squared Mahalanobis distance from which a point does not belong to a cell: three standard deviations."""
MAX_STEPS, SETTLED = 10, 1e-4
"""Largest number of steps, and size of the last one, in metres and radians."""
MAX_POINTS_COMPARED = 10_000
"""Largest number of points of a sweep that are compared."""


class Displacement(NamedTuple):
    """How far a sweep is from the surfaces of another."""

    T: Pose
    """(4, 4) what moves its points onto the surfaces, metres."""
    share_near: float
    """Share of its points on the surfaces after that, along the direction in which it is smallest."""


class Surfaces:
    """The surfaces of a sweep."""

    def __init__(self, points: Points) -> None:
        """Find the surfaces among points (N, 3), metres, as seen from the origin."""
        near: Vectors = _within_reach(points).astype(np.float64)
        self.fix_a_position = bool(constraint_shares(near)[0][0] >= MIN_SHARE)
        """Whether surfaces face all directions. Between endless smooth walls nothing shows a motion along them."""
        self._cells, self._means, variances, axes = cell_shapes(near)
        self._weights = np.einsum("nia,na,nja->nij", axes, 1.0 / (variances + SURFACE_NOISE_M**2), axes)

    def displacement(self, points: Points) -> Displacement | None:
        """Find how far a sweep (N, 3) is from the surfaces, metres, in the same frame; None if it meets too few."""
        chosen = _within_reach(points)
        start = chosen[:: max(len(chosen) // MAX_POINTS_COMPARED, 1)].astype(np.float64)
        T: Pose = np.eye(4)
        for _ in range(MAX_STEPS):
            met = self._met(start, T)
            near = met.weights * (met.far2 < FAR)
            jacobian = np.concatenate(
                [np.broadcast_to(np.eye(3), (len(met.moved), 3, 3)), _turns(met.moved)], axis=2
            )
            weighted = np.einsum("nia,nij,n->naj", jacobian, met.inverses, near)
            information = np.einsum("naj,njb->ab", weighted, jacobian)
            if np.linalg.matrix_rank(information, hermitian=True) < 6:
                return None
            step = np.linalg.solve(information, -np.einsum("naj,nj->a", weighted, met.apart))
            T = apply_twist(T, step)
            if np.abs(step).max() < SETTLED:
                break
        met = self._met(start, T)
        is_near = met.far2 < FAR
        if not is_near.any():
            return None
        _, axes = np.linalg.eigh(np.einsum("nij,n->ij", met.inverses, met.weights))
        along = np.einsum("ia,nij,ja,n->na", axes, met.inverses, axes, met.weights)
        shares = along[is_near].sum(axis=0) / along.sum(axis=0)
        return Displacement(T, float(shares.min()))

    def _met(self, points: Vectors, T: Pose) -> _Met:
        """Move points by T, and find those in cells with a surface."""
        moved = points @ T[:3, :3].T + T[:3, 3]
        keys = voxel_keys(moved, CELL_M)
        cell = np.minimum(np.searchsorted(self._cells, keys), max(len(self._cells) - 1, 0))
        meets = self._cells[cell] == keys if len(self._cells) else np.zeros(len(keys), bool)
        moved, cell = moved[meets], cell[meets]
        apart, inverses = moved - self._means[cell], self._weights[cell]
        return _Met(
            moved,
            apart,
            inverses,
            np.einsum("ni,nij,nj->n", apart, inverses, apart),
            1.0 / np.bincount(cell, minlength=1)[cell],
        )


class _Met(NamedTuple):
    """Points in cells with a surface."""

    moved: Vectors
    apart: Vectors
    """(N, 3) from the mean of the cell."""
    inverses: Matrices
    """(N, 3, 3) inverse covariance of the cell."""
    far2: Numbers
    """(N,) squared Mahalanobis distance."""
    weights: Numbers
    """(N,) all cells have the same weight, so that the near ground does not count for everything."""


def _within_reach(points: Points) -> Points:
    ranges_m = np.linalg.norm(points, axis=1)
    within: Points = points[(ranges_m > RANGES_M[0]) & (ranges_m < RANGES_M[1])]
    return within


def _turns(points: Vectors) -> Matrices:
    """Differentiate points (N, 3) by a rotation: minus the cross matrix of each, (N, 3, 3)."""
    turns = np.zeros((len(points), 3, 3))
    x, y, z = points.T
    turns[:, 0, 1], turns[:, 0, 2], turns[:, 1, 2] = z, -y, x
    turns[:, 1, 0], turns[:, 2, 0], turns[:, 2, 1] = -z, y, -x
    return turns
