"""Statistics of displaced labels: whether labels of all or some frames fit better at another displacement.

Each half of a frame votes for or against a displacement, and its vote decides whether the other half counts. So no half
is chosen by its own fit. The gains of all blocks that count are added up and divided by the root of their summed
squares. If labels fit nothing, blocks gain as often as they lose, and this ratio exceeds z with a probability of at
most exp(-z^2 / 2) (Efron, *Student's t-test under symmetry conditions*, 1969). Labels that are where they belong
lose in nearly all blocks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Fits = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Displaced:
    """The displacement, of those that good labels do not have, at which labels of some frames fit best."""

    candidate: int
    """Index of the displacement."""
    frames: tuple[int, ...]
    """Indices of the frames whose labels fit better there."""
    z: float
    """Gain of the fit in standard errors: divided by the root of the blocks' summed squares."""


def find_displaced(fits: Fits, is_good: npt.NDArray[np.bool_]) -> Displaced:
    """Find the displacement at which labels of all or some frames fit best.

    Args:
        fits: (frames, blocks, displacements) how well labels fit. Even blocks of a frame are one half of it, odd
            ones the other.
        is_good: (displacements,) whether good labels may have this displacement.
    """
    at_best_good = fits[:, :, is_good][:, :, fits[:, :, is_good].sum(axis=(0, 1)).argmax()]
    halves = np.stack([fits[:, half::2].sum(axis=1) for half in (0, 1)], axis=1)
    halves -= np.stack([at_best_good[:, half::2].sum(axis=1) for half in (0, 1)], axis=1)[:, :, None]
    counts = halves[:, ::-1] > 0.0
    best = int(np.where(is_good, -np.inf, np.where(counts, halves, 0.0).sum(axis=(0, 1))).argmax())
    gains = fits[:, :, best] - at_best_good
    counted = np.concatenate([gains[counts[:, half, best], half::2].ravel() for half in (0, 1)])
    spread = math.sqrt(float(np.square(counted).sum()))
    z = float(counted.sum()) / spread if spread > 0.0 else 0.0
    return Displaced(best, tuple(np.flatnonzero(gains.sum(axis=1) > 0.0).tolist()), z)
