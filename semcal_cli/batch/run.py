"""A batch: what is done stays, what is missing is done, here or on a cluster, and the summary is of all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from semcal_cli.batch.execution import Execute
from semcal_cli.batch.summary import write_summary
from semcal_cli.batch.tasks import Outcome, Task, read_outcome
from semcal_cli.jobs.resume import locked, resume

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
    with locked(folder / LOCK, "batch"):
        return resume(
            tasks,
            (lambda task: None) if force else read_outcome,
            execute,
            on_done=on_done,
            finish=lambda outcomes: write_summary(outcomes, folder),
        )
