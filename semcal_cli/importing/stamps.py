"""Poses by their stamps in nanoseconds: as text, and which moments they cover."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence

from semcal_cli.config.nanoseconds import NS
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import quaternion_xyzw

MAX_GAP_NS = NS // 2
"""Longest time from one sweep or pose to the next. After a longer gap between sweeps, the odometry starts anew."""


def are_covered(stamps_ns: Sequence[int], moments_ns: Iterable[int]) -> bool:
    """Return whether poses with these ascending stamps lie close before and after each of the moments."""
    indices = [bisect_left(stamps_ns, moment) for moment in moments_ns]
    return all(
        0 < index < len(stamps_ns) and stamps_ns[index] - stamps_ns[index - 1] <= MAX_GAP_NS
        for index in indices
    )


def tum_text(poses: Mapping[int, Pose]) -> str:
    """Format poses (4, 4) by their times in nanoseconds, one per line: seconds x y z qx qy qz qw (TUM)."""
    lines = []
    for stamp_ns, T in poses.items():
        numbers = [*T[:3, 3], *quaternion_xyzw(T)]
        lines.append(" ".join([seconds_text(stamp_ns), *(f"{number:.12g}" for number in numbers)]))
    return "\n".join(lines) + "\n"


def seconds_text(stamp_ns: int) -> str:
    """Format a time in seconds, with all nine digits of its nanoseconds."""
    sign, stamp = ("-" if stamp_ns < 0 else ""), abs(stamp_ns)
    return f"{sign}{stamp // NS}.{stamp % NS:09d}"
