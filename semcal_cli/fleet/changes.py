"""Whether a rig has changed: change points in a series of transforms, and a steady drift.

Change points are found by binary segmentation (Scott and Knott, 1974): a series is split where two means explain it
best, if they explain it better than chance does, and then each part again. The gain of a split is the statistic of the
likelihood ratio; the best of n splits of nothing but noise exceeds the quantile of chi squared with six degrees of
freedom at 1 - alpha / n no more often than alpha (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from semcal_cli.fleet.consensus import STUDENT_DOF, Matrices, Vectors

ALPHA = 0.01
MIN_LENGTH = 3
"""Of a part, so that no single calibration is one."""
WINDOW = 5
"""Calibrations whose median says what is usual about then."""


@dataclass(frozen=True)
class Drift:
    """A steady change over the whole series."""

    per_unit: npt.NDArray[np.float64]
    """(6,) of (rho, phi) a unit of time, or a drive."""
    covariance: npt.NDArray[np.float64]
    is_significant: bool


def change_points(series: Vectors, covariances: Matrices) -> list[int]:
    """Find the places, ascending, at which a part of a series begins that differs from the one before."""
    weighted = np.linalg.inv(covariances) * _weights(series, covariances)[:, None, None]
    found: list[int] = []
    parts = [(0, len(series))]
    while parts:
        begin, end = parts.pop()
        split = _split(series[begin:end], weighted[begin:end], len(series))
        if split is not None:
            found.append(begin + split)
            parts += [(begin, begin + split), (begin + split, end)]
    return sorted(found)


def drift(times: npt.NDArray[np.float64], series: Vectors, covariances: Matrices) -> Drift:
    """Fit a straight line by weighted least squares."""
    weighted = np.linalg.inv(covariances) * _weights(series, covariances)[:, None, None]
    total = weighted.sum(0)
    # Times are counted from their weighted mean, per axis alike: slope and level are then hardly correlated.
    share = np.trace(weighted, axis1=1, axis2=2)
    centered = times - np.average(times, weights=share)
    design = np.block(
        [
            [total, np.einsum("n,nij->ij", centered, weighted)],
            [np.einsum("n,nij->ij", centered, weighted), np.einsum("n,nij->ij", centered**2, weighted)],
        ]
    )
    right = np.concatenate(
        [np.einsum("nij,nj->i", weighted, series), np.einsum("n,nij,nj->i", centered, weighted, series)]
    )
    inverse = np.linalg.pinv(design, hermitian=True)
    slope, covariance = (inverse @ right)[6:], inverse[6:, 6:]
    statistic = float(slope @ np.linalg.pinv(covariance, hermitian=True) @ slope)
    return Drift(slope, covariance, bool(statistic > chi2.ppf(1.0 - ALPHA, 6)))


def _split(series: Vectors, weighted: Matrices, num_all: int) -> int | None:
    """The best place to split, if it is better than chance."""
    count = len(series)
    if count < 2 * MIN_LENGTH:
        return None
    information = np.cumsum(weighted, axis=0)
    pull = np.cumsum(np.einsum("nij,nj->ni", weighted, series), axis=0)
    places = np.arange(MIN_LENGTH, count - MIN_LENGTH + 1)
    left, right = information[places - 1], information[-1] - information[places - 1]
    of_left, of_right = pull[places - 1], pull[-1] - pull[places - 1]
    gain = _explained(left, of_left) + _explained(right, of_right)
    gain -= _explained(information[-1:], pull[-1:])
    best = int(np.argmax(gain))
    threshold = chi2.ppf(1.0 - ALPHA / num_all, 6)
    return int(places[best]) if gain[best] > threshold else None


def _explained(information: Matrices, pull: Vectors) -> npt.NDArray[np.float64]:
    """What a weighted mean explains: b^T A^-1 b."""
    explained: npt.NDArray[np.float64] = (pull * np.linalg.solve(information, pull[..., None])[..., 0]).sum(1)
    return explained


def _weights(series: Vectors, covariances: Matrices) -> npt.NDArray[np.float64]:
    """Weights of Student's distribution about what is usual at the time: what lies alone is no change."""
    reach = WINDOW // 2
    padded = np.pad(series, ((reach, reach), (0, 0)), mode="edge")
    usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, WINDOW, axis=0), axis=-1)
    off = series - usual
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariances), off)
    weights: npt.NDArray[np.float64] = np.minimum((STUDENT_DOF + 6.0) / (STUDENT_DOF + squared), 1.0)
    return weights
