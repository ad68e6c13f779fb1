"""The progress of an experiment on the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.text import Text

from semcal_cli.cli.live import clock_time, live_lines, running_lines, time_left
from semcal_cli.cli.terminal import make_console
from semcal_cli.jobs.pace import Pace
from semcal_cli.jobs.watcher import Watcher


class ExperimentProgress(Watcher):
    """Shows the runs of an experiment: the running ones on a terminal, or a line for each finished one on a pipe."""

    def __init__(self, console: Console, num_jobs: int) -> None:
        self._console, self._num_jobs = console, num_jobs
        self._num_runs = 0
        self._pace = Pace(0, num_jobs)
        self._started = monotonic()

    def resume(self, num_done: int, num_items: int) -> None:
        """Begin to count; runs of before are no measure of how long the others take."""
        self._num_runs = num_items
        self._pace = Pace(num_items - num_done, self._num_jobs)
        if num_done and not self._console.is_terminal:
            self._console.print(f"{num_done:,} of {num_items:,} runs are done already")

    def begin(self, item: str) -> None:
        """Show a run that begins."""
        self._pace.begin(item)

    def end(self, item: str) -> None:
        """Count a run, and name it on a pipe."""
        self._pace.end(item)
        if not self._console.is_terminal:
            left = time_left(self._pace)
            told = ", ".join([f"after {clock_time(monotonic() - self._started)}", *([left] if left else [])])
            number = f"{self._num_done:>{len(str(self._num_runs))}}/{self._num_runs}"
            self._console.print(f"{number}  {item}  ({told})", markup=False)

    def lines(self) -> list[Text]:
        """Say how many runs are done and about how long the others take, and name those that are running."""
        count = f"{self._num_done:,} of {self._num_runs:,} runs are done"
        left = time_left(self._pace)
        return [Text("   ".join([count, *([left] if left else [])])), *running_lines(self._pace)]

    @property
    def _num_done(self) -> int:
        return self._num_runs - self._pace.num_left


@contextmanager
def experiment_progress(num_jobs: int) -> Iterator[ExperimentProgress]:
    """Show the progress of an experiment on stderr while it runs."""
    console = make_console(quiet=False)
    progress = ExperimentProgress(console, num_jobs)
    with live_lines(console, progress.lines):
        yield progress
