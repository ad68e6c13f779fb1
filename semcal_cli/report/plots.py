"""Drawings of curves: positions of lines and ticks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from semcal_cli.report.curves import Curve


class Box(NamedTuple):
    """Size of a drawing, and the positions of its lines."""

    width: float
    """Width of the drawing, in units of the drawing, as all fields are."""
    height: float
    """Height of the drawing."""
    left: float
    """Abscissa of the left end of lines."""
    right: float
    """Abscissa of the right end of lines."""
    top: float
    """Ordinate of the highest value, counted downwards."""
    bottom: float
    """Ordinate of the lowest value."""


BOX = Box(width=320.0, height=200.0, left=46.0, right=308.0, top=12.0, bottom=164.0)
HEADROOM = 0.08
MIN_BAND = 1.5
"""Least width of the drawn interval; a narrower one could not be seen."""


@dataclass(frozen=True)
class Plot:
    """A curve in a drawing of size `BOX`."""

    curve: Curve
    """What is drawn."""
    line: str
    """Points of the line as "x,y x,y" pairs."""
    zero: float
    """Abscissa of the pose."""
    optimum: float
    """Abscissa of the highest point."""
    optimum_text: str
    """Offset of the optimum as text, no finer than the spacing of the samples."""
    band: tuple[float, float] | None
    """Left end and width of the band of two standard errors to either side of the pose."""
    x_ticks: tuple[tuple[float, str], ...]
    """Abscissas of the offsets that are named, and what stands there."""
    y_ticks: tuple[tuple[float, str], ...]
    """Ordinates of the values that are named, and what stands there."""


def plots(curves: Sequence[Curve]) -> list[Plot]:
    """Draw curves with one scale of information, so that sharp and flat ones compare."""
    low = min(float(curve.nats.min()) for curve in curves)
    high = max(float(curve.nats.max()) for curve in curves)
    margin = HEADROOM * (high - low) or 1.0
    return [_plot(curve, low - margin, high + margin) for curve in curves]


def _plot(curve: Curve, low: float, high: float) -> Plot:
    def x(offset: float) -> float:
        return round(BOX.left + (BOX.right - BOX.left) * (offset + curve.span) / (2.0 * curve.span), 2)

    def y(nats: float) -> float:
        return round(BOX.bottom - (BOX.bottom - BOX.top) * (nats - low) / (high - low), 2)

    band = None
    if curve.sigma is not None:
        width = max(x(2.0 * curve.sigma) - x(-2.0 * curve.sigma), MIN_BAND)
        band = round(x(0.0) - width / 2.0, 2), round(width, 2)
    points = zip(curve.offsets.tolist(), curve.nats.tolist(), strict=True)
    # The optimum gets as many digits as the spacing of the samples near the pose has.
    digits = max(0, -math.floor(math.log10(float(np.diff(curve.offsets).min()))))
    decimals = max(2, 1 - math.floor(math.log10(high - low)))
    steps = (-1.0, -0.5, 0.0, 0.5, 1.0)
    levels = (low + share * (high - low) for share in (0.1, 0.5, 0.9))
    return Plot(
        curve=curve,
        line=" ".join(f"{x(offset)},{y(nats)}" for offset, nats in points),
        zero=x(0.0),
        optimum=x(curve.optimum),
        optimum_text=f"{curve.optimum:+.{digits}f}",
        band=band,
        x_ticks=tuple((x(step * curve.span), f"{step * curve.span:.3g}") for step in steps),
        y_ticks=tuple((y(level), f"{level:.{decimals}f}") for level in levels),
    )
