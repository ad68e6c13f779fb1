"""The terminal output of a running command: its current work, a line for each stage, the items of a run, and times."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.tables import labelled, wrapped
from semcal_cli.errors import first_of, printable
from semcal_cli.events import Event, Progress, StageDone, movement
from semcal_cli.many.batch.pace import Pace
from semcal_cli.readable import for_people

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as ProgressBar
    from rich.text import Text

STAGE_WIDTH = 20
"""Columns for the name and the time of a stage."""
COLORS = {
    **dict.fromkeys(("trusted", "pass"), "bold green"),
    **dict.fromkeys(("not_trusted", "fail", "failed"), "bold red"),
    **dict.fromkeys(("not_assessed", "inconclusive"), "bold yellow"),
}
"""Colour of each verdict."""
REFRESHES_PER_S = 2.0
BAR_WIDTH = 20
"""Columns of the bar that shows how much of the work is done."""
MAX_RUNNING = 16
"""Largest number of running items that are named."""
MINUTE_S, HOUR_S = 60.0, 3600.0
SWITCH = 1.5
"""A time is given in a unit from this multiple of it on."""
OF_TERMINALS = ("FORCE_COLOR", "TTY_COMPATIBLE")
"""Environment variables by which rich takes a stream for a terminal, or a terminal for none."""


class PlainConsole:
    """Prints lines to a stream that is no terminal, as rich would, whose import takes 14 ms."""

    is_terminal = False

    def __init__(self, quiet: bool, *, stderr: bool) -> None:
        self.quiet, self._stderr = quiet, stderr

    def print(self, line: str, *, style: str = "", markup: bool = False) -> None:
        """Print a line without a style."""
        if not self.quiet:
            click.echo(line, err=self._stderr)


class Terminal:
    """Shows the events of a calibration on stderr; a context manager that owns the progress line."""

    def __init__(self, *, quiet: bool, verbose: bool = False) -> None:
        self.console = line_console(quiet)
        self.verbose = verbose
        self._stages: list[StageDone] = []
        self._line: ProgressBar | None = None
        self._began, self._began_s = Progress(""), monotonic()

    def __enter__(self) -> Terminal:
        if not isinstance(self.console, PlainConsole) and self.console.is_terminal:
            from rich.progress import (
                BarColumn,
                Progress as ProgressBar,
                SpinnerColumn,
                TextColumn,
                TimeElapsedColumn,
            )

            columns = (
                SpinnerColumn(),
                TimeElapsedColumn(),
                BarColumn(BAR_WIDTH),
                TextColumn("{task.description}", markup=False),
            )
            self._line = ProgressBar(*columns, console=self.console, transient=True)
            self._line.add_task("", total=None)
            self._line.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._line is not None:
            self._line.stop()

    def show(self, doing: str) -> None:
        """Show on a terminal what is being done."""
        self._show(Progress(doing))

    def _show(self, progress: Progress) -> None:
        """Show on a terminal what is being done, how much of it is, for how long, and about how long the rest takes."""
        if self._line is None:
            return
        now, task = monotonic(), self._line.tasks[0]
        if progress.doing != self._began.doing:
            self._began, self._began_s = progress, now
        left, newly_done = "", progress.done - self._began.done
        if newly_done > 0 and progress.done < progress.of:
            left_s = (now - self._began_s) / newly_done * (progress.of - progress.done)
            left = f", {about(left_s)} left"
        task.total = progress.of or None  # `update` takes None for no change
        self._line.update(task.id, description=progress.doing + left, completed=progress.done)

    def on_event(self, event: Event) -> None:
        """Show an event."""
        if isinstance(event, Progress):
            self._show(event)
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
            self.console.print(for_people(line), markup=False)

    def print_changes(self, changes: Iterable[tuple[str, str]]) -> None:
        """Print how the camera and the clock of a result differ from those of a drive."""
        self.print(*(line for change in changes for line in wrapped(*change)))

    def print_path(self, label: str, path: Path) -> None:
        """Print the file that was written."""
        self.print(labelled(label, str(path)))

    def print_verdict(self, line: str, status: str) -> None:
        """Print the verdict in its colour on a terminal; in one line, if nothing else is printed."""
        text = " ".join(line.split()) if self.console.quiet else line
        line_console().print(text, style=COLORS[status], markup=False)

    def log_document(self, num_threads: int | None) -> dict[str, object]:
        """Make the document of times, host and threads."""
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


def make_console(quiet: bool = False, *, stderr: bool = True) -> Console:
    """Make a console that neither wraps nor highlights lines, so that a pipe gets them plain."""
    from rich.console import Console

    return Console(stderr=stderr, quiet=quiet, highlight=False, soft_wrap=True, emoji=False)


def line_console(quiet: bool = False, *, stderr: bool = True) -> Console | PlainConsole:
    """Make a console for lines."""
    stream = sys.stderr if stderr else sys.stdout
    is_terminal = stream is not None and stream.isatty()  # a closed stream is None
    may_be_one = is_terminal or any(name in os.environ for name in OF_TERMINALS)
    return make_console(quiet, stderr=stderr) if may_be_one else PlainConsole(quiet, stderr=stderr)


@contextmanager
def live_lines(console: Console, lines: Callable[[], Sequence[Text]]) -> Iterator[None]:
    """Show changing lines on a terminal, each cut to its width, until the work is done; nothing on a pipe."""
    if not console.is_terminal or console.quiet:
        yield
        return

    from rich.live import Live
    from rich.text import Text

    def shown() -> Text:
        texts = lines()
        for line in texts:
            line.truncate(console.width, overflow="ellipsis")
        return Text("\n").join(texts)

    with Live(get_renderable=shown, console=console, refresh_per_second=REFRESHES_PER_S, transient=True):
        yield


def running_lines(pace: Pace) -> list[Text]:
    """List the running items, each with the time since it began."""
    from rich.text import Text

    lines = [f"  {clock_time(elapsed_s):>8}  {printable(name)}" for name, elapsed_s in pace.running()]
    return [*map(Text, first_of(lines, MAX_RUNNING))]


def time_left(pace: Pace) -> str:
    """Describe about how long the rest takes; empty while nothing is known or nothing is left."""
    left_s = pace.left_s()
    if left_s is None or pace.num_left == 0:
        return ""
    return f"{about(left_s)} left"


def about(seconds: float) -> str:
    """Write a duration that is an estimate."""
    if seconds < SWITCH * MINUTE_S:
        return f"about {max(seconds, 1.0):.0f} s"
    if seconds < SWITCH * HOUR_S:
        return f"about {seconds / MINUTE_S:.0f} min"
    return f"about {seconds / HOUR_S:.1f} h"


def clock_time(seconds: float) -> str:
    """Write a duration as minutes and seconds, or as hours, minutes and seconds."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
