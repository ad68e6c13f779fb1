"""The run of a command on one drive of a batch, in a process of the batch: see `semcal_cli.many.batch.run`."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from semcal_cli.cli import Ending, run
from semcal_cli.cli.ci import GITHUB_ACTIONS, GITHUB_STEP_SUMMARY
from semcal_cli.errors import os_reason
from semcal_cli.importing.recognition import recognise
from semcal_cli.many.batch.records import Inputs, write_record
from semcal_cli.many.batch.run import is_of_machine
from semcal_cli.many.batch.tasks import Outcome, Task, describe_outcome


def run_task(task: Task, inputs: Inputs) -> Outcome:
    """Run the command of a task, and record its outcome, unless the machine failed and not the drive."""
    ending = _run_to_files(task)
    outcome = describe_outcome(task, ending.exit_code, ending.line)
    if not is_of_machine(ending.failure, Path(task.folder)):
        write_record(task, outcome, inputs, timed_out=False)
    return outcome


def _run_to_files(task: Task) -> Ending:
    """Run the command of a task, with its output redirected to files."""
    # The batch reports all of its drives to the CI system together.
    for name in (GITHUB_ACTIONS, GITHUB_STEP_SUMMARY):
        os.environ.pop(name, None)
    arguments = [task.command, task.path, *task.arguments, "--threads", str(task.num_threads)]
    output = None
    if task.command == "calibrate":
        arguments += ["-o", str(task.result), "--log", str(task.times)]
    else:
        arguments.append("--json")
        output = task.unfinished_result
    try:
        with _redirected(2, task.log), _redirected(1, output):
            ending = _refused(Path(task.path)) or _run(arguments)
            sys.stdout.flush()
            sys.stderr.flush()
        if output is not None and ending.exit_code != 1:
            output.replace(task.result)
        return ending
    except OSError as failure:
        return Ending(1, f"{failure.filename or task.folder}: {os_reason(failure)}", failure)


def _refused(path: Path) -> Ending | None:
    """Refuse what is no drive but could become one: `calibrate` alone would import it, beside the results."""
    source = recognise(path)
    if source is None:
        return None
    line = source.advice(path)
    click.echo(f"semcal: error: {line}", err=True)
    return Ending(1, line)


def _run(arguments: list[str]) -> Ending:
    """Run a command; an unexpected exception counts as a failure, too."""
    try:
        return run(arguments)
    except Exception as failure:
        traceback.print_exc()
        return Ending(1, f"{type(failure).__name__}: {failure}", failure)


@contextmanager
def _redirected(descriptor: int, path: Path | None) -> Iterator[None]:
    """Redirect a file descriptor to a new file for a while; None is the null device.

    An existing file is replaced, not written to: a user may have another hard link to it.
    """
    before = os.dup(descriptor)
    try:
        if path is not None:
            path.unlink(missing_ok=True)
        with Path(os.devnull).open("wb") if path is None else path.open("xb") as file:
            os.dup2(file.fileno(), descriptor)
            yield
    finally:
        os.dup2(before, descriptor)
        os.close(before)
