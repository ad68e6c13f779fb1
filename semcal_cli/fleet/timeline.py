"""Plots of a fleet over time: each axis of the camera on its own for the page, or all of them as one image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli.fleet.combination import DAY_S
from semcal_cli.fleet.fleet_result import ComparedDrive, Fleet
from semcal_cli.observations.frame_selection import evenly_spaced
from semcal_cli.report import drawing
from semcal_cli.result.uncertainty import AXIS_NAMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DriveKind: TypeAlias = Literal["agrees", "disagrees", "beyond"]
UNITS = np.array([100.0] * 3 + [1.0] * 3)
"""Factors from metres and degrees to the drawn units, centimetres and degrees."""
NAMES = tuple(f"{name}, {'cm' if i < 3 else 'degrees'}" for i, name in enumerate(AXIS_NAMES))
MAX_DRAWN = 1500
"""Largest number of agreeing drives that are drawn; all other drives are drawn."""
STYLES: dict[DriveKind, tuple[str, str, str]] = {
    "agrees": (drawing.ACCENT, "o", "drives, with 95 % intervals"),
    "disagrees": (drawing.OPEN, "s", "drives that disagree"),
    "beyond": (drawing.BAD, "D", "drives clearly beyond the limits"),
}
"""Colour, marker and meaning of each kind of drive."""
SIZE, IMAGE_SIZE = (340.0, 220.0), (12.0, 8.0)
"""Size of a plot on the page in pixels, and of the image in inches."""
TOP = 30.0
"""Room for two rows of names of changes above a plot on the page, pixels."""
ROW = 13.0
NUM_ROWS = 2
MARGIN = 0.03
"""Margin before the first and after the last drive, relative to the whole time span."""
WIDEST_INTERVAL = 2.0
"""Largest half width of an interval that is drawn in full, relative to the range of all drives or, if that is larger,
to the median half width."""
HEADROOM = 0.06
MIN_RANGE = 0.02
"""Minimum range of the y axis, relative to the limit."""
MAX_SEPARATE = 150
"""Number of drives above which bars overlap."""


class Change(NamedTuple):
    """A change of the rig."""

    time: float
    """Time between the last drive before it and the first after it."""
    name: str
    """Label of the first drive after it."""
    sizes: list[str]
    """Size on each axis in its unit; empty where it may be due to chance."""


@dataclass(frozen=True)
class Timeline:
    """What the plots of a fleet show: poses along and about the camera's axes, centimetres and degrees.

    Poses are relative to the pose at the last drive.
    """

    times: npt.NDArray[np.float64]
    """(N,) times: days since the first drive, or indices of drives."""
    labels: list[str]
    """(N,) labels of the drives on the time axis."""
    title: str
    """Meaning of the labels."""
    kinds: npt.NDArray[np.str_]
    """(N,) kind of each drive."""
    parts: npt.NDArray[np.intp]
    """(N,) part of the history of each drive."""
    poses: npt.NDArray[np.float64]
    """(N, 6) pose of each drive."""
    half_widths: npt.NDArray[np.float64]
    """(N, 6) half widths of the 95 % intervals."""
    expected: npt.NDArray[np.float64]
    """(N, 6) pose of the rig at the time of each drive."""
    allowed: npt.NDArray[np.float64]
    """(6,) largest allowed offset from the expected pose."""
    changes: list[Change]


def make_timeline(fleet: Fleet) -> Timeline:
    """Choose what to draw of a fleet: all drives that disagree, and evenly spaced ones of many others."""
    kinds = [kind_of(drive) for drive in fleet.drives]
    agreeing = evenly_spaced([i for i, kind in enumerate(kinds) if kind == "agrees"], MAX_DRAWN)
    # The line of a part ends where the part does.
    starts = np.flatnonzero(np.diff([drive.part for drive in fleet.drives]))
    ends = {0, len(kinds) - 1, *starts.tolist(), *(starts + 1).tolist()}
    indices = sorted({*agreeing, *ends, *(i for i, kind in enumerate(kinds) if kind != "agrees")})
    drives, names = [fleet.drives[i] for i in indices], _names(fleet)
    expected = UNITS * np.array([drive.expected for drive in drives])
    labels, title = _labels(fleet, drives, [names[i] for i in indices])
    return Timeline(
        times=np.array([drive.time for drive in drives]),
        labels=labels,
        title=title,
        kinds=np.array([kinds[i] for i in indices]),
        parts=np.array([drive.part for drive in drives], np.intp),
        poses=expected + UNITS * np.array([drive.offset.values for drive in drives]),
        half_widths=UNITS * np.array([drive.offset.half_widths for drive in drives]),
        expected=expected,
        allowed=UNITS * np.repeat([fleet.limits.translation_m, fleet.limits.rotation_deg], 3),
        changes=_changes(fleet, names),
    )


def kind_of(drive: ComparedDrive) -> DriveKind:
    """Judge a drive: clearly beyond the limits, disagreeing or possibly beyond them, or neither."""
    if drive.verdict == "fail":
        return "beyond"
    return "disagrees" if drive.disagrees or drive.is_far else "agrees"


def _names(fleet: Fleet) -> list[str]:
    """Name each drive briefly: without the folder that all share, or by its number if names are long."""
    names = [drive.drive.name for drive in fleet.drives]
    folder = names[0].rpartition("/")[0]
    if folder and all(name.rpartition("/")[0] == folder for name in names):
        names = [name.rpartition("/")[2] for name in names]
    return drawing.short_names(names)


def _labels(fleet: Fleet, drives: Sequence[ComparedDrive], names: list[str]) -> tuple[list[str], str]:
    """Label drives with their dates if they are ordered by stamp, or else with their names."""
    if fleet.order == "name":
        return names, "drives, ordered by name"
    stamps = [drive.drive.stamp or 0.0 for drive in drives]
    form = "%Y-%m-%d" if stamps[-1] - stamps[0] > 3.0 * DAY_S else "%m-%d %H:%M"
    try:
        labels = [datetime.fromtimestamp(stamp, timezone.utc).strftime(form) for stamp in stamps]
    except (ValueError, OverflowError, OSError):  # Beyond the year 9999.
        return [f"{drive.time:.4g}" for drive in drives], "days since the first drive"
    return labels, "date" if form == "%Y-%m-%d" else "month, day and time, UTC"


def _changes(fleet: Fleet, names: Sequence[str]) -> list[Change]:
    """Place each change halfway between the drives before and after it."""
    changes, begin = [], 0
    for before, part in pairwise(fleet.parts):
        begin += before.num_drives
        time = 0.5 * (fleet.drives[begin - 1].time + fleet.drives[begin].time)
        assert part.change is not None
        sizes, half_widths = UNITS * part.change.values, UNITS * part.change.half_widths
        texts = [
            f"{size:+.{0 if i < 3 else 2}f}" if abs(size) > half_widths[i] else ""
            for i, size in enumerate(sizes.tolist())
        ]
        changes.append(Change(time, names[begin], texts))
    return changes


def timeline_plots(timeline: Timeline) -> list[drawing.Plot]:
    """Plot the drives along and about each axis for a page."""
    return [
        drawing.Plot(
            name, drawing.page_svg(f"{name}: each drive over time", SIZE, partial(_draw, timeline, i), TOP)
        )
        for i, name in enumerate(NAMES)
    ]


def plot_fleet(fleet: Fleet, format: Literal["png", "svg"]) -> bytes:
    """Plot the drives with 95 % intervals and the rig's pose over time, relative to the pose at the last drive."""
    timeline = make_timeline(fleet)

    def draw(figure: Figure) -> None:
        all_axes = figure.subplots(3, 2).T.ravel()
        for axes, name in zip(all_axes, NAMES, strict=True):
            axes.set_title(name, loc="left", pad=2.0 + ROW * NUM_ROWS * bool(timeline.changes))
        figure.draw_without_rendering()  # names are placed relative to the axes
        for i, axes in enumerate(all_axes):
            _draw(timeline, i, axes)
        handles, labels = all_axes[0].get_legend_handles_labels()
        handle_of_label = dict(zip(labels, handles, strict=True))
        figure.legend(handle_of_label.values(), handle_of_label.keys(), loc="outside upper right", ncols=5)

    return drawing.figure_file(draw, IMAGE_SIZE, format)


