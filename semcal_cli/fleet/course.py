"""The course of a fleet over time along six axes, as the page and the plot draw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.fleet.fleet import ComparedDrive, Fleet, Part
from semcal_cli.result.axes import AXIS_NAMES

Kind: TypeAlias = Literal["agrees", "disagrees", "beyond"]
AXES = tuple(zip(AXIS_NAMES, ["mm"] * 3 + ["degrees"] * 3, strict=True))
"""Name and unit of each axis."""
UNITS = np.array([1000.0] * 3 + [1.0] * 3)
"""Factors from metres and degrees to the drawn units."""
MAX_DRAWN = 1500
"""Largest number of drives that agree and are drawn; all others are drawn."""
LONGEST_NAME = 14
"""Largest number of letters of a drive's name in a drawing; with longer ones drives are numbered."""
DAY_S = 86_400.0


@dataclass(frozen=True)
class Axis:
    """Drives along or about one axis of the camera, relative to the pose at the last drive."""

    name: str
    unit: str
    found: npt.NDArray[np.float64]
    """(N,) pose of each drive."""
    half_widths: npt.NDArray[np.float64]
    """(N,) half widths of the 95 % intervals."""
    expected: npt.NDArray[np.float64]
    """(N,) pose of the rig at the time of each drive."""
    allowed: float
    """Largest allowed offset from what is expected."""


@dataclass(frozen=True)
class Change:
    """A change of the rig: its time, between two drives, its drive, and its size along each axis as text."""

    time: float
    name: str
    """Label of the first drive after it."""
    sizes: tuple[str, ...]
    """Size along each axis in its unit; empty where it may be chance."""


@dataclass(frozen=True)
class Course:
    """What is drawn of a fleet."""

    times: npt.NDArray[np.float64]
    """(N,) times: days since the first drive, or numbers of drives."""
    labels: tuple[str, ...]
    """(N,) labels of the drives on the axis of time."""
    title: str
    """Meaning of the labels."""
    kinds: tuple[Kind, ...]
    """(N,) how each drive is judged."""
    parts: npt.NDArray[np.intp]
    """(N,) part of the history of each drive."""
    axes: tuple[Axis, ...]
    changes: tuple[Change, ...]


def course_of(fleet: Fleet) -> Course:
    """Choose what is drawn of a fleet: all drives that disagree, and of many others evenly spaced ones."""
    kinds = [kind_of(drive) for drive in fleet.drives]
    agreeing = evenly_spaced([i for i, kind in enumerate(kinds) if kind == "agrees"], MAX_DRAWN)
    # The ends of a part are those of its line.
    starts = np.flatnonzero(np.diff([drive.part for drive in fleet.drives]))
    ends = {0, len(kinds) - 1, *starts.tolist(), *(starts + 1).tolist()}
    chosen = sorted({*agreeing, *ends, *(i for i, kind in enumerate(kinds) if kind != "agrees")})
    drives = [fleet.drives[i] for i in chosen]
    names = short_names(fleet)
    expected = UNITS * np.array([drive.expected for drive in drives])
    offsets = np.array(
        [np.concatenate([drive.offset.center_m, drive.offset.rotation_deg]) for drive in drives]
    )
    found = expected + UNITS * offsets
    half_widths = UNITS * np.array([drive.offset.half_widths for drive in drives])
    limits = UNITS * np.repeat([fleet.limits.translation_m, fleet.limits.rotation_deg], 3)
    axes = tuple(
        Axis(name, unit, found[:, i], half_widths[:, i], expected[:, i], float(limits[i]))
        for i, (name, unit) in enumerate(AXES)
    )
    times = np.array([drive.time for drive in drives])
    labels, title = _labels(fleet, drives, [names[i] for i in chosen])
    parts = np.array([drive.part for drive in drives], np.intp)
    return Course(times, labels, title, tuple(kinds[i] for i in chosen), parts, axes, _changes(fleet, names))


def kind_of(drive: ComparedDrive) -> Kind:
    """Say how a drive is judged: surely beyond what is allowed, disagreeing or far off, or neither."""
    if drive.verdict == "fail":
        return "beyond"
    return "disagrees" if drive.disagrees or drive.is_far else "agrees"


def short_names(fleet: Fleet) -> list[str]:
    """Name each drive briefly: without the folder that all are in, or by its number if names are long."""
    names = [drive.member.drive for drive in fleet.drives]
    folder = names[0].rpartition("/")[0]
    if folder and all(name.rpartition("/")[0] == folder for name in names):
        names = [name.rpartition("/")[2] for name in names]
    if max(map(len, names)) > LONGEST_NAME:
        return [str(number) for number in range(1, len(names) + 1)]
    return names


def _labels(
    fleet: Fleet, drives: Sequence[ComparedDrive], names: Sequence[str]
) -> tuple[tuple[str, ...], str]:
    """Label drives with their dates, if they are in the order of their stamps, else with their names."""
    if fleet.order == "name":
        return tuple(names), "drives, in the order of their names"
    stamps = [drive.member.stamp or 0.0 for drive in drives]
    form = "%Y-%m-%d" if stamps[-1] - stamps[0] > 3.0 * DAY_S else "%m-%d %H:%M"
    try:
        labels = [datetime.fromtimestamp(stamp, timezone.utc).strftime(form) for stamp in stamps]
    except (ValueError, OverflowError, OSError):  # Beyond the year 9999.
        return tuple(f"{drive.time:.4g}" for drive in drives), "days since the first drive"
    return tuple(labels), "date" if form == "%Y-%m-%d" else "month, day and time, UTC"


def _changes(fleet: Fleet, names: Sequence[str]) -> tuple[Change, ...]:
    """Place each change between the two drives that it lies between."""
    found = []
    begin = 0
    for before, part in pairwise(fleet.parts):
        begin += before.num_drives
        time = 0.5 * (fleet.drives[begin - 1].time + fleet.drives[begin].time)
        found.append(Change(time, names[begin], _sizes(part)))
    return tuple(found)


def _sizes(part: Part) -> tuple[str, ...]:
    assert part.change is not None
    off = UNITS * np.concatenate([part.change.center_m, part.change.rotation_deg])
    half_widths = UNITS * part.change.half_widths
    return tuple(
        f"{value:+.{0 if i < 3 else 2}f}" if abs(value) > half else ""
        for i, (value, half) in enumerate(zip(off.tolist(), half_widths.tolist(), strict=True))
    )
