"""The pace of a run: what is being done, and how long the rest takes."""

import pytest
from rich.console import Console

from semcal_cli.cli import terminal
from semcal_cli.cli.terminal import (
    MAX_RUNNING,
    OF_TERMINALS,
    PlainConsole,
    Terminal,
    clock_time,
    live_lines,
    running_lines,
    time_left,
)
from semcal_cli.events import Progress
from semcal_cli.many.batch.pace import Pace


class Clock:
    """Seconds that only a test lets pass."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_the_rest_takes_as_long_as_the_mean_of_what_is_done() -> None:
    clock = Clock()
    pace = Pace(10, 2, clock)
    pace.skip()  # done in an earlier run, in no time
    pace.begin("a")
    pace.begin("b")
    assert pace.left_s() is None
    clock.now += 10.0
    pace.end("a")
    clock.now += 4.0
    pace.begin("c")
    pace.end("b")
    pace.begin("d")
    clock.now += 2.0
    # a took 10 s and b 14 s, 12 s in the mean; c and d have both had 2 s; five more wait for two jobs.
    assert pace.running() == [("c", 2.0), ("d", 2.0)]
    assert pace.left_s() == pytest.approx((10.0 + 10.0 + 5 * 12.0) / 2)
    for name in ("c", "d", "e", "f", "g", "h"):
        pace.end(name)
    pace.begin("i")
    assert pace.num_left == 1
    clock.now += 3.0
    # One job is idle: the last item is not halved.
    assert pace.left_s() == pytest.approx((10.0 + 14.0 + 2.0 + 2.0) / 4 - 3.0)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.2, "about 1 s left"),
        (89.0, "about 89 s left"),
        (91.0, "about 2 min left"),
        (9000.0, "about 2.5 h left"),
    ],
)
def test_words_for_the_time_left(seconds: float, words: str) -> None:
    clock = Clock()
    pace = Pace(2, 1, clock)
    pace.begin("a")
    assert time_left(pace) == ""
    clock.now += seconds
    pace.end("a")
    assert time_left(pace) == words
    pace.end("b")
    assert time_left(pace) == ""


def test_running_items_are_named_with_their_times() -> None:
    clock = Clock()
    pace = Pace(MAX_RUNNING + 2, MAX_RUNNING + 2, clock)
    pace.begin("a\x1b[31m")
    clock.now += 3725.0
    for number in range(MAX_RUNNING + 1):
        pace.begin(f"drive {number}")
    lines = [line.plain for line in running_lines(pace)]
    assert lines[:2] == ["   1:02:05  a\\x1b[31m", "      0:00  drive 0"]
    assert lines[-1] == "and 2 more"
    assert len(lines) == MAX_RUNNING + 1
    assert clock_time(59.9) == "0:59"


def test_lines_are_live_on_a_terminal_only(capsys: pytest.CaptureFixture[str]) -> None:
    pace = Pace(1, 1, Clock())
    pace.begin("the drive with a long name")
    for is_terminal, is_quiet, expected in ((True, False, True), (True, True, False), (False, False, False)):
        console = Console(force_terminal=is_terminal, quiet=is_quiet, width=30)
        with live_lines(console, lambda: running_lines(pace)):
            pass
        shown = capsys.readouterr().out
        assert ("0:00  the drive with a " in shown) == expected
        assert "long name" not in shown


def test_a_pipe_gets_the_lines_that_rich_would_print(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An empty FORCE_COLOR lets rich decide, which takes the pipe for none of its terminals either."""

    def printed() -> tuple[bool, str]:
        for is_quiet in (False, True):
            shown = Terminal(quiet=is_quiet)
            shown.print("[bold]a :smile: +- 1", "b" * 200)
            shown.print_verdict("verdict    trusted:\n           5 mm", "trusted")
        return isinstance(shown.console, PlainConsole), capsys.readouterr().err

    for name in OF_TERMINALS:
        monkeypatch.delenv(name, raising=False)
    is_plain, plain = printed()
    monkeypatch.setenv("FORCE_COLOR", "")
    is_still_plain, by_rich = printed()
    assert (is_plain, is_still_plain) == (True, False)
    assert by_rich == plain
    assert plain.count("verdict") == 2
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert "\x1b[1;32mverdict" in printed()[1]


def test_counted_work_has_a_bar_and_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = Clock()
    monkeypatch.setattr(terminal, "monotonic", clock)
    shown = Terminal(quiet=False)
    shown.console = Console(stderr=True, force_terminal=True, width=80, color_system=None)

    def line() -> str:
        assert shown._line is not None
        shown._line.refresh()
        return capsys.readouterr().err.split("\r")[-1]

    def counts() -> tuple[float, float | None]:
        assert shown._line is not None
        return shown._line.tasks[0].completed, shown._line.tasks[0].total

    with shown:
        shown.on_event(Progress("refining"))
        assert "left" not in line()
        clock.now += 4.0
        shown.on_event(Progress("refining", 1, 4))
        assert "refining, about 12 s left" in line()
        assert counts() == (1, 4)
        # Other work begins a new count.
        shown.on_event(Progress("assessing"))
        assert counts() == (0, None)
        clock.now += 1.0
        shown.on_event(Progress("assessing", 3, 4))
        assert "assessing, about 1 s left" in line()
        shown.on_event(Progress("assessing", 4, 4))
        assert "left" not in line()
        # Nothing is known of what was done before.
        shown.on_event(Progress("accumulating", 60, 100))
        assert "left" not in line()
        clock.now += 2.0
        shown.on_event(Progress("accumulating", 80, 100))
        assert "about 2 s left" in line()
