"""The errors of the runs of a group, as dots or boxes of a plot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

import numpy as np

from semcal_cli.experiments.plot_style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEASURES = (("rotation_deg", "rotation error, degrees"), ("camera_center_cm", "camera centre error, cm"))
"""Fields of a result, with the labels of their axes."""
MAX_FOR_DOTS = 30
"""Most values that are drawn one by one, with a tick at their median; a box stands for more."""
GROUP_WIDTH = 0.8
"""Width of the columns of a group together; groups are at a distance of one."""
SPREAD = 0.6
"""Share of a column's width over which its dots are spread."""
GOLDEN_RATIO = 0.618034
"""Step between dots of neighbouring values across their column, modulo one: they seldom cover one another."""

Orientation: TypeAlias = Literal["horizontal", "vertical"]


class Errors(Protocol):
    """The errors of one calibration against the truth."""

    @property
    def rotation_deg(self) -> float:
        """Rotation error; infinite, as the other error is, if the calibration failed."""

    @property
    def camera_center_cm(self) -> float:
        """Distance between the camera centres, centimetres."""


def errors_in_groups(
    results: Mapping[tuple[str, str], Sequence[Errors]],
    measure: str,
    labels: Sequence[str],
    groups: Sequence[str],
) -> list[list[list[float]]]:
    """List the errors as `draw_groups` takes them: by label, then by group.

    Args:
        results: Results by label and group.
        measure: Field of the error, a key of `MEASURES`.
        labels: Labels in order.
        groups: Groups in order; those without results of a label have no errors there.
    """
    return [
        [[getattr(result, measure) for result in results.get((label, group), ())] for group in groups]
        for label in labels
    ]


def draw_groups(
    axes: Axes,
    groups: Sequence[Sequence[Sequence[float]]],
    labels: Sequence[str],
    orientation: Orientation,
    colors: Sequence[str],
) -> list[list[float]]:
    """Draw a column of dots, or a box, for each label in each group; infinite errors are left out.

    Args:
        axes: Axes to draw in; groups are at 0, 1, 2 and so on.
        groups: Errors by label, then by group.
        labels: Entries of the legend.
        orientation: Orientation of the columns.
        colors: Colour of each label.

    Returns:
        Positions of the columns by label, then by group.
    """
    width = GROUP_WIDTH / len(labels)
    places = []
    for number, (label, color, of_label) in enumerate(zip(labels, colors, groups, strict=True)):
        shift = (number - 0.5 * (len(labels) - 1)) * width
        places.append([group + shift for group in range(len(of_label))])
        for place, values in zip(places[-1], of_label, strict=True):
            draw_values(axes, values, place, 0.8 * width, color, orientation)
        axes.plot([], [], "o", color=color, label=label)
    return places


def draw_values(
    axes: Axes,
    values: Sequence[float],
    place: float,
    width: float,
    color: str,
    orientation: Orientation,
    whiskers: float | tuple[float, float] = 1.5,
) -> None:
    """Draw values one by one with a tick at their median, or as a box if they are many.

    Args:
        axes: Axes to draw in.
        values: Values; infinite ones are left out, but count for the median of dots.
        place: Position of the column.
        width: Width of the column.
        color: Colour of the dots or of the box.
        orientation: Orientation of the column.
        whiskers: Reach of a box's whiskers, as matplotlib takes it.
    """
    finite = sorted(value for value in values if math.isfinite(value))
    if len(finite) > MAX_FOR_DOTS:
        boxes = axes.boxplot(
            [finite],
            positions=[place],
            widths=width,
            whis=whiskers,
            orientation=orientation,
            patch_artist=True,
            medianprops={"color": INK, "linewidth": 1.5},
            flierprops={"markersize": 2.5, "markerfacecolor": color, "markeredgecolor": "none"},
            manage_ticks=False,
        )
        boxes["boxes"][0].set(facecolor=color, edgecolor=INK, alpha=0.8)
        return
    steps = [number * GOLDEN_RATIO % 1.0 - 0.5 if len(finite) > 1 else 0.0 for number in range(len(finite))]
    across = [place + SPREAD * width * step for step in steps]
    _plot(
        axes, across, finite, orientation, "o", color=color, markersize=3.5, alpha=0.75, markeredgewidth=0.0
    )
    if values and math.isfinite(median := float(np.median(values))):
        ends = [place - 0.5 * width, place + 0.5 * width]
        _plot(axes, ends, [median, median], orientation, "-", color=INK, linewidth=1.5)


def _plot(
    axes: Axes, across: list[float], along: list[float], orientation: Orientation, *style: str, **more: Any
) -> None:
    axes.plot(*((across, along) if orientation == "vertical" else (along, across)), *style, **more)
