"""A run of a batch: finished drives stay, the others are run here or on a cluster, and the summary covers all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

from semcal_cli.batch.execution import Execute
from semcal_cli.batch.folders import claimed, is_still_claimed
from semcal_cli.batch.records import read_outcome
from semcal_cli.batch.resume import resume
from semcal_cli.batch.summary import write_summary
from semcal_cli.batch.tasks import Outcome, Task, failed
from semcal_cli.files.kinds import FILE, kind_of


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

    Returns:
        Outcomes as the summary has them: a drive whose result was removed during the run has failed.

    Raises:
        InputError: another batch is using the folder, or it cannot be written to.
    """
    with claimed(folder) as lock:

        def finish(outcomes: list[Outcome]) -> None:
            outcomes[:] = [_with_result(outcome, folder) for outcome in outcomes]
            with nullcontext() if is_still_claimed(lock, folder) else claimed(folder):
                write_summary(outcomes, folder)

        return resume(
            tasks,
            (lambda task: None) if force else read_outcome,
            execute,
            on_done=on_done,
            finish=finish,
        )


def _with_result(outcome: Outcome, folder: Path) -> Outcome:
    """Keep an outcome whose result is there; without it, the drive has failed."""
    if outcome.result is None or kind_of(folder / outcome.result) == FILE:
        return outcome
    return failed(
        outcome.drive, f"{folder / outcome.result}: found nothing when the run ended, needed the result"
    )
