"""What a run over many items shows on a terminal while it works, and words for times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.text import Text

from semcal_cli.batch.pace import Pace
from semcal_cli.errors import printable

REFRESHES_PER_S = 2.0
MAX_RUNNING = 16
"""Most running items that are named."""
MINUTE_S, HOUR_S = 60.0, 3600.0
SWITCH = 1.5
"""Multiple of a unit from which a time is told in it."""


@contextmanager
def live_lines(console: Console, lines: Callable[[], Sequence[Text]]) -> Iterator[None]:
    """Show lines that change on a terminal, each cut to its width, until the work is done; nothing on a pipe."""
    if not console.is_terminal or console.quiet:
        yield
        return

    def shown() -> Text:
        found = lines()
        for line in found:
            line.truncate(console.width, overflow="ellipsis")
        return Text("\n").join(found)

    with Live(get_renderable=shown, console=console, refresh_per_second=REFRESHES_PER_S, transient=True):
        yield


def running_lines(pace: Pace) -> list[Text]:
    """List the items that are being done, each with the time since it began."""
    running = pace.running()
    lines = [Text(f"  {clock_time(elapsed_s):>8}  {printable(name)}") for name, elapsed_s in running]
    more = [Text(f"and {len(lines) - MAX_RUNNING:,} more")] if len(lines) > MAX_RUNNING else []
    return [*lines[:MAX_RUNNING], *more]


def time_left(pace: Pace) -> str:
    """Tell about how long the rest takes; empty while nothing is known or nothing is left."""
    left_s = pace.left_s()
    if left_s is None or pace.num_left == 0:
        return ""
    if left_s < SWITCH * MINUTE_S:
        return f"about {max(left_s, 1.0):.0f} s left"
    if left_s < SWITCH * HOUR_S:
        return f"about {left_s / MINUTE_S:.0f} min left"
    return f"about {left_s / HOUR_S:.1f} h left"


def clock_time(seconds: float) -> str:
    """Write a duration as minutes and seconds, or as hours, minutes and seconds."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
