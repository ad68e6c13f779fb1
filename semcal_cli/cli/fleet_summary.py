"""What the terminal says of a fleet: what is wrong, what holds now, the files, and the verdict last."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from semcal_cli.assessment.limits import IN_ALL
from semcal_cli.cli.tables import LABEL_WIDTH, labelled, matrix_lines
from semcal_cli.cli.terminal import COLORS
from semcal_cli.errors import printable
from semcal_cli.fleet.verdict import check_words, title, total
from semcal_cli.result.intervals import intervals

if TYPE_CHECKING:
    from rich.console import Console

    from semcal_cli.assessment.limits import Check
    from semcal_cli.fleet.fleet import ComparedDrive, Fleet

MAX_LINES = 20
"""Largest number of drives or checks of one kind that the terminal names; files name all."""
COLUMNS = 80
NO_BREAK = "\u00a0"
"""Space at which no line is broken."""


def print_fleet(fleet: Fleet, written: Sequence[Path], console: Console) -> None:
    """Print the summary of a fleet.

    Args:
        fleet: Combined result.
        written: Files that were written.
        console: Console that is printed on.
    """
    for line in summary_lines(fleet, written):
        # Names of drives may contain markup.
        console.print(printable(line), markup=False)
    verdict = f"{fleet.verdict}: {title(fleet)[0].lower()}{title(fleet)[1:]}"
    console.print(printable(labelled("verdict", verdict)), style=COLORS[fleet.verdict], markup=False)


def summary_lines(fleet: Fleet, written: Sequence[Path]) -> list[str]:
    """Describe a fleet as lines of text, up to its verdict."""
    num_used, num_all = len(fleet.drives), len(fleet.drives) + len(fleet.left_out)
    order = "in the order of their stamps" if fleet.order == "stamp" else "in the order of their names"
    last = fleet.parts[-1]
    return [
        *_rows("drives", [f"{num_used:,} of {num_all:,} used, {order}"]),
        *_rows("left out", _first(f"{member.drive}: {member.left_out}" for member in fleet.left_out)),
        *_rows("note", fleet.notes),
        *_rows("apart", _first(map(_apart, _worst_first(fleet.drives)))),
        *_check_lines(fleet.checks),
        *_rows("reasons", fleet.reasons),
        *_rows("T_camera_lidar", matrix_lines(fleet.T_camera_lidar)),
        *_rows("holds", [f"at {last.last}" if fleet.drift is not None else f"from {last.first} on"]),
        *_rows("95 % interval", intervals(last.half_widths.tolist())),
        *_rows("written to", map(str, written)),
    ]


def _worst_first(drives: Sequence[ComparedDrive]) -> list[ComparedDrive]:
    apart = [drive for drive in drives if drive.disagrees or drive.is_far]
    return sorted(apart, key=lambda drive: (drive.verdict != "fail", not drive.is_far))


def _apart(drive: ComparedDrive) -> str:
    verdict = "disagrees, within what is allowed"
    if drive.is_far:
        verdict = "surely beyond what is allowed" if drive.verdict == "fail" else "perhaps beyond"
    return f"{drive.member.drive}: {total(drive.offset)} off, {verdict}"


def _check_lines(checks: Sequence[Check]) -> Iterator[str]:
    """List the totals, and what does not pass, under the subject of each."""
    shown = [check for check in checks if check.name.endswith(IN_ALL) or check.verdict != "pass"]
    last = None
    for check in shown[:MAX_LINES]:
        told = check_words(check)
        if told.subject != last:
            yield from _wrapped(told.subject, COLUMNS)
        last, unit = told.subject, told.unit[:3]
        found = f"  {told.quantity:<26}{told.found:>9} +- {told.half_width:<8} {unit:<3}"
        yield f"{found} allowed {told.allowed:<7}{check.verdict}"
    if len(shown) > MAX_LINES:
        yield f"  and {len(shown) - MAX_LINES:,} more"


def _first(lines: Iterable[str]) -> list[str]:
    found = list(lines)
    more = [f"and {len(found) - MAX_LINES:,} more"] if len(found) > MAX_LINES else []
    return [*found[:MAX_LINES], *more]


def _rows(label: str, lines: Iterable[str]) -> Iterator[str]:
    """Label the first of some lines, each broken to the width of a terminal; names stay whole."""
    for line in lines:
        is_text = len(line) > COLUMNS - LABEL_WIDTH
        for piece in _wrapped(line, COLUMNS - LABEL_WIDTH) if is_text else [line]:
            yield labelled(label, piece)
            label = ""


def _wrapped(line: str, columns: int) -> list[str]:
    """Break a line between words; names, and intervals with their signs, stay whole."""
    whole = line.replace("+- ", f"+-{NO_BREAK}")
    pieces = wrap(whole, columns, break_long_words=False, break_on_hyphens=False)
    return [piece.replace(NO_BREAK, " ") for piece in pieces]
