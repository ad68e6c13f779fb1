"""The course of a fleet as six small drawings of the page: positions of lines, dots and labels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from semcal_cli.fleet.course import Axis, Course, Kind
from semcal_cli.report.plots import LETTER, Box

BOX = Box(width=340.0, height=220.0, left=46.0, right=330.0, top=30.0, bottom=188.0)
INSET = 10.0
"""Distance of the first and the last drive from the ends of the drawing."""
HEADROOM = 0.06
WIDEST_INTERVAL = 2.0
"""Largest half width of an interval that is drawn whole, as a multiple of the range of all drives."""
NUM_STEPS = 6
"""Number of steps between the named values, about."""
TIGHT = 0.85
"""Least distance of two names, as a share of the room that one is thought to need."""
MAX_ROWS = 2
"""Number of rows that the labels of changes stand in."""
KINDS: tuple[Kind, ...] = ("agrees", "disagrees", "beyond")


@dataclass(frozen=True)
class Label:
    """A text in a drawing."""

    x: float
    y: float
    text: str
    anchor: str
    """Which end of the text is at x: `start`, `middle` or `end`."""


@dataclass(frozen=True)
class Dots:
    """Drives of one kind: their dots, and the bars of their intervals, as paths."""

    kind: Kind
    dots: str
    bars: str


@dataclass(frozen=True)
class Panel:
    """One axis in a drawing of size `BOX`."""

    name: str
    unit: str
    bands: tuple[str, ...]
    """Outline of what is allowed for each part of the history, as pairs."""
    lines: tuple[str, ...]
    """What holds in each part of the history, as pairs."""
    drives: tuple[Dots, ...]
    changes: tuple[tuple[float, Label], ...]
    """Abscissa and label of each change."""
    x_ticks: tuple[Label, ...]
    y_ticks: tuple[tuple[float, str], ...]


def panels(course: Course) -> list[Panel]:
    """Draw each axis of a course."""
    first, last = float(course.times[0]), float(course.times[-1])
    span = last - first or 1.0

    def x(time: float) -> float:
        inner = BOX.right - BOX.left - 2.0 * INSET
        middle = 0.5 if last == first else (time - first) / span
        return round(BOX.left + INSET + inner * middle, 1)

    ticks = _x_ticks(course, [x(time) for time in course.times.tolist()])
    return [_panel(course, index, x, ticks) for index in range(len(course.axes))]


def _panel(course: Course, index: int, x: Callable[[float], float], x_ticks: tuple[Label, ...]) -> Panel:
    axis = course.axes[index]
    low, high = _range(axis)

    def y(value: float) -> float:
        inside = min(max(value, low), high)
        return round(BOX.bottom - (BOX.bottom - BOX.top) * (inside - low) / (high - low), 1)

    times = [x(time) for time in course.times.tolist()]
    bands, lines = [], []
    for part in range(int(course.parts[-1]) + 1):
        mine = np.flatnonzero(course.parts == part).tolist()
        ends = [times[mine[0]] - INSET / 2.0, *(times[i] for i in mine), times[mine[-1]] + INSET / 2.0]
        held = axis.expected[[mine[0], *mine, mine[-1]]].tolist()
        lines.append(_pairs(zip(ends, map(y, held), strict=True)))
        upper = [(at, y(value + axis.allowed)) for at, value in zip(ends, held, strict=True)]
        lower = [(at, y(value - axis.allowed)) for at, value in zip(ends, held, strict=True)]
        bands.append(_pairs([*upper, *reversed(lower)]))
    return Panel(
        name=axis.name,
        unit=axis.unit,
        bands=tuple(bands),
        lines=tuple(lines),
        drives=tuple(_dots(course, axis, kind, times, y) for kind in KINDS),
        changes=_change_labels(course, index, x),
        x_ticks=x_ticks,
        y_ticks=tuple((y(value), text) for value, text in _steps(low, high)),
    )


def _range(axis: Axis) -> tuple[float, float]:
    """Least and largest value that is drawn: all drives and what is allowed; wide intervals are cut."""
    values = np.concatenate([axis.found, axis.expected - axis.allowed, axis.expected + axis.allowed])
    span = float(values.max() - values.min())
    half = np.minimum(axis.half_widths, WIDEST_INTERVAL * span)
    low = min(float(values.min()), float((axis.found - half).min()))
    high = max(float(values.max()), float((axis.found + half).max()))
    margin = HEADROOM * (high - low)
    return low - margin, high + margin


def _dots(
    course: Course, axis: Axis, kind: Kind, times: Sequence[float], y: Callable[[float], float]
) -> Dots:
    chosen = [i for i, each in enumerate(course.kinds) if each == kind]
    ends = [
        (
            times[i],
            y(float(axis.found[i] + axis.half_widths[i])),
            y(float(axis.found[i] - axis.half_widths[i])),
        )
        for i in chosen
    ]
    return Dots(
        kind,
        # Lines without a length, whose round ends are dots, take a tenth of the room of circles.
        dots="".join(f"M{times[i]},{y(float(axis.found[i]))}h0" for i in chosen),
        bars="".join(f"M{at},{top}V{bottom}" for at, top, bottom in ends),
    )


def _change_labels(
    course: Course, index: int, x: Callable[[float], float]
) -> tuple[tuple[float, Label], ...]:
    """Place the labels of changes beside their lines; where they would overlap, only lines stand."""
    found: list[tuple[float, Label]] = []
    taken = [BOX.left] * MAX_ROWS
    for change in course.changes:
        at = x(change.time)
        text = f"{change.name}: {change.sizes[index]}" if change.sizes[index] else change.name
        width = LETTER * len(text) + 6.0
        is_left = at + width > BOX.right
        begin = at - width if is_left else at
        row = next((row for row, end in enumerate(taken) if begin >= end), None)
        label = Label(at, 0.0, "", "start")
        if row is not None and begin >= BOX.left - INSET:
            taken[row] = begin + width
            label = Label(
                at + (-3.0 if is_left else 3.0), 10.0 + 13.0 * row, text, "end" if is_left else "start"
            )
        found.append((at, label))
    return tuple(found)


def _x_ticks(course: Course, places: Sequence[float]) -> tuple[Label, ...]:
    """Name as many drives as there is room for, evenly spaced, the first and the last among them."""
    width = LETTER * (max(map(len, course.labels)) + 2)
    # The last name ends at the edge, and so takes half of its room from the one before it.
    room = places[-1] - places[0] - width / 2.0
    wanted = np.linspace(places[0], places[-1], max(2, 1 + int(room / width)))
    nearest = np.unique(np.abs(np.array(places)[None] - wanted[:, None]).argmin(axis=1)).tolist()
    chosen: list[int] = []
    for i in nearest:
        is_free = not chosen or places[i] - places[chosen[-1]] >= TIGHT * width
        if is_free and course.labels[i] not in {course.labels[j] for j in chosen}:
            chosen.append(i)
    return tuple(_tick(places[i], course.labels[i], width) for i in chosen)


def _tick(place: float, text: str, width: float) -> Label:
    anchor = "middle"
    if place + width / 2.0 > BOX.width:
        anchor, place = "end", min(place + INSET, BOX.right)
    elif place - width / 2.0 < 0.0:
        anchor, place = "start", max(place - INSET, 0.0)
    return Label(place, BOX.bottom + 16.0, text, anchor)


def _steps(low: float, high: float) -> list[tuple[float, str]]:
    """Round values between two others, with their texts."""
    raw = (high - low) / NUM_STEPS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if raw <= factor * power * (1.0 + 1e-9))
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    numbers = range(math.ceil(low / step), math.floor(high / step) + 1)
    return [(number * step, f"{number * step + 0.0:.{decimals}f}") for number in numbers]


def _pairs(points: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y}" for x, y in points)
