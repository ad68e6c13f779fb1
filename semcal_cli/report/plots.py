"""Drawings of curves and of the offsets of frames: positions of lines and ticks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from semcal_cli.assessment.frame_offsets import FrameOffsets
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
FRAMES_BOX = Box(width=640.0, height=220.0, left=46.0, right=628.0, top=12.0, bottom=178.0)
MAX_SPAN_CM, MAX_SPAN_DEG = 50.0, 5.0
"""Largest offset that is drawn; farther ones stand at the edge."""
APART = 0.22, 6.0
"""Largest distance between the bars of two axes: as a share of the width of a frame, and in units of the drawing."""
LETTER = 6.5
"""Width of a letter below the drawing."""
LONGEST_NAME = 14
"""Largest number of letters of a frame's name below the drawing; with longer ones frames are numbered."""


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


@dataclass(frozen=True)
class Bar:
    """Offset of a frame along one axis, with its interval."""

    x: float
    """Abscissa of the offset."""
    y: float
    """Ordinate of the offset."""
    top: float
    """Ordinate of the upper end of the interval."""
    bottom: float
    """Ordinate of the lower end of the interval."""


@dataclass(frozen=True)
class FramesPlot:
    """Offsets of the frames in a drawing of size `FRAMES_BOX`."""

    name: str
    unit: str
    bars: tuple[tuple[Bar, ...], ...]
    """Bars of each axis: those of the frames whose labels determine a pose."""
    steps: tuple[str, ...]
    """Line along the poses of the parts for each axis, as a path; empty if all frames fit one pose."""
    zero: float
    """Ordinate of the result."""
    x_ticks: tuple[tuple[float, str], ...]
    """Abscissas of the frames that are named, and what stands there."""
    y_ticks: tuple[tuple[float, str], ...]
    """Ordinates of the offsets that are named, and what stands there."""


def frames_plots(found: FrameOffsets, names: Sequence[str]) -> list[FramesPlot]:
    """Draw the offsets of frames, whose names are given: of the camera's position, and of its rotation."""
    return [
        _frames_plot("camera centre", "cm", 100.0, MAX_SPAN_CM, slice(0, 3), found, names),
        _frames_plot("rotation", "degrees", 1.0, MAX_SPAN_DEG, slice(3, 6), found, names),
    ]


def _frames_plot(
    name: str,
    unit: str,
    scale: float,
    max_span: float,
    axes: slice,
    found: FrameOffsets,
    names: Sequence[str],
) -> FramesPlot:
    offsets, half_widths, of_parts = (
        scale * each[:, axes] for each in (found.offsets, found.half_widths_95, found.of_parts)
    )
    reach = np.nanmax(np.abs(np.vstack([offsets, of_parts])), initial=0.0)
    wide = np.nanmax(np.abs(offsets) + half_widths, initial=0.0)
    # An interval that is much wider than all offsets does not flatten them.
    span = _rounded_up(min(max(min(wide, 4.0 * reach), reach, 1e-3), max_span))

    def y(offset: float) -> float:
        clipped = min(max(offset, -span), span)
        return round(
            FRAMES_BOX.bottom - (FRAMES_BOX.bottom - FRAMES_BOX.top) * (clipped + span) / (2 * span), 2
        )

    slot = (FRAMES_BOX.right - FRAMES_BOX.left) / len(names)
    middles = [FRAMES_BOX.left + (frame + 0.5) * slot for frame in range(len(names))]
    apart = min(APART[0] * slot, APART[1])
    bars = tuple(
        tuple(
            Bar(round(middles[frame] + (axis - 1) * apart, 2), y(offset), y(offset + half), y(offset - half))
            for frame, (offset, half) in enumerate(
                zip(offsets[:, axis].tolist(), half_widths[:, axis].tolist(), strict=True)
            )
            if math.isfinite(offset)
        )
        for axis in range(3)
    )
    return FramesPlot(
        name=name,
        unit=unit,
        bars=bars,
        steps=tuple(_steps([y(each) for each in of_parts[:, axis].tolist()], slot) for axis in range(3))
        if of_parts.any()
        else (),
        zero=y(0.0),
        x_ticks=_named(middles, names, slot),
        y_ticks=tuple((y(step * span), f"{step * span:.3g}") for step in (-1.0, -0.5, 0.0, 0.5, 1.0)),
    )


def _steps(ordinates: Sequence[float], slot: float) -> str:
    """Path along horizontal lines, one for each stretch of frames with the same ordinate."""
    found = []
    for frame, y in enumerate(ordinates):
        if frame == 0 or y != ordinates[frame - 1]:
            found.append(f"M{FRAMES_BOX.left + frame * slot:.2f},{y}")
        if frame + 1 == len(ordinates) or y != ordinates[frame + 1]:
            found.append(f"H{FRAMES_BOX.left + (frame + 1) * slot:.2f}")
    return "".join(found)


def _named(middles: Sequence[float], names: Sequence[str], slot: float) -> tuple[tuple[float, str], ...]:
    """Name as many frames as have room; long names are replaced by numbers."""
    if max(map(len, names)) > LONGEST_NAME:
        names = [str(number) for number in range(1, len(names) + 1)]
    every = math.ceil((max(map(len, names)) + 1) * LETTER / slot)
    return tuple((round(middles[frame], 2), names[frame]) for frame in range(0, len(names), every))


def _rounded_up(value: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * (1.0 + 1e-9))
