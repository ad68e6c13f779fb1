"""The distribution of errors over the runs of a group: in numbers, in a table, and as boxes of a plot."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, Protocol, TypeVar

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

MEASURES = (("rotation_deg", "rotation error, degrees"), ("camera_center_cm", "camera centre error, cm"))
"""Fields of a result, with the labels of their axes."""
ERROR_COLUMNS = "rotation, deg: median, 95 %, worst | camera centre, cm: median, 95 %, worst"
"""Header of the table columns that `error_cells` fills."""
MIN_FOR_BOX = 8
"""Least number of errors that a box stands for; fewer are drawn as points."""
GROUP_WIDTH = 0.8
"""Width of the boxes of a group together; groups are at a distance of one."""

Result = TypeVar("Result")
Key = TypeVar("Key", bound=Hashable)


class Errors(Protocol):
    """The errors of one calibration against the truth."""

    @property
    def rotation_deg(self) -> float:
        """Rotation error; infinite, as the other error is, if the calibration failed."""

    @property
    def camera_center_cm(self) -> float:
        """Distance between the camera centres, centimetres."""


class ErrorDistribution(Protocol):
    """Median, 95 % quantile and worst of both errors."""

    @property
    def rotation_deg(self) -> tuple[float, float, float]:
        """Distribution of the rotation error, degrees."""

    @property
    def camera_center_cm(self) -> tuple[float, float, float]:
        """Distribution of the camera centre's error, centimetres."""


def grouped(results: Iterable[Result], key: Callable[[Result], Key]) -> dict[Key, list[Result]]:
    """Group results by a key, in the order of the results."""
    groups: dict[Key, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return groups


def distribution(values: Sequence[float]) -> tuple[float, float, float]:
    """Median, 95 % quantile and worst of errors."""
    # Quantiles are not interpolated, since a value may be infinite.
    quantile = np.quantile(values, 0.95, method="higher")
    return float(np.median(values)), float(quantile), max(values)


def error_distributions(
    results: Sequence[Errors],
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Distributions of the rotation error, degrees, and of the camera centre's error, centimetres."""
    return distribution([r.rotation_deg for r in results]), distribution(
        [r.camera_center_cm for r in results]
    )


def error_cells(summary: ErrorDistribution) -> tuple[str, str]:
    """Format the cells of `ERROR_COLUMNS`."""
    rotation = ", ".join(f"{x:.4f}" for x in summary.rotation_deg)
    return rotation, ", ".join(f"{x:.2f}" for x in summary.camera_center_cm)


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
    orientation: Literal["horizontal", "vertical"],
    colors: Sequence[str] | None = None,
) -> list[list[float]]:
    """Draw a box for each label in each group, or points where there are few errors; infinite ones are left out.

    Args:
        axes: Axes to draw in; groups are at 0, 1, 2 and so on.
        groups: Errors by label, then by group.
        labels: Entries of the legend.
        orientation: Orientation of the boxes.
        colors: Colour of each label; None takes those of matplotlib's cycle.

    Returns:
        Positions of the boxes by label, then by group.
    """
    width = GROUP_WIDTH / len(labels)
    places = []
    for number, (label, of_label) in enumerate(zip(labels, groups, strict=True)):
        color = f"C{number}" if colors is None else colors[number]
        shift = (number - 0.5 * (len(labels) - 1)) * width
        places.append([group + shift for group in range(len(of_label))])
        finite = [[value for value in values if math.isfinite(value)] for values in of_label]
        for place, values in zip(places[-1], finite, strict=True):
            if len(values) >= MIN_FOR_BOX:
                boxes = axes.boxplot(
                    [values],
                    positions=[place],
                    widths=0.8 * width,
                    orientation=orientation,
                    patch_artist=True,
                    medianprops={"color": "black"},
                    flierprops={"markersize": 3},
                    manage_ticks=False,
                )
                boxes["boxes"][0].set_facecolor(color)
            else:
                along = [place] * len(values)
                xy = (along, values) if orientation == "vertical" else (values, along)
                axes.plot(*xy, "o", color=color, markersize=4, markeredgecolor="black", markeredgewidth=0.5)
        axes.plot([], [], "s", color=color, markeredgecolor="black", label=label)
    return places


def set_readable_log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis by decades as 0.01, 0.1, 1 and so on."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(base=10.0))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
