"""A run over many drives, which may be stopped or killed at any moment and then resumes.

Each drive runs in a process that may crash or hang. A failure of the machine is not an outcome of the drive: the next
run repeats the drive.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, nullcontext, suppress
from pathlib import Path
from time import monotonic
from typing import TypeAlias, TypeVar

from semcal_cli.errors import InputError, os_reason
from semcal_cli.files.input_files import FILE, kind_of
from semcal_cli.files.output_files import open_own
from semcal_cli.many.batch.folders import claim_folder, is_still_claimed, make_folder_of_drive
from semcal_cli.many.batch.processes import ProcessError, Worker, in_processes
from semcal_cli.many.batch.records import Inputs, read_inputs, read_outcome, write_record, write_summary
from semcal_cli.many.batch.tasks import Outcome, Task, failed_outcome

Execute: TypeAlias = Callable[[Sequence[Task]], Generator[Outcome, None, None]]
"""Function that runs tasks and yields the outcome of each when it is done."""
Run: TypeAlias = Callable[[Task, Inputs], Outcome]
"""Function that runs the command of a task in its process and records the outcome unless the machine failed."""
Item = TypeVar("Item")
Result = TypeVar("Result")

MACHINE_ERRORS = frozenset(
    {
        *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO),
        *(errno.ENOMEM, errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.EBUSY, errno.EINTR, errno.ENOLCK),
        *(errno.ESTALE, errno.ETIMEDOUT, errno.ENOTCONN, errno.EHOSTDOWN, errno.EHOSTUNREACH, errno.ENETDOWN),
    }
)
"""System errors that no content of a file causes: full or broken disks, limits, lost storage."""


def run_batch(
    tasks: Sequence[Task],
    folder: Path,
    execute: Execute,
    *,
    force: bool = False,
    on_done: Callable[[Outcome, bool], None] = lambda outcome, is_new: None,
) -> list[Outcome]:
    """Run all drives that have no outcome yet, and write the summary of all, even when the run is stopped.

    Args:
        tasks: One task for each drive.
        folder: Folder of the summary; the tasks' folders are in it.
        execute: Function that runs tasks.
        force: Whether finished drives are run again.
        on_done: Called with each outcome, and whether it is new.

    Returns:
        Outcomes as in the summary: a drive whose result was removed during the run has failed.

    Raises:
        InputError: another batch is using the folder, or it cannot be written to.
    """

    def check_result(outcome: Outcome) -> Outcome:
        if outcome.result is None or kind_of(folder / outcome.result) == FILE:
            return outcome
        reason = f"{folder / outcome.result}: found no file when the run ended, expected the result"
        return failed_outcome(outcome.drive, reason)

    with claim_folder(folder) as lock:

        def finish(outcomes: list[Outcome]) -> None:
            outcomes[:] = map(check_result, outcomes)
            with nullcontext() if is_still_claimed(lock, folder) else claim_folder(folder):
                write_summary(outcomes, folder)

        read_known = (lambda task: None) if force else read_outcome
        return resume(tasks, read_known, execute, on_done=on_done, finish=finish)


def resume(
    items: Sequence[Item],
    read_result: Callable[[Item], Result | None],
    execute: Callable[[Sequence[Item]], Generator[Result, None, None]],
    *,
    on_done: Callable[[Result, bool], None],
    finish: Callable[[list[Result]], None],
) -> list[Result]:
    """Do all items that have no result yet.

    Args:
        items: All items of the run.
        read_result: Reads the result of an item; None if the item is not done yet.
        execute: Works on items and yields the result of each when it is done; it is closed when the run is stopped.
        on_done: Called with each result, and whether it is new.
        finish: Called with all results at the end, or with those so far when the run is stopped; it may change the
            list.

    Returns:
        All results, as `finish` leaves them: first those already known, then the new ones in the order of their
        completion.
    """
    results: list[Result] = []
    missing = []
    for item in items:
        earlier_result = read_result(item)
        if earlier_result is None:
            missing.append(item)
        else:
            results.append(earlier_result)
            on_done(earlier_result, False)
    try:
        # Closing the generator ends its processes; a traceback would keep it alive.
        with closing(execute(missing)) as new:
            for result in new:
                results.append(result)
                on_done(result, True)
    finally:
        finish(results)
    return results


def execute_here(
    folder: Path, num_jobs: int, run: Run, on_begin: Callable[[str], None] = lambda drive: None
) -> Execute:
    """Run tasks on this machine.

    Args:
        folder: Folder of all results.
        num_jobs: Number of tasks that run at a time.
        run: Function that runs the command of a task.
        on_begin: Called with each drive when it begins, from several threads.
    """

    def do(worker: Worker, task: Task) -> Outcome:
        on_begin(task.drive)
        return execute_task(folder, worker, run, task)

    return lambda tasks: in_processes(tasks, do, num_jobs)


def execute_task(folder: Path, worker: Worker, run: Run, task: Task) -> Outcome:
    """Run the task of a drive and record its outcome; a folder that cannot be written fails only this drive.

    Raises:
        CancelledError: the batch was stopped.
    """
    start, left_s, inputs = monotonic(), task.timeout_s, Inputs()
    try:
        make_folder_of_drive(task, folder)
        try:
            inputs = worker.ask(read_inputs, task, timeout_s=left_s)
            if task.timeout_s is not None:
                left_s = max(task.timeout_s - (monotonic() - start), sys.float_info.min)
            return worker.ask(run, task, inputs, timeout_s=left_s)
        except ProcessError as error:
            reason = f"timed out after {task.timeout_s:g} s" if error.is_timed_out else str(error)
            outcome = failed_outcome(task.drive, reason)
            with suppress(OSError, InputError), open_own(task.log) as log:
                log.write(f"{reason}\n".encode())
            # A process that ends before it has read the drive's files does not end because of their content.
            if error.is_timed_out or (inputs and not error.is_from_outside):
                write_record(task, outcome, inputs, timed_out=error.is_timed_out)
            return outcome
    except InputError as error:
        return failed_outcome(task.drive, str(error))
    except OSError as error:
        return failed_outcome(task.drive, f"{error.filename or task.folder}: {os_reason(error)}")
    except MemoryError as error:  # The process could not read the files, and continues with the next drive.
        return failed_outcome(task.drive, f"MemoryError: {error}")


def is_of_machine(failure: BaseException | None, folder: Path) -> bool:
    """Return whether the machine, and not the drive, made a run fail, so that another run may succeed.

    Args:
        failure: The error that ended the run, if any.
        folder: Folder of the results; what cannot be written there is not the drive's fault.
    """
    prefix = os.path.realpath(folder) + os.sep
    while failure is not None:
        if isinstance(failure, MemoryError):
            return True
        if isinstance(failure, OSError):
            name = failure.filename
            if failure.errno in MACHINE_ERRORS or (
                isinstance(name, str) and os.path.realpath(name).startswith(prefix)
            ):
                return True
        # An error for the user is raised from one of the system.
        failure = failure.__cause__ or failure.__context__
    return False
