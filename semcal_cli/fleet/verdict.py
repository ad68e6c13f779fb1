"""The verdict on a fleet, and what it says in plain words: the same on the page, in the terminal and in the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from semcal_cli.assessment.limits import IN_ALL, Check, Verdict, together
from semcal_cli.config import Limits
from semcal_cli.errors import listed
from semcal_cli.result.uncertainty import CHECK_NAMES, widest

if TYPE_CHECKING:
    from semcal_cli.fleet.fleet import ComparedDrive, Fleet, Offset, Order, Part
    from semcal_cli.fleet.members import Member

MIN_DRIVES = 3
"""Least number of drives that tell how they scatter."""
MIN_USED = 0.5
"""Least share of the drives that can be used; if most drives fail, the rest says little."""
MAX_NAMED = 8
"""Largest number of changes that are told."""
FAR_M = 10.0
"""Distance at which the displacement of a point is told."""
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


def judge_fleet(
    known: Offset, off_reference: Offset | None, parts: Sequence[Part], drifted: Offset | None, limits: Limits
) -> tuple[Check, ...]:
    """Judge the combined pose.

    Args:
        known: A zero offset, with the intervals of the transform at the last drive.
        off_reference: Offset from the transform that the rig should have, if there is one.
        parts: Parts of the history, each with its change.
        drifted: Offset from the first drive to the last, if the rig drifts.
        limits: Largest allowed offsets.
    """
    offsets = [("known to", known), ("from the reference", off_reference)]
    for part in parts:
        offsets.append((f"change at {part.first}", part.change))
        offsets.append((f"change from {parts[0].first} to {part.first}", part.change_in_all))
    offsets.append(("drift", drifted))
    return tuple(
        replace(check, name=f"{subject}: {check.name}")
        for subject, offset in offsets
        if offset is not None
        for check in offset.judge(limits)
    )


def conclude(
    checks: Sequence[Check],
    drives: Sequence[ComparedDrive],
    left_out: Sequence[Member],
    parts: Sequence[Part],
    drifted: Offset | None,
) -> tuple[Verdict, tuple[str, ...]]:
    """Give the verdict on the fleet, with sentences on the changes and on missing information."""
    num_used, num_all = len(drives), len(drives) + len(left_out)
    # A drive whose pose is uncertain is no reason to distrust the fleet; a drive that seems far off is.
    verdicts = [*(check.verdict for check in checks), *(drive.verdict for drive in drives if drive.is_far)]
    reasons = change_lines(parts)
    if drifted is not None:
        reasons.append(f"drifted from the first drive to the last: {motions(drifted)}")
    for words, found in (
        ("surely farther off than is allowed", [d for d in drives if d.verdict == "fail"]),
        ("farther off than is allowed, not surely", [d for d in drives if d.is_suspect]),
        ("disagreeing, within what is allowed", [d for d in drives if d.disagrees and not d.is_far]),
    ):
        if found:
            names = listed(drive.member.drive for drive in found)
            reasons.append(f"{len(found):,} of {num_used:,} drives {words}: {names}")
    num_reasons, num_stamped = len(reasons), sum(drive.member.has_stamp for drive in drives)
    if 0 < num_stamped < num_used:
        # With drives ordered by name, a change or a drift may look like scatter.
        reasons.append(
            f"{num_used - num_stamped:,} of {num_used:,} drives have no stamp in seconds since 1970, needed one of "
            "each: the order of time is not known"
        )
    if num_used < MIN_DRIVES:
        reasons.append(
            f"{num_used} of {num_all:,} drives can be used, needed {MIN_DRIVES} to tell how they scatter"
        )
    elif num_used < MIN_USED * num_all:
        reasons.append(f"{num_used:,} of {num_all:,} drives can be used, needed {MIN_USED:.0%}")
    if len(reasons) > num_reasons:
        verdicts.append("inconclusive")
    return together(verdicts), tuple(reasons)


def notes(used: Sequence[Member], order: Order) -> tuple[str, ...]:
    """Give notes for the reader that do not affect the verdict."""
    found = []
    if order == "name":
        found.append("drives have no stamps in seconds since 1970 that differ: ordered by name")
    num_cameras = len({member.camera for member in used if member.camera is not None})
    if num_cameras > 1:
        found.append(
            f"drives have {num_cameras:,} cameras, given or estimated, that differ in picture size, intrinsics or "
            "lens: the pose that they agree on belongs to none of them; set one in all drives and calibrate them again"
        )
    return tuple(found)


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
    ratios = np.abs(offset.values) / np.maximum(offset.half_widths, np.finfo(float).tiny)
    surest = np.argsort(-ratios, kind="stable").tolist()
    named = [axis for axis in surest if ratios[axis] > 1.0] or surest[:1]
    off, half_widths = offset.values.tolist(), offset.half_widths.tolist()
    return ", ".join(_motion(axis, off[axis], half_widths[axis]) for axis in named)


def _motion(axis: int, off: float, half_width: float) -> str:
    if axis < 3:
        size, half = figures(1000.0 * abs(off), 1000.0 * half_width, 0)
        return f"{size} mm {WAYS[axis][off < 0.0]} (+- {half})"
    size, half = figures(abs(off), half_width, 2)
    return f"{'-' if off < 0.0 else '+'}{size} degrees {TURNS[axis - 3]} (+- {half})"


def total(offset: Offset) -> str:
    """Tell an offset in two figures."""
    return f"{1000.0 * offset.distance_m:.1f} mm and {offset.angle_deg:.3f} degrees"


def change_lines(parts: Sequence[Part]) -> list[str]:
    """Tell the first changes, between which drives and what each was, and how many more there are."""
    changes = [
        f"changed between {before.last} and {after.first}: {motions(after.change)}"
        for before, after in pairwise(parts)
        if after.change is not None
    ]
    num_more = len(changes) - MAX_NAMED
    return [*changes[:MAX_NAMED], *([f"changed {num_more:,} times more"] if num_more > 0 else [])]


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
    for subject, words in (
        ("change", "The rig changed"),
        ("drift", "The rig drifts"),
        ("from the reference", "The rig is not where its reference has it"),
    ):
        if _fails(fleet, subject):
            return words
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
    off_mm = 1000.0 * math.hypot(FAR_M * math.radians(offset.angle_deg), offset.distance_m)
    return f"a point {FAR_M:g} m away lands up to {off_mm:.0f} mm elsewhere"
