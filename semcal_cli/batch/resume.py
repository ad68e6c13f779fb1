"""A run over many items that can be stopped or killed at any moment, and then resumes where it was."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import BinaryIO, TypeVar

from semcal_cli.errors import InputError, os_reason
from semcal_cli.files.kinds import check_own_file

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
        items: All items of the run.
        read_outcome: Reads the outcome of an item; None if the item is not done yet.
        execute: Works on items, and yields the outcome of each when it is done; closed when the run is stopped.
        on_done: Called with each outcome, and whether it is new.
        finish: Called with all outcomes at the end, or with those there are when the run is stopped; it may change
            the list.

    Returns:
        All outcomes, as `finish` leaves them: first those already known, then the new ones in the order of their
        completion.
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
        # The generator is closed here, not when a traceback releases it: its processes end with it.
        with closing(execute(missing)) as new:
            for outcome in new:
                outcomes.append(outcome)
                on_done(outcome, True)
    finally:
        finish(outcomes)
    return outcomes


@contextmanager
def locked(file: Path, run: str) -> Iterator[int]:
    """Lock a file, and with it its folder, for this run; the lock ends with the process that holds it.

    Args:
        file: File to lock; it is created, with its folder, if it is missing.
        run: Kind of the run, for the message.

    Yields:
        Descriptor of the file, to append to it.

    Raises:
        InputError: another process holds the lock, or the file is none or cannot be written to.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {os_reason(error)}") from None
    with open_own(file) as opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{file.parent}: found another {run} at work there, needed a folder of its own"
            ) from None
        yield opened.fileno()


def open_own(file: Path) -> BinaryIO:
    """Open a file of our own to append to it; it is created if it is missing.

    Raises:
        InputError: a link, a pipe or a folder stands there, or the file cannot be written to.
    """
    check_own_file(file)
    try:
        # What takes the file's place now is not followed either, and its opening does not wait for a reader.
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        return os.fdopen(os.open(file, flags, 0o666), "ab", buffering=0)
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {os_reason(error)}") from None
