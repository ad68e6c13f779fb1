"""The run of one drive of a batch, in a process that may crash or hang."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TypeAlias

from semcal_cli.batch.folders import make_folder_of_drive
from semcal_cli.batch.records import FileState, read_inputs, write_record
from semcal_cli.batch.tasks import LOG, Outcome, Task, describe_result, failed
from semcal_cli.errors import InputError
from semcal_cli.files.messages import os_reason
from semcal_cli.jobs.processes import ProcessError, Worker, in_processes
from semcal_cli.jobs.resume import open_own

Execute: TypeAlias = Callable[[Sequence[Task]], Generator[Outcome, None, None]]
"""Function that runs tasks, and yields the outcome of each when it is done."""


@dataclass(frozen=True)
class Ended:
    """How the command of a task ended."""

    exit_code: int
    error: str
    """Message of a failure."""
    is_of_machine: bool
    """Whether it failed for the machine's reasons, not for the drive's."""


Run: TypeAlias = Callable[[Task], Ended]
"""Function that runs the command of a task; it is pickled for other processes."""


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
    inputs: dict[str, FileState | None] = {}
    is_timed_out = False
    try:
        make_folder_of_drive(task, folder)
        try:
            inputs = worker.ask(read_inputs, task, timeout_s=task.timeout_s)
            ended = worker.ask(run, task, timeout_s=_left_s(task, begun))
            outcome, is_of_machine = _outcome(folder, task, ended), ended.is_of_machine
        except ProcessError as error:
            is_timed_out = error.is_timed_out
            # A process that ends before the files of the drive are read does not do so by their content.
            is_of_machine = not is_timed_out and (error.is_from_outside or not inputs)
            outcome = _failure(task, error)
        if not is_of_machine:
            write_record(task, outcome, inputs, timed_out=is_timed_out)
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


def _outcome(folder: Path, task: Task, ended: Ended) -> Outcome:
    """Make the outcome of a drive whose command ended."""
    if ended.exit_code not in (0, 3, 4):
        return failed(task.drive, ended.error)
    return describe_result(task, ended.exit_code, task.result.relative_to(folder).as_posix())
