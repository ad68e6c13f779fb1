"""The run of a command on a drive of a batch, in a process of the batch: see `semcal_cli.batch.execution`."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from semcal_cli.batch.execution import Ended
from semcal_cli.batch.failures import is_of_machine
from semcal_cli.batch.tasks import LOG, PART, TIMES, Task
from semcal_cli.cli import Ending, run
from semcal_cli.cli.ci import GITHUB_ACTIONS, GITHUB_STEP_SUMMARY
from semcal_cli.files.messages import os_reason


def run_task(task: Task) -> Ended:
    """Run the command of a task, with its output redirected to files."""
    # The batch tells the CI system of all of its drives together.
    for name in (GITHUB_ACTIONS, GITHUB_STEP_SUMMARY):
        os.environ.pop(name, None)
    folder, result = Path(task.folder), str(task.result)
    arguments = [task.command, task.path, *task.arguments, "--threads", str(task.num_threads)]
    output = None
    if task.command == "calibrate":
        arguments += ["-o", result, "--log", f"{folder}/{TIMES}"]
    else:
        arguments.append("--json")
        output = Path(f"{result}{PART}")
    try:
        with _redirected(2, folder / LOG), _redirected(1, output):
            ending = _run(arguments)
            sys.stdout.flush()
            sys.stderr.flush()
        if output is not None and ending.exit_code != 1:
            output.replace(result)
    except OSError as failure:
        ending = Ending(1, f"{failure.filename or folder}: {os_reason(failure)}", failure)
    line = ending.line or f"the command ended with exit code {ending.exit_code}"
    return Ended(ending.exit_code, line, is_of_machine(ending.failure, folder))


def _run(arguments: list[str]) -> Ending:
    """Run a command; a failure that nobody expected is one as well."""
    try:
        return run(arguments)
    except Exception as failure:
        traceback.print_exc()
        return Ending(1, f"{type(failure).__name__}: {failure}", failure)


@contextmanager
def _redirected(descriptor: int, path: Path | None) -> Iterator[None]:
    """Redirect a file descriptor to a new file for a while; None is the null device.

    An existing file is replaced, not written to: another name of it may be a person's.
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
