"""Drawings by matplotlib in one style; in a page, the style sheet sets their colours and fonts."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, SOFT, LINE, ACCENT, PAPER = "#1b1f24", "#5b6470", "#dfe3e8", "#0072b2", "#ffffff"
GOOD, BAD, OPEN = "#00795a", "#b34700", "#6b5d00"
AXIS_COLORS = "#d55e00", "#009e73", ACCENT
"""Colours of the axes x, y and z."""
VARIABLES = {
    INK: "--ink",
    SOFT: "--soft",
    LINE: "--line",
    ACCENT: "--accent",
    PAPER: "--paper",
    GOOD: "--good-ink",
    BAD: "--bad-ink",
    OPEN: "--open-ink",
}
"""Variable of the style sheet for each colour, whose value differs in dark mode."""
STYLE: dict[Any, Any] = {
    "font.size": 11.0,
    "text.color": SOFT,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "axes.labelcolor": SOFT,
    "axes.edgecolor": LINE,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": False,
    "axes.formatter.useoffset": False,
    "grid.color": LINE,
    "xtick.bottom": False,
    "ytick.left": False,
    "legend.frameon": False,
    # The output depends neither on chance nor on the clock.
    "svg.hashsalt": "semcal",
}
DPI = 120
POINTS_PER_INCH = 72.0
LEFT, RIGHT, TOP, BOTTOM = 46.0, 16.0, 12.0, 36.0
"""Margins around the axes of a drawing in a page, pixels."""
LETTER_PX = 6.5
"""Width of a letter, pixels."""
NUM_MEASURED = 16
"""Number of names whose width is measured."""
MAX_NAME = 14
"""Largest number of letters of a name that is drawn."""
MIN_GAP_PX = 8.0
"""Minimum gap between names, pixels."""


@dataclass(frozen=True)
class Plot:
    """A drawing for a page."""

    name: str
    svg: Markup
    note: str = ""
    """What it shows, in words."""


def page_svg(
    name: str,
    size: tuple[float, float],
    draw: Callable[[Axes], None],
    top: float = TOP,
    behind: str = "",
) -> Markup:
    """Draw one diagram as an element of a page.

    Artists with a `gid` become a group of that class.

    Args:
        name: What the diagram shows, in words.
        size: Width and height in pixels, which the page may scale.
        draw: Draws on the axes.
        top: Margin above the axes, pixels.
        behind: Elements of SVG behind the diagram.
    """
    width, height = size
    # Ids are hashes of the content: each drawing in a page needs its own salt.
    with _style_context({"svg.fonttype": "none", "svg.hashsalt": name, "path.simplify": False}):
        figure = _figure(width, height)
        lines = (width - LEFT - RIGHT) / width, (height - BOTTOM - top) / height
        axes = figure.add_axes((LEFT / width, BOTTOM / height, *lines), facecolor="none")
        figure.patch.set_visible(False)
        draw(axes)
        text = _save(figure, "svg").decode()
    # The style sheet before the drawing would apply to the whole page, and ids are not used.
    content = text[text.index('<g id="figure_1">') : text.rindex("</svg>")]
    content = re.sub(r'<g id="[^"]*_\d+">', "<g>", content)
    content = re.sub(r'<g id="([a-z]+)">', r'<g class="\1">', content)
    # The page has its own font, and hundredths of a pixel are invisible.
    content = re.sub(r" font-family: [^;]*;", "", content)
    content = re.sub(r' [dxy]="[^"]*"', lambda match: re.sub(r"(\.\d\d)\d+", r"\1", match[0]), content)
    for color, variable in VARIABLES.items():
        content = content.replace(color, f"var({variable})")
    head = f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(name)}">'
    return Markup(f"{head}{behind}\n{content}</svg>")


def figure_file(
    draw: Callable[[Figure], None], size: tuple[float, float], format: Literal["png", "svg"]
) -> bytes:
    """Draw a figure of a size in inches as a separate file."""
    with _style_context({"figure.constrained_layout.use": True, "svg.fonttype": "path"}):
        figure = _figure(*(POINTS_PER_INCH * inches for inches in size))
        draw(figure)
        return _save(figure, format)


def _style_context(more: dict[Any, Any]) -> Any:
    """Return a context in which the user's settings do not change a drawing."""
    import matplotlib as mpl

    return mpl.rc_context({**mpl.rcParamsDefault, **STYLE, **more})


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width / POINTS_PER_INCH, height / POINTS_PER_INCH))


def _save(figure: Figure, format: Literal["png", "svg"]) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=format, dpi=DPI, metadata={"Date": None} if format == "svg" else None)
    return buffer.getvalue()


def draw_intervals(
    axes: Axes,
    x: npt.NDArray[np.float64],
    values: npt.NDArray[np.float64],
    half_widths: npt.NDArray[np.float64],
    color: str,
    *,
    marker: str = "o",
    label: str = "",
    is_crowded: bool = False,
) -> None:
    """Draw values (N,) as dots and their intervals as bars, which are pale where they are crowded.

    The bars are one line with gaps, a tenth of the size of many lines.
    """
    gaps = np.full(len(x), np.nan)
    ends = np.column_stack([values - half_widths, values + half_widths, gaps])
    alpha, size = (0.2, 2.5) if is_crowded else (1.0, 4.5)
    axes.plot(np.column_stack([x, x, gaps]).ravel(), ends.ravel(), color=color, linewidth=1.2, alpha=alpha)
    axes.plot(x, values, color=color, linestyle="none", marker=marker, markersize=size, label=label)


def name_places(axes: Axes, places: npt.NDArray[np.float64], names: Sequence[str]) -> None:
    """Label as many places (N,) along the horizontal axis as fit, including the first and the last."""
    scale = POINTS_PER_INCH / axes.figure.dpi
    middles = scale * axes.transData.transform(np.column_stack([places, places]))[:, 0]
    room = _widest_name_px(axes, places, names) + MIN_GAP_PX
    # The last name ends at its place if it would be cut off.
    is_shifted = middles[-1] + room / 2.0 > scale * axes.figure.bbox.width
    middles[-1] -= room / 2.0 * is_shifted
    targets = np.linspace(middles[0], middles[-1], max(1, int((middles[-1] - middles[0]) / room)) + 1)
    chosen, last = [0], len(names) - 1
    for i in np.abs(middles[None] - targets[1:, None]).argmin(axis=1).tolist():
        if names[i] == names[chosen[-1]]:
            continue
        if middles[i] - middles[chosen[-1]] < room:
            if i != last or len(chosen) == 1:
                continue
            chosen.pop()  # makes room for the last name
        chosen.append(i)
    axes.set_xticks(places[chosen])
    texts = axes.set_xticklabels([names[i] for i in chosen], parse_math=False)
    if is_shifted and chosen[-1] == last:
        texts[-1].set_horizontalalignment("right")


def _widest_name_px(axes: Axes, places: npt.NDArray[np.float64], names: Sequence[str]) -> float:
    """Measure the widest name below the horizontal axis, in pixels, among the longest ones."""
    axes.set_xticks(places[:1])  # another place would widen the axis
    (text,) = axes.set_xticklabels([""], parse_math=False)
    scale, widths = POINTS_PER_INCH / axes.figure.dpi, []
    for name in sorted(set(names), key=len)[-NUM_MEASURED:]:
        text.set_text(name)
        widths.append(scale * text.get_window_extent().width)
    return max(widths)


def short_names(names: Sequence[str]) -> list[str]:
    """Return the names, or numbers from 1 if one is long."""
    return list(names) if max(map(len, names)) <= MAX_NAME else [str(i + 1) for i in range(len(names))]
