"""The shapes of the cells of space that a sweep fills, and how well its surfaces constrain its position."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from semcal_cli.geometry.arrays import Array, Matrices, Matrix, Points, Vector, Vectors

MIN_SHARE = 0.07
"""Smallest share of a sweep's constraints along any direction. It is 0.04 between endless smooth walls, and 0.12 to
0.24 in KITTI's streets, also in a traffic jam, and in synthetic ones."""
CELL_M, ROUGH_M, MIN_CELL_POINTS = 2.0, 0.1, 8
"""Side of the cells whose shapes are measured, roughness below which a surface is flat, and fewest points of a cell."""


def voxel_keys(points: Vectors | Points, side_m: float) -> Array:
    """Number the voxels of a side, metres, in which points (N, 3) lie: (N,)."""
    keys: Array = np.floor(points / side_m).astype(np.int64) @ [1, 1 << 20, 1 << 40]
    return keys


class CellShapes(NamedTuple):
    """The shapes of the cells with enough points: the normal distributions of the points of each."""

    keys: Array
    """(C,) see `voxel_keys`; ascending."""
    means: Vectors
    """(C, 3) metres."""
    variances: Vectors
    """(C, 3) along the axes, square metres, ascending."""
    axes: Matrices
    """(C, 3, 3) columns."""


def cell_shapes(points: Vectors) -> CellShapes:
    """Measure the shapes of the cells that points (N, 3), metres, fill."""
    centers = (np.floor(points / CELL_M) + 0.5) * CELL_M
    inside = points - centers
    keys, first, cell, counts = np.unique(
        voxel_keys(points, CELL_M), return_index=True, return_inverse=True, return_counts=True
    )
    mean = np.stack([np.bincount(cell, axis) for axis in inside.T], axis=-1) / counts[:, None]
    products = [[np.bincount(cell, a * b) for b in inside.T] for a in inside.T]
    covariances = (
        np.moveaxis(np.array(products), -1, 0) / counts[:, None, None] - mean[:, :, None] * mean[:, None]
    )
    is_full = counts >= MIN_CELL_POINTS
    return CellShapes(keys[is_full], (centers[first] + mean)[is_full], *np.linalg.eigh(covariances[is_full]))


def constraint_shares(
    points: Vectors,
) -> tuple[Vector, Matrix]:
    """Measure how well a sweep constrains its position along each direction.

    A surface constrains it along its normal. All cells with a surface have the same weight; the covariance of their
    points gives their normals. Between two smooth walls, almost no normal points along the walls.

    Args:
        points: (N, 3) metres, LiDAR frame.

    Returns:
        Shares (3,) of the three directions, which sum to 1, the smallest first, and their axes as columns (3, 3);
        zeros and the LiDAR's axes without surfaces.
    """
    _, _, variances, axes = cell_shapes(points)
    is_surface = variances[:, 1] > 2.0 * ROUGH_M**2
    variances, axes = variances[is_surface], axes[is_surface]
    if not len(variances):
        return np.zeros(3), np.eye(3)
    weights = 1.0 / (variances + ROUGH_M**2)
    weights /= weights.sum(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nia,na,nja->ij", axes, weights, axes) / len(weights))
    return values, vectors
