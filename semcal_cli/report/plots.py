"""Curves as drawings: where lines and ticks go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from semcal_cli.report.curves import Curve

WIDTH, HEIGHT = 320, 200
LEFT, RIGHT, TOP, BOTTOM = 46.0, 308.0, 12.0, 164.0
"""Of the lines, within the drawing."""
HEADROOM = 0.08
MIN_BAND = 1.5
"""A narrower interval could not be seen."""


@dataclass(frozen=True)
class Plot:
    """A curve in a drawing of `WIDTH` x `HEIGHT`."""

    curve: Curve
    line: str
    """x,y x,y ..."""
    zero: float
    optimum: float
    band: tuple[float, float] | None
    """Left border and width of two standard errors to either side of the pose."""
    x_ticks: tuple[tuple[float, str], ...]
    y_ticks: tuple[tuple[float, str], ...]


def plots(curves: Sequence[Curve]) -> list[Plot]:
    """Draw curves with one scale of information, so that sharp and flat ones compare."""
    low = min(float(curve.nats.min()) for curve in curves)
    high = max(float(curve.nats.max()) for curve in curves)
    margin = HEADROOM * (high - low) or 1.0
    return [_plot(curve, low - margin, high + margin) for curve in curves]


def _plot(curve: Curve, low: float, high: float) -> Plot:
    def x(offset: float) -> float:
        return round(LEFT + (RIGHT - LEFT) * (offset + curve.span) / (2.0 * curve.span), 2)

    def y(nats: float) -> float:
        return round(BOTTOM - (BOTTOM - TOP) * (nats - low) / (high - low), 2)

    band = None
    if curve.sigma is not None:
        width = max(x(2.0 * curve.sigma) - x(-2.0 * curve.sigma), MIN_BAND)
        band = round(x(0.0) - width / 2.0, 2), round(width, 2)
    points = zip(curve.offsets.tolist(), curve.nats.tolist(), strict=True)
    steps = (-1.0, -0.5, 0.0, 0.5, 1.0)
    levels = (low + share * (high - low) for share in (0.1, 0.5, 0.9))
    return Plot(
        curve=curve,
        line=" ".join(f"{x(offset)},{y(nats)}" for offset, nats in points),
        zero=x(0.0),
        optimum=x(curve.optimum),
        band=band,
        x_ticks=tuple((x(step * curve.span), f"{step * curve.span:g}") for step in steps),
        y_ticks=tuple((y(level), f"{level:.2f}") for level in levels),
    )