def _draw(timeline: Timeline, axis: int, axes: Axes) -> None:
    """Draw one axis of the camera: the rig's pose, the limits about it, the drives, and the changes."""
    margin = MARGIN * float(np.ptp(timeline.times)) or 0.5
    axes.set_xlim(timeline.times[0] - margin, timeline.times[-1] + margin)
    axes.set(ylim=_range(timeline, axis), xlabel=timeline.title)
    axes.locator_params(axis="y", nbins=6)
    axes.grid(visible=False, axis="x")
    for part in range(int(timeline.parts[-1]) + 1):
        is_in_part = timeline.parts == part
        times, expected = timeline.times[is_in_part], timeline.expected[is_in_part, axis]
        times = np.array([times[0] - margin / 2.0, *times, times[-1] + margin / 2.0])
        expected = np.array([expected[0], *expected, expected[-1]])
        low, high = expected - timeline.allowed[axis], expected + timeline.allowed[axis]
        axes.fill_between(times, low, high, color=drawing.INK, alpha=0.08, linewidth=0.0, label="allowed")
        axes.plot(times, expected, color=drawing.INK, linewidth=1.5, label="rig's pose")
    for kind, (color, marker, label) in STYLES.items():
        if (is_of_kind := timeline.kinds == kind).any():
            points = (
                timeline.times[is_of_kind],
                timeline.poses[is_of_kind, axis],
                timeline.half_widths[is_of_kind, axis],
            )
            is_crowded = kind == "agrees" and len(timeline.times) > MAX_SEPARATE
            drawing.draw_intervals(axes, *points, color, marker=marker, label=label, is_crowded=is_crowded)
    _draw_changes(axes, timeline, axis)
    drawing.name_places(axes, timeline.times, timeline.labels)


