"""A run of a batch: finished drives stay, the others are run here or on a cluster, and the summary covers all."""

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
    """Run all drives that have no outcome yet, and write the summary of all, also when the run is stopped.

    Args:
        tasks: One task for each drive.
        folder: Folder of the summary; the tasks' folders are in it.
        execute: Function that runs tasks.
        force: Whether finished drives are run again.
        on_done: Called with each outcome, and whether it is new.

    Raises:
        InputError: another batch is using the folder, or it cannot be written to.
    """
    with locked(folder / LOCK, "batch"):
        return resume(
            tasks,
            (lambda task: None) if force else read_outcome,
            execute,
            on_done=on_done,
            finish=lambda outcomes: write_summary(outcomes, folder),
        )
