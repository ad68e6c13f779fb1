"""The terminal output of a running command: a progress line, and a line for each stage."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import TracebackType

from rich.console import Console
from rich.progress import Progress as ProgressBar
from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

from semcal_cli.cli.tables import wrapped
from semcal_cli.drive.events import Event, Progress, StageDone, movement

STAGE_WIDTH = 20
"""Columns before what a stage did: its name and its time."""
COLORS = {
    **dict.fromkeys(("trusted", "pass"), "bold green"),
    **dict.fromkeys(("not_trusted", "fail"), "bold red"),
    **dict.fromkeys(("not_assessed", "inconclusive"), "bold yellow"),
}
"""Colour of each verdict."""


class Terminal:
    """Shows the events of a calibration on stderr; a context manager that owns the progress line."""

    def __init__(self, *, quiet: bool, verbose: bool = False) -> None:
        self.console = make_console(quiet)
        self.verbose = verbose
        self._stages: list[StageDone] = []
        self._line = ExitStack()
        self._show: Callable[[str], None] = lambda doing: None

    def __enter__(self) -> Terminal:
        self._show = self._line.enter_context(progress_line(self.console))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._line.close()

    def on_event(self, event: Event) -> None:
        """Show an event."""
        if isinstance(event, Progress):
            self._show(event.doing)
            return
        self._stages.append(event)
        did = [event.note] if event.moved is None else [movement(event.moved), event.note]
        if self.verbose:
            did.append(event.details)
            did += [] if event.agreement is None else [f"MI {event.agreement.mutual_information:.4f} nats"]
        head = f"{event.name:<8} {event.seconds:6.2f} s"
        self.print(*wrapped(head, ", ".join(filter(None, did)), STAGE_WIDTH))

    def print(self, *lines: str) -> None:
        """Print lines as they are."""
        for line in lines:
            self.console.print(line, markup=False)

    def print_verdict(self, line: str, status: str) -> None:
        """Print the line with the verdict, in its colour on a terminal."""
        self.console.print(line, style=COLORS[status], markup=False)

    def log_document(self, num_threads: int | None) -> dict[str, object]:
        """Document of times, host and threads."""
        stages = [
            {"name": s.name, "seconds": round(s.seconds, 4), "note": s.note, "details": s.details}
            for s in self._stages
        ]
        host = {
            "machine": platform.machine(),
            "system": platform.platform(),
            "python": platform.python_version(),
        }
        return {"stages": stages, "host": host, "threads": num_threads}


@contextmanager
def progress_line(console: Console) -> Iterator[Callable[[str], None]]:
    """Show the current work and its duration on a terminal."""
    if not console.is_terminal:
        yield lambda doing: None
        return
    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    with ProgressBar(*columns, console=console, transient=True) as progress:
        task = progress.add_task("")
        yield lambda doing: progress.update(task, description=doing)


def make_console(quiet: bool) -> Console:
    """Make a console on stderr that neither wraps nor highlights, so that a pipe gets plain lines."""
    return Console(stderr=True, quiet=quiet, highlight=False, soft_wrap=True, emoji=False)
