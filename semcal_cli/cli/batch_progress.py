"""What a batch prints while it runs and at its end: verdicts, drives that need a look, what the others agree on."""

from __future__ import annotations

import shlex
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console
from rich.text import Text

from semcal_cli.cli.tables import group_rows, labelled, pose_rows, wrapped
from semcal_cli.cli.terminal import COLORS, live_lines, make_console, running_lines, time_left
from semcal_cli.errors import SemcalError, printable
from semcal_cli.many.batch.pace import Pace
from semcal_cli.many.batch.records import CSV, JSONL
from semcal_cli.many.batch.tasks import Outcome

RECENT = 8
"""Number of finished drives that are shown."""
WORST_FIRST = ("fail", "not_trusted", "inconclusive", "not_assessed", "trusted", "pass")
STYLES = {"failed": COLORS["fail"], **{status: COLORS[status] for status in WORST_FIRST}}
"""Colour of each status, worst first."""
STATUS_WIDTH = 14
MAX_NAMED = 8
"""Largest number of drives that are named at the end; the files list all."""
GOOD = ("trusted", "pass", "not_assessed")
"""Statuses of drives that need no look."""
MIN_AGREEING = 2
"""Smallest number of trusted drives that can agree on a pose."""


class BatchProgress(Pace):
    """Shows the progress of a batch: running and finished drives on a terminal, or one line per drive on a pipe."""

    def __init__(self, num_drives: int, num_jobs: int, quiet: bool) -> None:
        super().__init__(num_drives, num_jobs)
        self.console = make_console(quiet)
        self._counts: Counter[str] = Counter()
        self._recent: deque[Outcome] = deque(maxlen=RECENT)
        self._live = ExitStack()

    def __enter__(self) -> BatchProgress:
        self._live.enter_context(live_lines(self.console, self._lines))
        return self

    def __exit__(self, *error: object) -> None:
        self._live.close()

    def tell(self, outcome: Outcome, is_new: bool) -> None:
        """Show the outcome of a drive."""
        self._counts[outcome.status] += 1
        if is_new:
            self.end(outcome.drive)
            self._recent.append(outcome)
        else:
            self.skip()
        if not self.console.is_terminal and (is_new or outcome.is_failed):
            number = f"{self.num_done:>{len(str(self.num_items))}}/{self.num_items}"
            reason = f": {outcome.reasons[0]}" if outcome.reasons else ""
            line = printable(f"{number}  {outcome.status:<13}{outcome.drive}{reason}")
            self.console.print(line, markup=False)

    def _lines(self) -> list[Text]:
        title = [Text(f"{self.num_done:,} of {self.num_items:,} drives"), _counts_text(self._counts)]
        shown = [part for part in (*title, Text(time_left(self))) if part]
        return [Text("   ").join(shown), *running_lines(self), *map(_outcome_text, self._recent)]


def _counts_text(counts: Counter[str]) -> Text:
    parts = [
        Text(f"{counts[status]:,} {status.replace('_', ' ')}", style)
        for status, style in STYLES.items()
        if counts[status]
    ]
    return Text(", ").join(parts)


def _outcome_text(outcome: Outcome) -> Text:
    reason = f": {_first_reason(outcome)}" if outcome.reasons else ""
    return _status_text(outcome.status) + Text(printable(f"{outcome.drive}{reason}"))


def _first_reason(outcome: Outcome) -> str:
    """Return the first reason of an outcome, with files relative to the drive, whose name is printed before it."""
    reason = outcome.reasons[0].removeprefix(f"{Path(outcome.drive).absolute()}/")
    return reason.removeprefix(f"{outcome.drive}/")


def _status_text(status: str) -> Text:
    """Write a status as words in its colour, padded to the column of statuses."""
    return Text(f"{status.replace('_', ' '):<{STATUS_WIDTH}}", STYLES[status])


def print_end(console: Console, outcomes: Sequence[Outcome], folder: Path) -> None:
    """Print the summary of a batch whose results are in a folder."""
    if console.quiet:
        return
    from semcal_cli.fleet.fleet_verdict import MIN_DRIVES

    counts = _counts_text(Counter(outcome.status for outcome in outcomes))
    done = Text(f"{len(outcomes):,} of {len(outcomes):,} drives: ") + counts
    lines = [done, *_bad_drives(outcomes, folder)]
    trusted = [outcome.drive for outcome in outcomes if outcome.status == "trusted"]
    rows = _agreement(set(trusted), folder) if len(trusted) >= MIN_AGREEING else []
    rows.append(("summary", f"{folder / CSV}, {folder / JSONL}"))
    lines += [Text(line) for row in rows for line in wrapped(*row)]
    if len(trusted) >= MIN_DRIVES:
        place = shlex.quote(str(folder))
        lines.append(Text(labelled("next", f"semcal fleet {place} --report fleet.html")))
    for line in lines:
        console.print(line)


def _bad_drives(outcomes: Sequence[Outcome], folder: Path) -> list[Text]:
    """Name the drives that need a look, worst first, each with its first reason."""
    order = list(STYLES)
    bad = [outcome for outcome in outcomes if outcome.status not in GOOD]
    bad.sort(key=lambda outcome: (order.index(outcome.status), outcome.drive))
    lines: list[Text] = []
    for outcome in bad[:MAX_NAMED]:
        lines.append(_status_text(outcome.status) + Text(printable(outcome.drive)))
        if outcome.reasons:
            lines += [Text(line) for line in wrapped("", _first_reason(outcome), STATUS_WIDTH)]
    if len(bad) > MAX_NAMED:
        lines.append(Text(f"and {len(bad) - MAX_NAMED:,} more: see {folder / CSV}"))
    return lines


def _agreement(trusted: set[str], folder: Path) -> list[tuple[str, str]]:
    """Describe the pose that the trusted drives agree on, and its uncertainty, as labels and texts."""
    from semcal_cli.config import Limits
    from semcal_cli.fleet.combination import combine_drives
    from semcal_cli.fleet.fleet_drives import read_fleet_drives
    from semcal_cli.fleet.groups import groups_that_agree
    from semcal_cli.result.uncertainty import widest

    try:
        drives = [
            drive for drive in read_fleet_drives([folder]) if drive.name in trusted and drive.left_out is None
        ]
        groups = groups_that_agree(drives, Limits())
        fleet = combine_drives(drives, Limits()) if len({drive.camera for drive in drives}) == 1 else None
    except SemcalError as error:
        return [("agreed pose", f"none: {error}")]
    if fleet is None or (len(groups) > 1 and fleet.drift is None):
        return group_rows(groups)
    half_widths = widest(fleet.parts[-1].half_widths.tolist())
    return [
        ("agreed pose", f"of {len(drives):,} trusted drives: {half_widths}"),
        *pose_rows(fleet.T_camera_lidar),
        *([("note", fleet.reasons[0])] if fleet.verdict != "pass" and fleet.reasons else ()),
    ]
