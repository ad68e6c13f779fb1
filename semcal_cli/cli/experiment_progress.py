"""The progress of an experiment on the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.text import Text

from semcal_cli.batch.pace import Pace
from semcal_cli.cli.terminal import clock_time, live_lines, make_console, running_lines, time_left


class ExperimentProgress(Pace):
    """Shows the runs of an experiment: the running ones on a terminal, or a line for each finished one on a pipe."""

    def __init__(self, console: Console, num_jobs: int) -> None:
        super().__init__(0, num_jobs)
        self._console, self._began = console, monotonic()

    def resume(self, num_done: int, num_items: int) -> None:
        """Tell how many runs are done already."""
        super().resume(num_done, num_items)
        if num_done and not self._console.is_terminal:
            self._console.print(f"{num_done:,} of {num_items:,} runs are done already")

    def end(self, name: str) -> None:
        """Count a run, and name it on a pipe."""
        super().end(name)
        if not self._console.is_terminal:
            left = time_left(self)
            told = ", ".join([f"after {clock_time(monotonic() - self._began)}", *([left] if left else [])])
            number = f"{self.num_done:>{len(str(self.num_items))}}/{self.num_items}"
            self._console.print(f"{number}  {name}  ({told})", markup=False)

    def lines(self) -> list[Text]:
        """Say how many runs are done and about how long the others take, and name those that are running."""
        count = f"{self.num_done:,} of {self.num_items:,} runs are done"
        left = time_left(self)
        return [Text("   ".join([count, *([left] if left else [])])), *running_lines(self)]


@contextmanager
def experiment_progress(num_jobs: int) -> Iterator[ExperimentProgress]:
    """Show the progress of an experiment on stderr while it runs."""
    console = make_console(quiet=False)
    progress = ExperimentProgress(console, num_jobs)
    with live_lines(console, progress.lines):
        yield progress
