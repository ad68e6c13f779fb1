"""What a batch says at its end: verdicts, drives that need a look, what the others agree on, and what to run next."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from semcal_cli.batch.records import CSV, JSONL
from semcal_cli.batch.tasks import Outcome
from semcal_cli.cli.batch_progress import (
    STATUS_WIDTH,
    STYLES,
    counts_text,
    first_reason,
    words,
)
from semcal_cli.cli.tables import labelled, row, wrapped
from semcal_cli.errors import printable

MAX_NAMED = 8
"""Most drives that are named; the files name all."""
GOOD = ("trusted", "pass", "not_assessed")
"""Statuses of drives that need no look."""
MIN_AGREEING = 2
"""Least number of trusted drives that can agree on a pose."""


def print_end(console: Console, outcomes: Sequence[Outcome], folder: Path) -> None:
    """Print the end of a batch whose results are in a folder."""
    if console.quiet:
        return
    from semcal_cli.fleet.verdict import MIN_DRIVES

    done = Text(f"{len(outcomes):,} of {len(outcomes):,} drives: ") + counts_text(
        Counter(outcome.status for outcome in outcomes)
    )
    lines = [done, *_bad_drives(outcomes, folder)]
    trusted = [outcome.drive for outcome in outcomes if outcome.status == "trusted"]
    if len(trusted) >= MIN_AGREEING:
        lines += map(Text, _agreement(set(trusted), folder))
    lines += map(Text, _labelled("summary", f"{folder / CSV}, {folder / JSONL}"))
    if len(trusted) >= MIN_DRIVES:
        place = shlex.quote(str(folder))
        lines.append(Text(labelled("next", f"semcal fleet {place} --report fleet.html")))
    for line in lines:
        console.print(line)


def _bad_drives(outcomes: Sequence[Outcome], folder: Path) -> list[Text]:
    """Name the drives that need a look, the worst first, each with its first reason."""
    order = list(STYLES)
    bad = [outcome for outcome in outcomes if outcome.status not in GOOD]
    bad.sort(key=lambda outcome: (order.index(outcome.status), outcome.drive))
    lines: list[Text] = []
    for outcome in bad[:MAX_NAMED]:
        status = Text(f"{words(outcome.status):<{STATUS_WIDTH}}", STYLES[outcome.status])
        lines.append(status + Text(printable(outcome.drive)))
        if outcome.reasons:
            lines += [Text(line) for line in wrapped("", printable(first_reason(outcome)), STATUS_WIDTH)]
    if len(bad) > MAX_NAMED:
        lines.append(Text(f"and {len(bad) - MAX_NAMED:,} more: see {folder / CSV}"))
    return lines


def _agreement(trusted: set[str], folder: Path) -> list[str]:
    """Say what the trusted drives agree on, and how well that is known."""
    from semcal_cli.config import Limits
    from semcal_cli.errors import SemcalError
    from semcal_cli.fleet.combination import combine_drives
    from semcal_cli.fleet.members import read_members
    from semcal_cli.geometry.poses import camera_center
    from semcal_cli.result.intervals import widest

    try:
        members = [each for each in read_members([folder]) if each.drive in trusted and each.left_out is None]
        num_cameras = len({each.camera for each in members})
        if num_cameras > 1:
            several = f"none: the trusted drives have {num_cameras:,} different cameras, given or estimated"
            return _labelled("agreed pose", several)
        found = combine_drives(members, Limits())
    except SemcalError as error:
        return _labelled("agreed pose", f"none: {error}")
    T, known = found.T_camera_lidar, widest(found.parts[-1].half_widths.tolist())
    return [
        *_labelled("agreed pose", f"of {len(members):,} trusted drives: {known}"),
        *_labelled("camera at", f"{row(camera_center(T).tolist())} m in the LiDAR frame"),
        *_labelled("looks along", f"{row(T[2, :3].tolist())} in the LiDAR frame"),
        *(_labelled("note", found.reasons[0]) if found.verdict != "pass" and found.reasons else ()),
    ]


def _labelled(label: str, text: str) -> list[str]:
    return wrapped(label, printable(text))
