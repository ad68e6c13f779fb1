"""The plots of the experiments: errors as dots or boxes in groups, in a style that no user settings change."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from semcal_cli.report.colors import QUALITATIVE_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in QUALITATIVE_COLORS[:7]
)
"""Okabe and Ito's colours, which colour-blind readers can distinguish."""
ACCENT, WRONG = BLUE, VERMILION
"""Colours of semcal's results and of wrong ones."""
INK, GREY = "#222222", "#999999"
"""Colours of medians and text, and of what matters less."""
STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.labelsize": 10.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}
DPI = 120
MULTIPLES = {0.5: tuple(np.arange(1.0, 10.0)), 2.0: (1.0, 2.0, 5.0), np.inf: (1.0,)}
"""Multiples of each power of ten that a logarithmic axis labels, by the largest number of decades that it covers."""
MAX_FOR_DOTS = 30
"""Largest number of values that are drawn one by one, with a tick at their median; more are drawn as a box."""
GROUP_WIDTH = 0.8
"""Total width of the columns of a group; groups are one unit apart."""
SPREAD = 0.6
"""Fraction of a column's width over which its dots are spread."""
GOLDEN_RATIO = 0.618034
"""Horizontal step between dots of neighbouring values, modulo one, so that they seldom cover one another."""


def plot_png(draw: Callable[[], Figure]) -> bytes:
    """Draw a figure in the common style, and encode it as PNG."""
    import matplotlib as mpl

    # The drawing must not depend on the user's settings.
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        buffer = io.BytesIO()
        draw().savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def make_logarithmic(axes: Axes) -> None:
    """Make the y axis logarithmic; ticks are labelled 0.01, 0.1 and 1, and multiples of these where there are few."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.yaxis.get_view_interval()
    decades = np.log10(high / low)
    multiples = next(multiples for max_decades, multiples in MULTIPLES.items() if decades <= max_decades)
    axes.yaxis.set_major_locator(LogLocator(base=10.0, subs=multiples))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
    axes.yaxis.set_minor_formatter(NullFormatter())


def plain_number(value: float) -> str:
    """Write a number without an exponent or trailing zeros."""
    return np.format_float_positional(value, precision=4, fractional=False, trim="-")


def draw_groups(
    axes: Axes, groups: Sequence[Sequence[Sequence[float]]], colors: Mapping[str, str]
) -> list[tuple[float, Sequence[float]]]:
    """Draw a column of dots or a box for each label in each group; infinite errors are left out.

    Args:
        axes: Axes to draw in; groups are at 0, 1, 2 and so on.
        groups: Errors by label, then by group.
        colors: Colour of each label, which is an entry of the legend.

    Returns:
        Position and errors of each column.
    """
    width = GROUP_WIDTH / len(colors)
    columns: list[tuple[float, Sequence[float]]] = []
    for number, ((label, color), label_groups) in enumerate(zip(colors.items(), groups, strict=True)):
        shift = (number - 0.5 * (len(colors) - 1)) * width
        for group, values in enumerate(label_groups):
            _draw_values(axes, values, group + shift, 0.8 * width, color)
            columns.append((group + shift, values))
        axes.plot([], [], "o", color=color, label=label)
    return columns


def _draw_values(axes: Axes, values: Sequence[float], place: float, width: float, color: str) -> None:
    """Draw values one by one, with a tick at their median (failures included), or as a box if there are many."""
    finite = sorted(value for value in values if math.isfinite(value))
    if len(finite) > MAX_FOR_DOTS:
        boxes = axes.boxplot(
            [finite],
            positions=[place],
            widths=width,
            patch_artist=True,
            medianprops={"color": INK, "linewidth": 1.5},
            flierprops={"markersize": 2.5, "markerfacecolor": color, "markeredgecolor": "none"},
            manage_ticks=False,
        )
        boxes["boxes"][0].set(facecolor=color, edgecolor=INK, alpha=0.8)
        return
    steps = [number * GOLDEN_RATIO % 1.0 - 0.5 if len(finite) > 1 else 0.0 for number in range(len(finite))]
    across = [place + SPREAD * width * step for step in steps]
    axes.plot(across, finite, "o", color=color, markersize=3.5, alpha=0.75, markeredgewidth=0.0)
    if values and math.isfinite(median := float(np.median(values))):
        ends = [place - 0.5 * width, place + 0.5 * width]
        axes.plot(ends, [median, median], "-", color=INK, linewidth=1.5)
