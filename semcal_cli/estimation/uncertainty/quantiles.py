"""Quantiles of the squared length of the six estimates of a pose."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from semcal_cli import core

NUM_POSE = 6
"""Number of degrees of freedom of a pose."""


def overall_width(offsets: npt.ArrayLike, half_widths: npt.ArrayLike) -> float:
    """Compute the half width along an offset (3,) from those of the axes (3,); the widest for a zero offset."""
    offset, widths = np.asarray(offsets), np.asarray(half_widths)
    length = np.linalg.norm(offset)
    along = offset / length if length > 0.0 else np.eye(3)[widths.argmax()]
    return float(np.linalg.norm(along * widths))


def joint_quantile(alpha: float, degrees_of_freedom: float, num_poses: int = 1) -> float:
    """Compute the quantile of the squared length of the estimates of poses with individually estimated standard errors.

    Args:
        alpha: Probability that chance exceeds the quantile.
        degrees_of_freedom: Degrees of freedom of the standard errors; with very many, the quantile is chi-square's.
        num_poses: Number of poses, each of six estimates.
    """
    count = NUM_POSE * num_poses
    return count * core.fisher_limit(alpha, count, degrees_of_freedom)


def hotelling_quantile(alpha: float, degrees_of_freedom: float) -> float:
    """Compute the quantile of the squared length of six estimates under a covariance (6, 6) that is a scatter matrix.

    It is that of T squared, p v / (v - p + 1) F(p, v - p + 1) with p = 6 (Hotelling, *The generalization of Student's
    ratio*, 1931).

    Args:
        alpha: Probability that chance exceeds the quantile.
        degrees_of_freedom: Degrees of freedom v of the covariance; with very many, the quantile is chi-square's, and
            with five or fewer it is infinite.
    """
    left = degrees_of_freedom - NUM_POSE + 1
    if left <= 0.0:
        return math.inf
    return NUM_POSE * degrees_of_freedom / left * core.fisher_limit(alpha, NUM_POSE, left)
