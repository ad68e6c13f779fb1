"""The style of every plot of an experiment: colours, fonts, grid and ticks, whatever the user's settings are."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from semcal_cli.report.colors import QUALITATIVE_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in QUALITATIVE_COLORS[:7]
)
"""Okabe and Ito's colours, which the colour-blind tell apart."""
ACCENT, WRONG = BLUE, VERMILION
"""Colours of what semcal finds, and of what is wrong."""
INK, GREY = "#222222", "#999999"
"""Colours of medians and texts, and of what matters less."""
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
"""Multiples of each power of ten that are named on a logarithmic axis, by the most decades that it covers."""


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


def make_logarithmic(axes: Axes, direction: Literal["x", "y"]) -> None:
    """Scale drawn values by logarithms; ticks are named 0.01, 0.1 and 1, and where there are few, others, too."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    set_scale, axis = (axes.set_xscale, axes.xaxis) if direction == "x" else (axes.set_yscale, axes.yaxis)
    set_scale("log")
    low, high = axis.get_view_interval()
    decades = np.log10(high / low)
    multiples = next(multiples for most, multiples in MULTIPLES.items() if decades <= most)
    axis.set_major_locator(LogLocator(base=10.0, subs=multiples))
    axis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
    axis.set_minor_formatter(NullFormatter())


def plain_number(value: float) -> str:
    """Write a number without an exponent, and without zeros at its end."""
    return np.format_float_positional(value, precision=4, fractional=False, trim="-")
