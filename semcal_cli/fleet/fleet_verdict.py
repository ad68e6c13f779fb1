"""The verdict on a fleet in plain words, which are the same on the page, in the terminal and in the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from semcal_cli.config import Limits
from semcal_cli.errors import listed
from semcal_cli.many.chronology import has_date
from semcal_cli.pipeline.verdict import OVERALL, AxisVerdict, Verdict, together
from semcal_cli.readable import figure, lengths
from semcal_cli.result.uncertainty import CHECK_NAMES, widest

if TYPE_CHECKING:
    from semcal_cli.fleet.fleet_drives import FleetDrive
    from semcal_cli.fleet.fleet_result import ComparedDrive, Fleet, Offset, RigPart

MIN_DRIVES = 3
"""Minimum number of drives that show how much drives scatter."""
MIN_USED = 0.5
"""Minimum fraction of usable drives; if most drives fail, the rest says little."""
MAX_NAMED = 8
"""Largest number of changes that are described."""
FAR_M = 10.0
"""Distance at which the displacement of a point is stated."""
DIRECTIONS = (("to the right", "to the left"), ("down", "up"), ("forward", "back"))
"""Direction of a positive and of a negative offset along each axis of the camera."""
ROTATIONS = ("pitch", "yaw", "roll")
"""Rotations about the camera's axes x, y and z."""
SIGNS = (
    "A positive pitch moves what the camera sees up in the image, a positive yaw to the right, and a positive roll "
    "turns it clockwise."
)
SUBJECTS = {"known to": "how well the pose is known", "drift": "drift, first to last drive"}
"""Subjects of checks in plain words; the others are plain."""
QUANTITIES = CHECK_NAMES | {
    "camera centre overall": "camera, distance",
    "rotation overall": "rotation, angle",
}
"""Quantities of checks in plain words."""


def judge_fleet(
    interval: Offset,
    from_reference: Offset | None,
    parts: Sequence[RigPart],
    drift: Offset | None,
    limits: Limits,
) -> tuple[AxisVerdict, ...]:
    """Judge the combined pose.

    Args:
        interval: A zero offset with the intervals of the transform at the last drive.
        from_reference: Offset from the transform that the rig should have, if there is one.
        parts: Parts of the history, each with its change.
        drift: Offset from the first drive to the last, if the rig drifts.
        limits: Largest allowed offsets.
    """
    offsets = [("known to", interval), ("from the reference", from_reference)]
    for part in parts:
        offsets.append((f"change at {part.first}", part.change))
        offsets.append((f"change from {parts[0].first} to {part.first}", part.overall_change))
    offsets.append(("drift", drift))
    return tuple(
        replace(check, name=f"{subject}: {check.name}")
        for subject, offset in offsets
        if offset is not None
        for check in offset.judge(limits)
    )


def conclude(
    checks: Sequence[AxisVerdict],
    drives: Sequence[ComparedDrive],
    left_out: Sequence[FleetDrive],
    parts: Sequence[RigPart],
    drift: Offset | None,
) -> tuple[Verdict, tuple[str, ...]]:
    """Reach the verdict on the fleet, with sentences about changes and missing information."""
    num_used, num_all = len(drives), len(drives) + len(left_out)
    # A drive with an uncertain pose is no reason to distrust the fleet; a drive that seems far off is.
    verdicts = [*(check.verdict for check in checks), *(drive.verdict for drive in drives if drive.is_far)]
    reasons = change_lines(parts)
    if drift is not None:
        reasons.append(f"drifted from the first drive to the last: {motions(drift)}")
    for words, listed_drives in (
        ("clearly beyond the limits", [d for d in drives if d.verdict == "fail"]),
        ("possibly beyond the limits", [d for d in drives if d.is_suspect]),
        ("disagree but are within the limits", [d for d in drives if d.disagrees and not d.is_far]),
    ):
        if listed_drives:
            names = listed(drive.drive.name for drive in listed_drives)
            reasons.append(f"{len(listed_drives):,} of {num_used:,} drives {words}: {names}")
    num_reasons, num_stamped = len(reasons), sum(has_date(drive.drive) for drive in drives)
    if 0 < num_stamped < num_used:
        # With drives ordered by name, a change or a drift may look like scatter.
        reasons.append(
            f"{num_used - num_stamped:,} of {num_used:,} drives have no absolute timestamp, so the order in time is "
            "unknown"
        )
    if num_used < MIN_DRIVES:
        reasons.append(
            f"{num_used} of {num_all:,} drives can be used, needed {MIN_DRIVES} to show their scatter"
        )
    elif num_used < MIN_USED * num_all:
        reasons.append(f"{num_used:,} of {num_all:,} drives can be used, needed {MIN_USED:.0%}")
    if len(reasons) > num_reasons:
        verdicts.append("inconclusive")
    return together(verdicts), tuple(reasons)


def notes(drives: Sequence[FleetDrive]) -> tuple[str, ...]:
    """List notes for the reader that do not affect the verdict."""
    sentences = []
    if not all(map(has_date, drives)):
        sentences.append("ordered by name: some drives have no absolute timestamps")
    num_cameras = len({drive.camera for drive in drives if drive.camera is not None})
    if num_cameras > 1:
        sentences.append(
            f"drives have {num_cameras:,} cameras, given or estimated, that differ in image size, intrinsics or "
            "lens model. The pose that they agree on belongs to none of them: write one camera into all drives and "
            "calibrate them again"
        )
    return tuple(sentences)


