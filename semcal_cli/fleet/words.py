"""What a fleet says of its rig, in plain words: the same on the page, in the terminal and in the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from semcal_cli.assessment.limits import IN_ALL, Check
from semcal_cli.config import Limits
from semcal_cli.result.intervals import CHECK_NAMES, widest

if TYPE_CHECKING:
    from semcal_cli.fleet.fleet import ComparedDrive, Fleet, Offset, Part

WAYS = (("to the right", "to the left"), ("down", "up"), ("forward", "back"))
"""Where the camera went along each of its axes, by a positive and by a negative offset."""
TURNS = ("pitch", "yaw", "roll")
"""Rotations about the camera's axes x, y and z."""
SIGNS = (
    "A positive pitch moves what the camera sees up in the picture, a positive yaw to the right, and a positive roll "
    "turns it clockwise."
)
SUBJECTS = {"known to": "how well the pose is known", "drift": "drift, first to last drive"}
"""Subjects of checks in plain words; the others are plain."""
QUANTITIES = CHECK_NAMES | {"camera centre in all": "camera, distance", "rotation in all": "rotation, angle"}
"""Quantities of checks in plain words."""
FAR_M = 10.0
"""Distance at which the displacement of a point is told."""


def figures(value: float, half_width: float, least: int) -> tuple[str, str]:
    """Format a value and the half width of its interval, as many digits as the interval has something to say on.

    Args:
        value: The value.
        half_width: Half width of its 95 % interval.
        least: Least number of decimals.
    """
    decimals = least
    if half_width > 0.0:
        power = math.floor(math.log10(half_width))
        # Rounding 0.014 to 0.01 would take away a third of it.
        decimals = max(least, min((half_width < 2.0 * 10.0**power) - power, 6))
    return f"{round(value, decimals) + 0.0:.{decimals}f}", f"{half_width:.{decimals}f}"


def motions(offset: Offset) -> str:
    """Tell what surely differs along and about each axis, the surest first; the likeliest if nothing surely does."""
    off = np.concatenate([offset.center_m, offset.rotation_deg])
    ratios = np.abs(off) / np.maximum(offset.half_widths, np.finfo(float).tiny)
    surest = np.argsort(-ratios, kind="stable").tolist()
    named = [axis for axis in surest if ratios[axis] > 1.0] or surest[:1]
    return ", ".join(_motion(axis, float(off[axis]), float(offset.half_widths[axis])) for axis in named)


def _motion(axis: int, off: float, half_width: float) -> str:
    if axis < 3:
        size, half = figures(1000.0 * abs(off), 1000.0 * half_width, 0)
        return f"{size} mm {WAYS[axis][off < 0.0]} (+- {half})"
    size, half = figures(abs(off), half_width, 2)
    return f"{'-' if off < 0.0 else '+'}{size} degrees {TURNS[axis - 3]} (+- {half})"


def total(offset: Offset) -> str:
    """Tell an offset in two figures."""
    return f"{1000.0 * np.linalg.norm(offset.center_m):.1f} mm and {np.linalg.norm(offset.rotation_deg):.3f} degrees"


def change_lines(parts: Sequence[Part], cut: int | None = None) -> list[str]:
    """Tell each change: between which drives, and what it was.

    Args:
        parts: Parts of the history.
        cut: Largest number of changes that are told; the number of the others stands in a last line.
    """
    changes = [
        f"changed between {before.last} and {after.first}: {motions(after.change)}"
        for before, after in pairwise(parts)
        if after.change is not None
    ]
    if cut is None or len(changes) <= cut:
        return changes
    return [*changes[:cut], f"changed {len(changes) - cut:,} times more"]


def drift_line(drift: Offset) -> str:
    """Tell a drift."""
    return f"drifted from the first drive to the last: {motions(drift)}"


class CheckWords(NamedTuple):
    """A check as text, in millimetres or degrees."""

    subject: str
    """What was judged, in plain words."""
    quantity: str
    found: str
    half_width: str
    """Half width of the 95 % interval."""
    allowed: str
    unit: str


def check_words(check: Check) -> CheckWords:
    """Tell a check of the combined pose, or of a drive, which has no subject."""
    subject, _, quantity = check.name.rpartition(": ")
    scale, unit, least = (10.0, "mm", 1) if check.unit == "cm" else (1.0, "degrees", 3)
    found, half_width = figures(scale * check.offset, scale * (check.half_width or 0.0), least)
    allowed = f"{scale * check.allowed:g}"
    return CheckWords(SUBJECTS.get(subject, subject), QUANTITIES[quantity], found, half_width, allowed, unit)


def in_all(drive: ComparedDrive, limits: Limits) -> list[CheckWords]:
    """Tell how far a drive is off in all: its camera's centre, and its rotation."""
    return [check_words(check) for check in drive.offset.judge(limits) if check.name.endswith(IN_ALL)]


def title(fleet: Fleet) -> str:
    """State the verdict in a few words."""
    if fleet.verdict == "inconclusive":
        return "The drives cannot decide"
    if fleet.verdict == "pass":
        moved = fleet.drift is not None or len(fleet.parts) > 1
        return "The rig holds, within what is allowed" if moved else "The rig holds"
    if _fails(fleet, "change"):
        return "The rig changed"
    if _fails(fleet, "drift"):
        return "The rig drifts"
    if _fails(fleet, "from the reference"):
        return "The rig is not where its reference has it"
    count = sum(drive.verdict == "fail" for drive in fleet.drives)
    return f"{count:,} of {len(fleet.drives):,} drives {'is' if count == 1 else 'are'} beyond what is allowed"


def _fails(fleet: Fleet, subject: str) -> bool:
    return any(check.name.startswith(subject) and check.verdict == "fail" for check in fleet.checks)


def sentences(fleet: Fleet) -> list[str]:
    """Say what holds now, what that means, and what to do."""
    last, num_used = fleet.parts[-1], len(fleet.drives)
    known = widest(last.half_widths.tolist())
    if fleet.drift is not None:
        found = [
            f"The transform below holds at the last drive, {last.last}, to {known}.",
            f"The camera moves slowly against the LiDAR, and {_displaced(fleet.drift)} from the first drive to the "
            "last: each drive needs the transform of its own time, and the mount needs a look.",
        ]
    elif last.change is not None:
        found = [
            f"The transform below holds from {last.first} on, to {known}.",
            f"The camera moved against the LiDAR, and {_displaced(last.change)} by the last change: "
            "earlier drives need the transform of their own time, which stands below, too.",
        ]
    else:
        num_off = sum(drive.disagrees or drive.verdict == "fail" for drive in fleet.drives)
        which = f"{num_used - num_off:,} of {num_used:,}" if num_off else f"all {num_used:,}"
        found = [f"One transform, below, holds for {which} drives, to {known}."]
    if _fails(fleet, "from the reference"):
        found.append(
            "It surely is not the reference: use it in the reference's place, or mount the camera anew."
        )
    if any(drive.verdict == "fail" for drive in fleet.drives):
        found.append(
            "Drives surely beyond what is allowed have wrong data or a wrong calibration: look at them."
        )
    if fleet.verdict == "inconclusive":
        found.append("More drives, or longer ones, narrow the intervals until the verdict is clear.")
    return found


def _displaced(offset: Offset) -> str:
    """Tell how far a point far ahead lands from its place."""
    angle = math.radians(float(np.linalg.norm(offset.rotation_deg)))
    off_mm = 1000.0 * math.hypot(FAR_M * angle, float(np.linalg.norm(offset.center_m)))
    return f"a point {FAR_M:g} m away lands up to {off_mm:.0f} mm elsewhere"
