"""A run over many items that may be stopped or killed at any moment, and then goes on where it was."""

from __future__ import annotations

import fcntl
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TypeVar

from semcal_cli.errors import InputError

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")


def resume(
    items: Sequence[Item],
    read_outcome: Callable[[Item], Outcome | None],
    execute: Callable[[Sequence[Item]], Generator[Outcome, None, None]],
    *,
    on_done: Callable[[Outcome, bool], None],
    finish: Callable[[list[Outcome]], None],
) -> list[Outcome]:
    """Do all items that have no outcome yet.

    Args:
        items: What is to be done.
        read_outcome: Gives what came of an item, or None if it has yet to be done.
        execute: Does items, and gives what came of each as soon as it is done; it is closed when the run is stopped.
        on_done: Told each outcome, and whether it is new.
        finish: Told all outcomes at the end, or those that there are when the run is stopped.

    Returns:
        All outcomes: first those that were known, then the new ones as they came.
    """
    outcomes: list[Outcome] = []
    missing = []
    for item in items:
        known = read_outcome(item)
        if known is None:
            missing.append(item)
        else:
            outcomes.append(known)
            on_done(known, False)
    try:
        # Closed here, not whenever a traceback lets go of it: its processes end with it.
        with closing(execute(missing)) as new:
            for outcome in new:
                outcomes.append(outcome)
                on_done(outcome, True)
    finally:
        finish(outcomes)
    return outcomes


@contextmanager
def locked(file: Path, run: str) -> Iterator[None]:
    """Keep a file, and with it its folder, to this run; the lock goes with the process that holds it.

    Args:
        file: What is locked; it is made, with its folder, if it is not there.
        run: What kind of run this is, for the message.

    Raises:
        InputError: another process holds the lock, or the file cannot be written to.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        opened = file.open("a")
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {(error.strerror or str(error)).lower()}") from None
    with opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{file.parent}: found another {run} at work there, needed a folder of its own"
            ) from None
        yield
