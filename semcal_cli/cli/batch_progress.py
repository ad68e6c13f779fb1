"""The progress of a running batch on the terminal."""

from __future__ import annotations

from collections import Counter, deque
from contextlib import ExitStack
from pathlib import Path

from rich.text import Text

from semcal_cli.batch.pace import Pace
from semcal_cli.batch.tasks import FAILED, Outcome
from semcal_cli.cli.live import live_lines, running_lines, time_left
from semcal_cli.cli.terminal import make_console
from semcal_cli.errors import printable

RECENT = 8
"""Number of drives that are shown after they are done."""
STYLES = {
    "failed": "bold red",
    "fail": "bold red",
    "not_trusted": "bold red",
    "inconclusive": "bold yellow",
    "not_assessed": "bold yellow",
    "trusted": "bold green",
    "pass": "bold green",
}
"""Colour of each status, the worst first."""
STATUS_WIDTH = 14


class BatchProgress(Pace):
    """Shows the progress of a batch: running and finished drives on a terminal, or a line for each drive on a pipe."""

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
        if not self.console.is_terminal and (is_new or outcome.status == FAILED):
            number = f"{self.num_done:>{len(str(self.num_items))}}/{self.num_items}"
            reason = f": {outcome.reasons[0]}" if outcome.reasons else ""
            line = printable(f"{number}  {outcome.status:<13}{outcome.drive}{reason}")
            self.console.print(line, markup=False)

    def _lines(self) -> list[Text]:
        title = [Text(f"{self.num_done:,} of {self.num_items:,} drives"), counts_text(self._counts)]
        shown = [part for part in (*title, Text(time_left(self))) if part]
        return [Text("   ").join(shown), *running_lines(self), *map(outcome_text, self._recent)]


def counts_text(counts: Counter[str]) -> Text:
    """Tell how many drives have each status, the worst first, in its colour on a terminal."""
    parts = [
        Text(f"{counts[status]:,} {words(status)}", style)
        for status, style in STYLES.items()
        if counts[status]
    ]
    return Text(", ").join(parts)


def outcome_text(outcome: Outcome) -> Text:
    """Name the status of a drive, the drive, and the first reason."""
    reason = f": {first_reason(outcome)}" if outcome.reasons else ""
    status = Text(f"{words(outcome.status):<{STATUS_WIDTH}}", STYLES[outcome.status])
    return status + Text(printable(f"{outcome.drive}{reason}"))


def first_reason(outcome: Outcome) -> str:
    """Give the first reason of an outcome; files are named from the drive on, whose name stands before it."""
    reason = outcome.reasons[0].removeprefix(f"{Path(outcome.drive).absolute()}/")
    return reason.removeprefix(f"{outcome.drive}/")


def words(status: str) -> str:
    """Write a status as words."""
    return status.replace("_", " ")