def _range(timeline: Timeline, axis: int) -> tuple[float, float]:
    """Choose the range of the y axis: all drives and the rig's pose, with wide intervals cut off.

    The limits may reach farther: including them would flatten drives that agree much better than they need to.
    """
    poses, expected = timeline.poses[:, axis], timeline.expected[:, axis]
    span = max(float(np.ptp([*poses, *expected])), MIN_RANGE * float(timeline.allowed[axis]))
    half_widths = timeline.half_widths[:, axis]
    half = np.minimum(half_widths, WIDEST_INTERVAL * max(span, float(np.median(half_widths))))
    low = min(float(expected.min()), float((poses - half).min()))
    high = max(float(expected.max()), float((poses + half).max()))
    margin = HEADROOM * max(high - low, span)
    return low - margin, high + margin


def _draw_changes(axes: Axes, timeline: Timeline, axis: int) -> None:
    """Draw each change as a line, labelled with the first drive after it and its size on this axis.

    Labels are above the axes in two rows; where they would overlap, only the line is drawn.
    """
    box = axes.get_window_extent()
    scale = drawing.POINTS_PER_INCH / axes.figure.dpi
    row_ends = [box.x0 * scale] * NUM_ROWS
    for change in timeline.changes:
        axes.axvline(change.time, color=drawing.SOFT, linestyle="--", linewidth=1.2, gid="change")
        text = f"{change.name}: {change.sizes[axis]}" if change.sizes[axis] else change.name
        x, width = (
            axes.transData.transform((change.time, 0.0))[0] * scale,
            drawing.LETTER_PX * len(text) + 6.0,
        )
        is_left = x + width > box.x1 * scale
        begin = x - width if is_left else x
        row = next((row for row, end in enumerate(row_ends) if begin >= end), None)
        if row is None:
            continue
        row_ends[row] = begin + width
        axes.annotate(
            text,
            (change.time, 1.0),
            xycoords=axes.get_xaxis_transform(),
            xytext=(0.0, 3.0 + ROW * row),
            textcoords="offset points",
            ha="right" if is_left else "left",
            color=drawing.INK,
            parse_math=False,
            annotation_clip=False,
            gid="name",
        )
