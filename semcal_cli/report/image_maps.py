"""Maps of errors in pixels over the image: one for each range, in the same colours."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np

from semcal_cli.geometry.arrays import Image, Numbers
from semcal_cli.readable import figure as in_digits
from semcal_cli.report.drawing import BOTTOM, INK, LEFT, PAPER, RIGHT, TOP, Plot, figure_file, page_svg
from semcal_cli.report.page_images import data_uri

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    from semcal_cli.result import pixel_errors

WIDTH, MAX_HEIGHT = 358.0, 320.0
"""Size of a map in a page, without its margins, pixels: letters stay legible on a phone."""
SCALE_SIZE = 420.0, 66.0
"""Size of the scale of colours in a page, pixels."""
INCHES, LETTERS_PER_INCH = 6.0, 10.0
"""Width of a map in a file, and number of letters of its title."""
WIDE = 2.0
"""Width of an image over its height from which on maps in a file stand below one another."""
COLORS, ALPHA = "plasma", 0.55
LINE_COLOR, GROUND_COLOR = "#fefefe", "#a0a0a0"
"""Colours of the contours, and of what stands behind the scale in the place of a photograph."""
LABEL_GAP = 3.0
"""Gap around the label of a contour, pixels."""
MAX_BANDS = 8
"""Largest number of bands of colour."""
MIN_SPAN = 0.05, 0.01
"""Smallest range of the scale, relative to the largest error and in pixels."""
COLUMNS, SHARE = 640, Fraction(1, 50)
"""Width of the photograph, and its share of the bytes of all images."""
GREYS = 90.0, 230.0
"""Black and white of the photograph: colours above it keep their brightness."""


def map_plots(maps: Sequence[pixel_errors.PixelMap], photograph: Image | None) -> list[Plot]:
    """Draw maps for a page, over a grey photograph if there is one, and the scale of their colours.

    Args:
        maps: Maps of one image.
        photograph: (H, W) or (H, W, 3).
    """
    levels, (width, height) = _levels(maps), _size(maps[0])
    ground = "" if photograph is None else _picture(photograph, width, height)
    plots = []
    for error_map in maps:
        name = f"{error_map.range_m:g} m away"
        size = LEFT + width + RIGHT, TOP + height + BOTTOM
        draw = partial(_draw, error_map, levels)
        svg = page_svg(f"errors in pixels over the image, {name}", size, draw, behind=ground)
        plots.append(Plot(name, svg, _note(error_map)))
        ground = ground and '<use href="#photograph"/>'
    scale = page_svg("scale of the errors, pixels", SCALE_SIZE, partial(_draw_scale, levels))
    return [*plots, Plot("error, pixels", scale)]


def maps_file(maps: Sequence[pixel_errors.PixelMap], title: str, format: Literal["png", "svg"]) -> bytes:
    """Draw maps of one image, with the scale of their colours, as a separate file."""
    levels, (width, height) = _levels(maps), _size(maps[0])
    is_wide = width > WIDE * height
    num_rows, num_columns = (len(maps), 1) if is_wide else (1, len(maps))
    inches = INCHES if is_wide else 0.7 * INCHES
    size = num_columns * inches + 1.0, num_rows * (inches * height / width + 0.7) + 0.4

    def draw(figure: Figure) -> None:
        all_axes = figure.subplots(num_rows, num_columns, squeeze=False).ravel().tolist()
        for axes, error_map in zip(all_axes, maps, strict=True):
            between = ": " if is_wide else "\n"
            axes.set_title(
                f"{error_map.range_m:g} m away{between}{_note(error_map)}", loc="left", fontsize=9.5
            )
            axes.set_aspect("equal")
            _draw(error_map, levels, axes)
        colorbar = partial(figure.colorbar, ax=all_axes, label="pixels", fraction=0.05, aspect=40.0)
        colorbar(_colors(levels), boundaries=levels, ticks=levels, alpha=ALPHA)
        text = textwrap.fill(title, int(LETTERS_PER_INCH * size[0]))
        figure.suptitle(text, x=0.01, ha="left", fontsize=12.0, parse_math=False)

    return figure_file(draw, size, format)


def _note(error_map: pixel_errors.PixelMap) -> str:
    """Name the errors straight ahead, of the median, and at the worst place."""
    errors_px = {
        "straight ahead": error_map.ahead_px,
        "median": error_map.median_px,
        "worst": error_map.worst_px,
    }
    # Round-off is nothing to read.
    texts = [f"{name} {in_digits(round(px, 3))}" for name, px in errors_px.items() if px is not None]
    return f"{', '.join(texts)} pixels"


def _size(error_map: pixel_errors.PixelMap) -> tuple[float, float]:
    """Return width and height of a map in a page, pixels."""
    aspect = float(error_map.rows[-1] / error_map.columns[-1])
    scale = min(1.0, MAX_HEIGHT / (WIDTH * aspect))
    return scale * WIDTH, scale * WIDTH * aspect


def _levels(maps: Sequence[pixel_errors.PixelMap]) -> Numbers:
    """Choose round errors for the borders of bands of colour, the same in all maps."""
    from matplotlib.ticker import MaxNLocator

    errors = np.concatenate([error_map.errors_px.ravel() for error_map in maps])
    errors = errors[np.isfinite(errors)]
    low, high = float(errors.min(initial=np.inf)), float(errors.max(initial=0.0))
    span = max(high - low, MIN_SPAN[0] * high, MIN_SPAN[1])
    low = max(0.0, min(low, high - span))
    locator = MaxNLocator(MAX_BANDS, steps=[1.0, 2.0, 2.5, 5.0, 10.0])
    return np.asarray(locator.tick_values(low, low + span))


def _colors(levels: Numbers) -> ScalarMappable:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(levels[0], levels[-1]), COLORS)


def _draw(error_map: pixel_errors.PixelMap, levels: Numbers, axes: Axes) -> None:
    """Draw bands of colour with labelled contours between them; places that the lens does not show stay empty."""
    columns, rows = error_map.columns, error_map.rows
    errors = np.ma.masked_invalid(error_map.errors_px)
    axes.set(xlim=columns[[0, -1]], ylim=rows[[-1, 0]], xlabel="u, pixels")
    axes.set_ylabel("v", rotation=0.0, loc="top")
    axes.locator_params(axis="x", nbins=5)
    axes.locator_params(axis="y", nbins=4)
    axes.grid(visible=False)
    axes.contourf(columns, rows, errors, levels, cmap=COLORS, norm=_colors(levels).norm, alpha=ALPHA)
    inner = [level for level in levels.tolist() if errors.min() < level < errors.max()]
    if not inner:
        return
    contours = axes.contour(columns, rows, errors, inner, colors=LINE_COLOR, linewidths=1.0)
    boxes: list[Bbox] = []
    for text in axes.clabel(contours, fmt="%g px", inline=False, colors=INK, fontsize=11.0):
        text.set(rotation=0.0, bbox={"facecolor": PAPER, "edgecolor": "none", "boxstyle": "round,pad=0.15"})
        _move_inside(text, axes)
        box = text.get_window_extent().padded(LABEL_GAP)
        if any(box.overlaps(other) for other in boxes):
            text.remove()
        else:
            boxes.append(box)


def _move_inside(text: Text, axes: Axes) -> None:
    """Move a label that the border of its axes would cut."""
    box, to_screen = axes.get_window_extent(), axes.transData
    half = 0.5 * np.asarray(text.get_window_extent().size) + LABEL_GAP
    middle = np.clip(to_screen.transform(text.get_position()), box.min + half, box.max - half)
    u, v = to_screen.inverted().transform(middle).tolist()
    text.set_position((u, v))


def _draw_scale(levels: Numbers, axes: Axes) -> None:
    axes.set_facecolor(GROUND_COLOR)
    figure = axes.figure
    figure.colorbar(
        _colors(levels), cax=axes, orientation="horizontal", boundaries=levels, ticks=levels, alpha=ALPHA
    )


def _picture(photograph: Image, width: float, height: float) -> str:
    """Make an element behind the axes of a drawing: a photograph in pale grey."""
    grey = photograph if photograph.ndim == 2 else cv2.cvtColor(photograph, cv2.COLOR_BGR2GRAY)
    columns = min(COLUMNS, grey.shape[1])
    size = columns, max(1, round(columns * grey.shape[0] / grey.shape[1]))
    small = np.interp(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), (0.0, 255.0), GREYS)
    uri = data_uri(np.repeat(np.asarray(small, np.uint8)[..., None], 3, axis=2), SHARE)
    place = f'x="{LEFT:g}" y="{TOP:g}" width="{width:.2f}" height="{height:.2f}" preserveAspectRatio="none"'
    return f'<image id="photograph" {place} href="{uri}"/>'
