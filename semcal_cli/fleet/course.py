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
from semcal_cli.fleet.fleet import ComparedDrive, Fleet, Offset
from semcal_cli.report.drawing import short_names

Kind: TypeAlias = Literal["agrees", "disagrees", "beyond"]
UNITS = np.array([1000.0] * 3 + [1.0] * 3)
"""Factors from metres and degrees to the drawn units, millimetres and degrees."""
MAX_DRAWN = 1500
"""Largest number of drives that agree and are drawn; all others are drawn."""
DAY_S = 86_400.0


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
    """What is drawn of a fleet: poses along and about the six axes of the camera, millimetres and degrees.

    They are relative to the pose at the last drive.
    """

    times: npt.NDArray[np.float64]
    """(N,) times: days since the first drive, or numbers of drives."""
    labels: tuple[str, ...]
    """(N,) labels of the drives on the axis of time."""
    title: str
    """Meaning of the labels."""
    kinds: npt.NDArray[np.str_]
    """(N,) how each drive is judged."""
    parts: npt.NDArray[np.intp]
    """(N,) part of the history of each drive."""
    found: npt.NDArray[np.float64]
    """(N, 6) pose of each drive."""
    half_widths: npt.NDArray[np.float64]
    """(N, 6) half widths of the 95 % intervals."""
    expected: npt.NDArray[np.float64]
    """(N, 6) pose of the rig at the time of each drive."""
    allowed: npt.NDArray[np.float64]
    """(6,) largest allowed offset from what is expected."""
    changes: tuple[Change, ...]


def course_of(fleet: Fleet) -> Course:
    """Choose what is drawn of a fleet: all drives that disagree, and of many others evenly spaced ones."""
    kinds = [kind_of(drive) for drive in fleet.drives]
    agreeing = evenly_spaced([i for i, kind in enumerate(kinds) if kind == "agrees"], MAX_DRAWN)
    # The ends of a part are those of its line.
    starts = np.flatnonzero(np.diff([drive.part for drive in fleet.drives]))
    ends = {0, len(kinds) - 1, *starts.tolist(), *(starts + 1).tolist()}
    chosen = sorted({*agreeing, *ends, *(i for i, kind in enumerate(kinds) if kind != "agrees")})
    drives, names = [fleet.drives[i] for i in chosen], _names(fleet)
    expected = UNITS * np.array([drive.expected for drive in drives])
    labels, title = _labels(fleet, drives, [names[i] for i in chosen])
    return Course(
        times=np.array([drive.time for drive in drives]),
        labels=tuple(labels),
        title=title,
        kinds=np.array([kinds[i] for i in chosen]),
        parts=np.array([drive.part for drive in drives], np.intp),
        found=expected + np.array([_drawn(drive.offset) for drive in drives]),
        half_widths=UNITS * np.array([drive.offset.half_widths for drive in drives]),
        expected=expected,
        allowed=UNITS * np.repeat([fleet.limits.translation_m, fleet.limits.rotation_deg], 3),
        changes=_changes(fleet, names),
    )


def kind_of(drive: ComparedDrive) -> Kind:
    """Say how a drive is judged: surely beyond what is allowed, disagreeing or far off, or neither."""
    if drive.verdict == "fail":
        return "beyond"
    return "disagrees" if drive.disagrees or drive.is_far else "agrees"


def _drawn(offset: Offset) -> npt.NDArray[np.float64]:
    return np.asarray(UNITS * np.concatenate([offset.center_m, offset.rotation_deg]))


def _names(fleet: Fleet) -> list[str]:
    """Name each drive briefly: without the folder that all are in, or by its number if names are long."""
    names = [drive.member.drive for drive in fleet.drives]
    folder = names[0].rpartition("/")[0]
    if folder and all(name.rpartition("/")[0] == folder for name in names):
        names = [name.rpartition("/")[2] for name in names]
    return short_names(names)


def _labels(fleet: Fleet, drives: Sequence[ComparedDrive], names: list[str]) -> tuple[list[str], str]:
    """Label drives with their dates, if they are in the order of their stamps, else with their names."""
    if fleet.order == "name":
        return names, "drives, in the order of their names"
    stamps = [drive.member.stamp or 0.0 for drive in drives]
    form = "%Y-%m-%d" if stamps[-1] - stamps[0] > 3.0 * DAY_S else "%m-%d %H:%M"
    try:
        labels = [datetime.fromtimestamp(stamp, timezone.utc).strftime(form) for stamp in stamps]
    except (ValueError, OverflowError, OSError):  # Beyond the year 9999.
        return [f"{drive.time:.4g}" for drive in drives], "days since the first drive"
    return labels, "date" if form == "%Y-%m-%d" else "month, day and time, UTC"


def _changes(fleet: Fleet, names: Sequence[str]) -> tuple[Change, ...]:
    """Place each change between the two drives that it lies between."""
    found, begin = [], 0
    for before, part in pairwise(fleet.parts):
        begin += before.num_drives
        time = 0.5 * (fleet.drives[begin - 1].time + fleet.drives[begin].time)
        assert part.change is not None
        sizes = zip(_drawn(part.change).tolist(), UNITS * part.change.half_widths, strict=True)
        texts = [
            f"{size:+.{0 if i < 3 else 2}f}" if abs(size) > half else ""
            for i, (size, half) in enumerate(sizes)
        ]
        found.append(Change(time, names[begin], tuple(texts)))
    return tuple(found)
