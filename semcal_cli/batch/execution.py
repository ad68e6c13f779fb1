"""The run of one drive of a batch, in a process that may crash or hang."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TypeAlias

from semcal_cli.batch.tasks import (
    FAILED,
    LOG,
    RESULTS,
    FileState,
    Outcome,
    Task,
    describe_result,
    write_record,
)
from semcal_cli.errors import InputError
from semcal_cli.jobs.processes import Processes, Reply, in_processes

Execute: TypeAlias = Callable[[Sequence[Task]], Generator[Outcome, None, None]]
"""Function that runs tasks, and yields the outcome of each when it is done."""
MODULE = "semcal_cli.cli.worker"
"""Module that the processes run. It answers a task with the state of its files, then with the command's outcome."""


def execute_here(folder: Path, num_jobs: int) -> Execute:
    """Run tasks on this machine, `num_jobs` at a time; `folder` is that of all results."""
    do = partial(execute_task, folder)
    return lambda tasks: in_processes(tasks, do, MODULE, num_jobs)


def execute_task(folder: Path, processes: Processes, task: Task) -> Outcome:
    """Run the task of a drive, and record its outcome; a folder that cannot be written fails only this drive.

    Raises:
        StoppedError: the batch was stopped.
    """
    try:
        return _execute(folder, processes, task)
    except InputError as error:
        return Outcome(task.drive, FAILED, 1, (str(error),))
    except OSError as error:
        reason = f"{error.filename or task.folder}: {(error.strerror or str(error)).lower()}"
        return Outcome(task.drive, FAILED, 1, (reason,))


def _execute(folder: Path, processes: Processes, task: Task) -> Outcome:
    try:
        Path(task.folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{task.folder}: cannot be made: {(error.strerror or str(error)).lower()}") from None
    reply = processes.ask(asdict(task), num_answers=2, timeout_s=task.timeout_s)
    states = reply.answers[0]["files"] if reply.answers else {}
    inputs = {path: state and FileState(**state) for path, state in states.items()}
    outcome = _outcome(folder, task, reply)
    write_record(task, outcome, inputs, timed_out=reply.is_timed_out)
    return outcome


def _outcome(folder: Path, task: Task, reply: Reply) -> Outcome:
    """Make the outcome of a drive from the answers of its process."""
    if reply.failure is not None:
        reason = f"timed out after {task.timeout_s:g} s" if reply.is_timed_out else reply.failure
        with suppress(OSError), (Path(task.folder) / LOG).open("a") as log:
            log.write(f"{reason}\n")
        return Outcome(task.drive, FAILED, 1, (reason,))
    _, end = reply.answers
    if end["exit_code"] not in (0, 3, 4):
        return Outcome(task.drive, FAILED, 1, (end["error"],))
    result = (Path(task.folder) / RESULTS[task.command]).relative_to(folder).as_posix()
    return describe_result(task, end["exit_code"], result)
