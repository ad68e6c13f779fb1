"""Drawings of the report: information around the pose, and the offsets of frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from semcal_cli.assessment.frame_offsets import FrameOffsets
from semcal_cli.report.curves import Curve
from semcal_cli.report.drawing import (
    ACCENT,
    AXIS_COLORS,
    BAD,
    SOFT,
    draw_intervals,
    name_places,
    page_svg,
    short_names,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE, FRAMES_SIZE = (320.0, 200.0), (640.0, 220.0)
HEADROOM = 0.08
MIN_BAND = 0.003
"""Least half width of the drawn interval, as a share of the curve's reach; a narrower one could not be seen."""
MAX_SPANS = 50.0, 5.0
"""Largest offset that is drawn, centimetres and degrees; farther ones stand at the edge."""
LEAST_SPAN = 1e-3
APART = 0.22, 0.01
"""Largest distance between the bars of two axes, as a share of the width of a frame, and of that of all."""


@dataclass(frozen=True)
class Plot:
    """A drawing under its name."""

    name: str
    svg: Markup
    note: str = ""
    """What is read off it, in words."""


def curve_plots(curves: Sequence[Curve]) -> list[Plot]:
    """Draw curves with one scale of information, so that sharp and flat ones compare."""
    low = min(float(curve.nats.min()) for curve in curves)
    high = max(float(curve.nats.max()) for curve in curves)
    margin = HEADROOM * (high - low) or 1.0
    return [_curve_plot(curve, low - margin, high + margin) for curve in curves]


def _curve_plot(curve: Curve, low: float, high: float) -> Plot:
    def draw(axes: Axes) -> None:
        axes.set(xlim=(-curve.span, curve.span), ylim=(low, high), xlabel=curve.unit)
        axes.locator_params(nbins=4)
        if curve.sigma is not None:
            half = max(2.0 * curve.sigma, MIN_BAND * curve.span)
            axes.axvspan(-half, half, color=ACCENT, alpha=0.3, linewidth=0.0, gid="band")
        axes.axvline(0.0, color=SOFT, linestyle=":", linewidth=1.0)
        axes.axvline(curve.optimum, color=BAD, linestyle="--", linewidth=1.0)
        axes.plot(curve.offsets, curve.nats, color=ACCENT, linewidth=2.0)

    # The optimum gets as many digits as the spacing of the samples near the pose has.
    digits = max(0, -math.floor(math.log10(float(np.diff(curve.offsets).min()))))
    note = f"highest near {curve.optimum:+.{digits}f} {curve.unit}"
    if curve.sigma is not None:
        note += f", two standard errors are {2.0 * curve.sigma:.2g} {curve.unit}"
    return Plot(curve.name, page_svg(curve.name, SIZE, draw), note)


def frames_plots(found: FrameOffsets, names: Sequence[str]) -> list[Plot]:
    """Draw the offsets of frames, whose names are given: of the camera's position, and of its rotation."""
    kinds = ("camera centre, cm", "rotation, degrees")
    return [_frames_plot(name, 3 * i, MAX_SPANS[i], found, names) for i, name in enumerate(kinds)]


def _frames_plot(name: str, first: int, max_span: float, found: FrameOffsets, names: Sequence[str]) -> Plot:
    """Draw the offsets along three axes, of which the first is numbered."""
    scale, axis = (1.0 if first else 100.0), slice(first, first + 3)
    offsets, half_widths, of_parts = (
        scale * each[:, axis] for each in (found.offsets, found.half_widths_95, found.of_parts)
    )
    reach = np.nanmax(np.abs(np.vstack([offsets, of_parts])), initial=0.0)
    wide = np.nanmax(np.abs(offsets) + half_widths, initial=0.0)
    # An interval that is much wider than all offsets does not flatten them.
    span = min(max(min(wide, 4.0 * reach), reach, LEAST_SPAN), max_span)
    frames = np.arange(len(names), dtype=np.float64)

    def draw(axes: Axes) -> None:
        axes.set(xlim=(-0.5, len(names) - 0.5), ylim=(-1.05 * span, 1.05 * span), xlabel="frame")
        axes.locator_params(axis="y", nbins=5)
        axes.grid(visible=False, axis="x")
        axes.axhline(0.0, color=SOFT, linestyle=":", linewidth=1.0)
        for i, color in enumerate(AXIS_COLORS):
            if of_parts.any():
                edges = np.append(frames, len(names)) - 0.5
                axes.stairs(of_parts[:, i], edges, baseline=None, color=color, linestyle="--", gid="step")
            shown = np.isfinite(offsets[:, i])
            at = frames[shown] + min(APART[0], APART[1] * len(names)) * (i - 1)
            draw_intervals(axes, at, offsets[shown, i].clip(-span, span), half_widths[shown, i], color)
        name_places(axes, frames, short_names(names))

    return Plot(name, page_svg(f"{name}, frame by frame", FRAMES_SIZE, draw))
