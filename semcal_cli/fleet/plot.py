"""The course of a fleet as one picture, for documents and for the eye."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Literal

import numpy as np

from semcal_cli.fleet.course import Axis, Course, Kind, course_of
from semcal_cli.fleet.fleet import Fleet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLES: dict[Kind, tuple[str, str, str]] = {
    "agrees": ("#0072b2", "o", "drives, with 95 % intervals"),
    "disagrees": ("#8a5a00", "s", "drives that disagree"),
    "beyond": ("#b34700", "D", "drives surely beyond what is allowed"),
}
"""Colour, marker and meaning of each kind of drive, the page's own."""
EXPECTED, CHANGED = "#1b1f24", "#5b6470"
MAX_TICKS = 6


def plot_fleet(fleet: Fleet, format: Literal["png", "svg"]) -> bytes:
    """Draw the drives and the rig's pose at their times, relative to the pose at the last drive; 95 % intervals."""
    import matplotlib as mpl

    # The drawing must not depend on the user's settings, on chance (ids in the drawing) or on the clock.
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"svg.hashsalt": "semcal", "svg.fonttype": "path"})
        buffer = io.BytesIO()
        _draw(course_of(fleet)).savefig(
            buffer, format=format, dpi=120, metadata={"Date": None} if format == "svg" else None
        )
    return buffer.getvalue()


def _draw(course: Course) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    all_axes = figure.subplots(3, 2, sharex=True)
    for index, axis in enumerate(course.axes):
        axes = all_axes[index % 3][index // 3]
        _draw_expected(axes, course, axis)
        _draw_drives(axes, course, axis)
        _draw_changes(axes, course, index)
        axes.set_title(f"{axis.name}, {axis.unit}", fontsize=10, loc="left")
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    _name_drives(all_axes[-1], course)
    handles, labels = all_axes[0][0].get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once.keys(), loc="outside upper right", ncols=5, frameon=False)
    return figure


def _draw_expected(axes: Axes, course: Course, axis: Axis) -> None:
    """Draw the rig's pose at each time, part by part, with the allowed range about it."""
    for part in range(int(course.parts[-1]) + 1):
        mine = course.parts == part
        times, expected = course.times[mine], axis.expected[mine]
        axes.plot(times, expected, color=EXPECTED, label="holds then")
        axes.fill_between(
            times,
            expected - axis.allowed,
            expected + axis.allowed,
            color=EXPECTED,
            alpha=0.08,
            linewidth=0.0,
            label="allowed",
        )


def _draw_drives(axes: Axes, course: Course, axis: Axis) -> None:
    """Draw the pose of each drive, with its 95 % interval."""
    for kind, (color, marker, label) in STYLES.items():
        chosen = np.array([each == kind for each in course.kinds])
        if chosen.any():
            axes.errorbar(
                course.times[chosen],
                axis.found[chosen],
                axis.half_widths[chosen],
                fmt=marker,
                markersize=4,
                linewidth=1.0,
                color=color,
                label=label,
            )


def _draw_changes(axes: Axes, course: Course, index: int) -> None:
    """Draw each change as a line with the first drive after it, and its size along this axis."""
    for change in course.changes:
        axes.axvline(change.time, color=CHANGED, linestyle="--", linewidth=1.2)
        text = f"{change.name}: {change.sizes[index]}" if change.sizes[index] else change.name
        axes.annotate(
            text,
            (change.time, 1.0),
            xycoords=axes.get_xaxis_transform(),
            xytext=(3.0, -2.0),
            textcoords="offset points",
            va="top",
            fontsize=8,
            color=CHANGED,
            parse_math=False,
        )


def _name_drives(lowest: list[Axes], course: Course) -> None:
    """Name drives below the lowest drawings: evenly spaced ones, if there is no room for all."""
    chosen = np.unique(np.linspace(0, len(course.labels) - 1, MAX_TICKS).round().astype(int)).tolist()
    for axes in lowest:
        axes.set_xticks(course.times[chosen])
        axes.set_xticklabels([course.labels[i] for i in chosen], fontsize=8, parse_math=False)
        axes.set_xlabel(course.title)
