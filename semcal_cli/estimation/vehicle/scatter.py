"""Robust means of repeated measurements, and their intervals from the scatter."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.geometry.arrays import Numbers

TRIMMED = 0.2
"""Share of the values that is left out at each end."""
PROBABILITY = 0.975
"""Both tails together leave out 5 %."""
MIN_FOR_CORRELATION = 10
"""Smallest number of values whose correlation is estimated."""
MIN_SIGMAS = 1.64
"""A correlation counts from this many standard errors of that of independent values on, 1 / sqrt(N)."""
MIN_INDEPENDENT = 3.0
"""Neighbours that are nearly alike count as at least so many independent values: the scatter shows some change."""


class Estimate(NamedTuple):
    """A robust mean, and how well it is known."""

    value: float
    half_width_95: float | None
    """Half width of the 95 % interval; None for a single value."""


def trimmed_mean(values: Numbers) -> Estimate:
    """Compute the trimmed mean of values (N,), with Student's interval of Tukey and McLaughlin (1963).

    A part at each end, rounded down, does not count for the mean, and counts as the next value for the variance. If
    successive values are alike, as those of neighbouring frames, they count as fewer.
    """
    ordered, n = np.sort(values), len(values)
    cut = int(TRIMMED * n)
    kept = ordered[cut : n - cut]
    if n < 2:
        return Estimate(float(kept[0]), None)
    winsorised = np.clip(ordered, kept[0], kept[-1])
    # The variance of the trimmed mean is s_w^2 / ((1 - 2 g)^2 N), with g the share that is cut at each end.
    sigma = float(winsorised.std(ddof=1)) * math.sqrt(n) / len(kept)
    share = independent_share(np.clip(values, kept[0], kept[-1]))
    freedom = share * len(kept) - 1.0
    return Estimate(
        float(kept.mean()), sigma / math.sqrt(share) * core.student_quantile(PROBABILITY, freedom)
    )


def independent_share(values: Numbers) -> float:
    """Estimate how many independent values count as much as one of a series (N,), at most 1.

    With a correlation r of neighbours that decays by r for each step, it is (1 - r) / (1 + r).
    """
    off = values - values.mean()
    square = float(off @ off)
    if len(values) < MIN_FOR_CORRELATION or square == 0.0:
        return 1.0
    r = float(off[1:] @ off[:-1]) / square
    if r < MIN_SIGMAS / math.sqrt(len(values)):
        return 1.0
    return max((1.0 - r) / (1.0 + r), MIN_INDEPENDENT / (len(values) - 2 * int(TRIMMED * len(values))))
