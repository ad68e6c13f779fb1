"""A batch: what is done stays, what is missing is done, here or on a cluster, and the summary is of all."""

from __future__ import annotations

import fcntl
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

from semcal_cli.batch.summary import write_summary
from semcal_cli.batch.tasks import Outcome, Task, read_outcome
from semcal_cli.batch.worker import Workers
from semcal_cli.errors import InputError

Execute: TypeAlias = Callable[[Sequence[Task]], Iterator[Outcome]]
"""Does tasks, and gives what came of each when it is done."""
LOCK = ".lock"


def run_batch(
    tasks: Sequence[Task],
    folder: Path,
    execute: Execute,
    *,
    force: bool = False,
    on_done: Callable[[Outcome, bool], None] = lambda outcome, is_new: None,
) -> list[Outcome]:
    """Do all drives that have no outcome yet, and write the summary of all: also when it is stopped, of what there is.

    Args:
        tasks: One for each drive.
        folder: Where the summary goes; the tasks' folders are in it.
        execute: Does tasks.
        force: Do again what is done.
        on_done: Told each outcome, and whether it is new.

    Raises:
        InputError: the folder is another batch's at this moment, or cannot be written to.
    """
    outcomes: list[Outcome] = []
    with _locked(folder):
        missing = []
        for task in tasks:
            known = None if force else read_outcome(task)
            if known is None:
                missing.append(task)
            else:
                outcomes.append(known)
                on_done(known, False)
        try:
            for outcome in execute(missing):
                outcomes.append(outcome)
                on_done(outcome, True)
        finally:
            write_summary(outcomes, folder)
    return outcomes


def execute_here(folder: Path, num_jobs: int) -> Execute:
    """Do tasks on this machine, so many at a time."""

    def execute(tasks: Sequence[Task]) -> Iterator[Outcome]:
        workers = Workers(folder)
        # Not in a `with`: that would wait for all drives when one process of ours is told to stop.
        pool = ThreadPoolExecutor(num_jobs)
        try:
            for done in as_completed([pool.submit(workers.execute, task) for task in tasks]):
                yield done.result()
        finally:
            workers.stop()
            pool.shutdown(cancel_futures=True)
            workers.close()

    return execute


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep a folder to ourselves; the lock goes with the process that holds it."""
    path = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = path.open("w")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {(error.strerror or str(error)).lower()}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{folder}: found another batch at work there, needed a folder of its own"
            ) from None
        yield
