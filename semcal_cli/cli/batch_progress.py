"""The progress of a running batch on the terminal."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from rich.live import Live
from rich.table import Table
from rich.text import Text

from semcal_cli.batch.tasks import FAILED, Outcome
from semcal_cli.cli.terminal import make_console

RECENT = 12
"""Number of drives that the table shows."""


class BatchProgress:
    """Shows the progress of a batch: a live table on a terminal, or a line for each drive on a pipe."""

    def __init__(self, num_drives: int, quiet: bool) -> None:
        self.num_drives, self.num_done = num_drives, 0
        self._counts: Counter[str] = Counter()
        self._recent: deque[Outcome] = deque(maxlen=RECENT)
        self._console = make_console(quiet)
        self._live: Live | None = None

    def __enter__(self) -> BatchProgress:
        if self._console.is_terminal and not self._console.quiet:
            self._live = Live(self._table(), console=self._console, transient=True)
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.stop()
        counts = ", ".join(f"{count:,} {status}" for status, count in sorted(self._counts.items()))
        self._console.print(f"{self.num_done:,} of {self.num_drives:,} drives: {counts or 'none done'}")

    def tell(self, outcome: Outcome, is_new: bool) -> None:
        """Show the outcome of a drive."""
        self.num_done += 1
        self._counts[outcome.status] += 1
        if self._live is not None:
            self._recent.append(outcome)
            self._live.update(self._table())
        elif is_new or outcome.status == FAILED:
            reason = f": {outcome.reasons[0]}" if outcome.reasons else ""
            number = f"{self.num_done:>{len(str(self.num_drives))}}/{self.num_drives}"
            line = f"{number}  {outcome.status:<13}{outcome.drive}{reason}"
            self._console.print(line, markup=False)

    def settle(self, outcomes: Iterable[Outcome]) -> None:
        """Count the drives as the summary does: those whose results were removed during the run have failed."""
        self._counts = Counter(outcome.status for outcome in outcomes)

    def _table(self) -> Table:
        counts = ", ".join(f"{count:,} {status}" for status, count in sorted(self._counts.items()))
        table = Table(
            title=f"{self.num_done:,} of {self.num_drives:,} drives   {counts}", title_justify="left"
        )
        for column in ("drive", "status", "MI, nats", "reason"):
            table.add_column(column, no_wrap=True, overflow="ellipsis")
        for outcome in self._recent:
            information = outcome.mutual_information_nats
            table.add_row(
                Text(outcome.drive),
                outcome.status,
                "" if information is None else f"{information:.4f}",
                Text(outcome.reasons[0] if outcome.reasons else ""),
            )
        return table
