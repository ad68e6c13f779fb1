"""The run of one drive of a batch, in a process that may crash or hang."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import TypeAlias

from semcal_cli.batch.folders import make_folder_of_drive
from semcal_cli.batch.processes import ProcessError, Worker, in_processes
from semcal_cli.batch.records import Inputs, read_inputs, write_record
from semcal_cli.batch.resume import open_own
from semcal_cli.batch.tasks import LOG, Outcome, Task, failed
from semcal_cli.errors import InputError, os_reason

Execute: TypeAlias = Callable[[Sequence[Task]], Generator[Outcome, None, None]]
"""Function that runs tasks, and yields the outcome of each when it is done."""


Run: TypeAlias = Callable[[Task, Inputs], Outcome]
"""Function that runs the command of a task in its process, and records the outcome unless the machine failed."""


def execute_here(
    folder: Path, num_jobs: int, run: Run, on_begin: Callable[[str], None] = lambda drive: None
) -> Execute:
    """Run tasks on this machine.

    Args:
        folder: Folder of all results.
        num_jobs: Number of tasks at a time.
        run: Function that runs the command of a task.
        on_begin: Called with each drive when it begins, by several threads.
    """

    def do(worker: Worker, task: Task) -> Outcome:
        on_begin(task.drive)
        return execute_task(folder, worker, run, task)

    return lambda tasks: in_processes(tasks, do, num_jobs)


def execute_task(folder: Path, worker: Worker, run: Run, task: Task) -> Outcome:
    """Run the task of a drive, and record its outcome; a folder that cannot be written fails only this drive.

    A failure of the machine is not recorded, so that the next run does the drive again.

    Raises:
        CancelledError: the batch was stopped.
    """
    begun = monotonic()
    inputs: Inputs = {}
    try:
        make_folder_of_drive(task, folder)
        try:
            inputs = worker.ask(read_inputs, task, timeout_s=task.timeout_s)
            return worker.ask(run, task, inputs, timeout_s=_left_s(task, begun))
        except ProcessError as error:
            outcome = _failure(task, error)
            # A process that ends before the files of the drive are read does not do so by their content.
            if error.is_timed_out or (inputs and not error.is_from_outside):
                write_record(task, outcome, inputs, timed_out=error.is_timed_out)
            return outcome
    except InputError as error:
        return failed(task.drive, str(error))
    except OSError as error:
        return failed(task.drive, f"{error.filename or task.folder}: {os_reason(error)}")
    except MemoryError as error:  # The process can read no files, and goes on with the next drive.
        return failed(task.drive, f"MemoryError: {error}")


def _left_s(task: Task, begun: float) -> float | None:
    """Tell the seconds that are left of a drive's time, which are more than none; None without a limit."""
    if task.timeout_s is None:
        return None
    return max(task.timeout_s - (monotonic() - begun), sys.float_info.min)


def _failure(task: Task, error: ProcessError) -> Outcome:
    """Make the outcome of a drive whose process ended, and tell the log."""
    reason = f"timed out after {task.timeout_s:g} s" if error.is_timed_out else str(error)
    with suppress(OSError, InputError), open_own(Path(task.folder) / LOG) as log:
        log.write(f"{reason}\n".encode())
    return failed(task.drive, reason)
