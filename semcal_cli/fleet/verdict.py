"""The verdict on a fleet, with sentences on the changes and on missing information."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from semcal_cli.assessment.limits import Check, Verdict, together
from semcal_cli.config import Limits
from semcal_cli.errors import listed
from semcal_cli.fleet.fleet import ComparedDrive, Offset, Order, Part
from semcal_cli.fleet.members import Member
from semcal_cli.fleet.words import change_lines, drift_line

MIN_DRIVES = 3
"""Least number of drives that tell how they scatter."""
MIN_USED = 0.5
"""Least share of the drives that can be used; if most drives fail, the rest says little."""
MAX_NAMED = 8
"""Largest number of changes that are told."""


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
    verdicts: list[Verdict] = [check.verdict for check in checks]
    reasons = change_lines(parts, MAX_NAMED)
    if drifted is not None:
        reasons.append(drift_line(drifted))
    for words, found in (
        ("surely farther off than is allowed", [d for d in drives if d.verdict == "fail"]),
        ("farther off than is allowed, not surely", [d for d in drives if d.is_suspect]),
        ("disagreeing, within what is allowed", [d for d in drives if d.disagrees and not d.is_far]),
    ):
        if found:
            names = listed(drive.member.drive for drive in found)
            reasons.append(f"{len(found):,} of {num_used:,} drives {words}: {names}")
    # A drive whose pose is uncertain is no reason to distrust the fleet; a drive that seems far off is.
    verdicts += [drive.verdict for drive in drives if drive.is_far]
    num_stamped = sum(drive.member.has_stamp for drive in drives)
    if 0 < num_stamped < num_used:
        # With drives ordered by name, a change or a drift may look like scatter.
        reasons.append(
            f"{num_used - num_stamped:,} of {num_used:,} drives have no stamp in seconds since 1970, needed one of "
            "each: the order of time is not known"
        )
        verdicts.append("inconclusive")
    if num_used < MIN_DRIVES:
        few = f"{num_used} of {num_all:,} drives can be used, needed {MIN_DRIVES} to tell how they scatter"
    elif num_used < MIN_USED * num_all:
        few = f"{num_used:,} of {num_all:,} drives can be used, needed {MIN_USED:.0%}"
    else:
        return together(verdicts), tuple(reasons)
    verdicts.append("inconclusive")
    return together(verdicts), (*reasons, few)


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
