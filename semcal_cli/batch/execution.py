"""The run of one drive of a batch, in a process that may crash or hang."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TypeAlias

from semcal_cli.batch.folders import make_folder_of_drive
from semcal_cli.batch.records import FileState, write_record
from semcal_cli.batch.tasks import LOG, RESULTS, Outcome, Task, describe_result, failed
from semcal_cli.errors import InputError
from semcal_cli.files.messages import os_reason
from semcal_cli.jobs.processes import Processes, Reply, in_processes
from semcal_cli.jobs.resume import open_own

Execute: TypeAlias = Callable[[Sequence[Task]], Generator[Outcome, None, None]]
"""Function that runs tasks, and yields the outcome of each when it is done."""
MODULE = "semcal_cli.cli.worker"
"""Module that the processes run. It answers a task with the state of its files, then with the command's outcome."""


def execute_here(
    folder: Path, num_jobs: int, on_begin: Callable[[str], None] = lambda drive: None
) -> Execute:
    """Run tasks on this machine.

    Args:
        folder: Folder of all results.
        num_jobs: Number of tasks at a time.
        on_begin: Called with each drive when it begins, by several threads.
    """

    def do(processes: Processes, task: Task) -> Outcome:
        on_begin(task.drive)
        return execute_task(folder, processes, task)

    return lambda tasks: in_processes(tasks, do, MODULE, num_jobs)


def execute_task(folder: Path, processes: Processes, task: Task) -> Outcome:
    """Run the task of a drive, and record its outcome; a folder that cannot be written fails only this drive.

    A failure of the machine is not recorded, so that the next run does the drive again.

    Raises:
        StoppedError: the batch was stopped.
    """
    try:
        make_folder_of_drive(task, folder)
        reply = processes.ask(asdict(task), num_answers=2, timeout_s=task.timeout_s)
        outcome = _outcome(folder, task, reply)
        if not _is_of_machine(reply):
            states = reply.answers[0]["files"] if reply.answers else {}
            inputs = {path: state and FileState(**state) for path, state in states.items()}
            write_record(task, outcome, inputs, timed_out=reply.is_timed_out)
        return outcome
    except InputError as error:
        return failed(task.drive, str(error))
    except OSError as error:
        return failed(task.drive, f"{error.filename or task.folder}: {os_reason(error)}")


def _outcome(folder: Path, task: Task, reply: Reply) -> Outcome:
    """Make the outcome of a drive from the answers of its process."""
    if reply.failure is not None:
        reason = f"timed out after {task.timeout_s:g} s" if reply.is_timed_out else reply.failure
        with suppress(OSError, InputError), open_own(Path(task.folder) / LOG) as log:
            log.write(f"{reason}\n".encode())
        return failed(task.drive, reason)
    _, end = reply.answers
    if end["exit_code"] not in (0, 3, 4):
        return failed(task.drive, end["error"])
    result = (Path(task.folder) / RESULTS[task.command]).relative_to(folder).as_posix()
    return describe_result(task, end["exit_code"], result)


def _is_of_machine(reply: Reply) -> bool:
    """Tell whether a run failed for the machine's reasons, not for the drive's."""
    if reply.failure is not None:
        return reply.is_from_outside
    is_of_machine: bool = reply.answers[1]["is_of_machine"]
    return is_of_machine