def figures(value: float, half_width: float, min_decimals: int) -> tuple[str, str]:
    """Format a value and the half width of its interval with as many digits as the interval justifies.

    Args:
        value: The value.
        half_width: Half width of its 95 % interval.
        min_decimals: Minimum number of decimals.
    """
    decimals = min_decimals
    if half_width > 0.0:
        power = math.floor(math.log10(half_width))
        # Rounding 0.014 to 0.01 would lose a third of it.
        decimals = max(min_decimals, min((half_width < 2.0 * 10.0**power) - power, 6))
    return f"{round(value, decimals) + 0.0:.{decimals}f}", f"{half_width:.{decimals}f}"


def motions(offset: Offset) -> str:
    """List what differs beyond its interval on each axis, clearest first; if nothing does, what comes closest."""
    ratios = np.abs(offset.values) / np.maximum(offset.half_widths, np.finfo(float).tiny)
    clearest = np.argsort(-ratios, kind="stable").tolist()
    axes = [axis for axis in clearest if ratios[axis] > 1.0] or clearest[:1]
    values, half_widths = offset.values.tolist(), offset.half_widths.tolist()
    return ", ".join(_motion(axis, values[axis], half_widths[axis]) for axis in axes)


def _motion(axis: int, value: float, half_width: float) -> str:
    if axis < 3:
        size, half = figures(100.0 * abs(value), 100.0 * half_width, 0)
        return f"{size} cm {DIRECTIONS[axis][value < 0.0]} (+- {half})"
    size, half = figures(abs(value), half_width, 2)
    return f"{'-' if value < 0.0 else '+'}{size} degrees {ROTATIONS[axis - 3]} (+- {half})"


def total(offset: Offset) -> str:
    """Write an offset as two figures."""
    return f"{lengths([offset.distance_m])} and {figure(offset.angle_deg)} degrees"


def change_lines(parts: Sequence[RigPart]) -> list[str]:
    """Describe the first changes and between which drives they are, and count the others."""
    changes = [
        f"changed between {before.last} and {after.first}: {motions(after.change)}"
        for before, after in pairwise(parts)
        if after.change is not None
    ]
    num_more = len(changes) - MAX_NAMED
    return [*changes[:MAX_NAMED], *([f"changed {num_more:,} more times"] if num_more > 0 else [])]


class CheckWords(NamedTuple):
    """A check as text, in centimetres or degrees."""

    subject: str
    """What was judged, in plain words."""
    quantity: str
    offset: str
    half_width: str
    """Half width of the 95 % interval."""
    allowed: str
    unit: str


def check_words(check: AxisVerdict) -> CheckWords:
    """Put a check into words: of the combined pose or, without a subject, of a drive."""
    subject, _, quantity = check.name.rpartition(": ")
    value, half_width = figures(check.offset, check.half_width or 0.0, 2)
    allowed, unit = f"{check.allowed:g}", check.unit_word
    return CheckWords(SUBJECTS.get(subject, subject), QUANTITIES[quantity], value, half_width, allowed, unit)


def overall(drive: ComparedDrive, limits: Limits) -> list[CheckWords]:
    """Describe how far a drive is off in total: its camera centre and its rotation."""
    return [check_words(check) for check in drive.offset.judge(limits) if check.name.endswith(OVERALL)]


def title(fleet: Fleet) -> str:
    """State the verdict in a few words."""
    if fleet.verdict == "inconclusive":
        return "The drives are inconclusive"
    if fleet.verdict == "pass":
        has_moved = fleet.drift is not None or len(fleet.parts) > 1
        return "The rig moved within the limits" if has_moved else "The rig is stable"
    for subject, words in (
        ("change", "The rig changed"),
        ("drift", "The rig drifts"),
        ("from the reference", "The rig is not at its reference"),
    ):
        if _fails(fleet, subject):
            return words
    count = sum(drive.verdict == "fail" for drive in fleet.drives)
    return f"{count:,} of {len(fleet.drives):,} drives {'is' if count == 1 else 'are'} beyond the limits"


def _fails(fleet: Fleet, subject: str) -> bool:
    return any(check.name.startswith(subject) and check.verdict == "fail" for check in fleet.checks)


def sentences(fleet: Fleet) -> list[str]:
    """Describe which transform is valid now, what that means, and what to do."""
    last, num_used = fleet.parts[-1], len(fleet.drives)
    interval = widest(last.half_widths.tolist())
    if fleet.drift is not None:
        lines = [
            f"The transform below is that of the last drive, {last.last}, to within {interval}.",
            f"The camera moves slowly relative to the LiDAR: {_displaced(fleet.drift)} between the first drive and the "
            "last. Use the transform of each drive's own time, and check the mount.",
        ]
    elif last.change is not None:
        lines = [
            f"The transform below is valid from {last.first} on, to within {interval}.",
            f"The camera moved relative to the LiDAR: {_displaced(last.change)} because of the last change. "
            "For earlier drives, use the transform of their own time, which is also below.",
        ]
    else:
        num_off = sum(drive.disagrees or drive.verdict == "fail" for drive in fleet.drives)
        which = f"{num_used - num_off:,} of {num_used:,}" if num_off else f"all {num_used:,}"
        lines = [f"The transform below is valid for {which} drives, to within {interval}."]
    if _fails(fleet, "from the reference"):
        lines.append(
            "It clearly differs from the reference: use it instead of the reference, or remount the camera."
        )
    if any(drive.verdict == "fail" for drive in fleet.drives):
        lines.append(
            "Drives clearly beyond the limits have wrong data or a wrong calibration: run semcal inspect on them."
        )
    if fleet.verdict == "inconclusive":
        lines.append("More drives, or longer ones, narrow the intervals until the verdict is clear.")
    return lines


def _displaced(offset: Offset) -> str:
    """Describe by how much a distant point is displaced."""
    off_m = math.hypot(FAR_M * math.radians(offset.angle_deg), offset.distance_m)
    return f"a point {FAR_M:g} m away is displaced by up to {lengths([off_m])}"
