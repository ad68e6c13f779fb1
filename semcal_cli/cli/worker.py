"""The process that calibrates the drives of a batch: see `semcal_cli.batch.execution`."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from semcal_cli.batch.failures import is_of_machine
from semcal_cli.batch.records import read_inputs
from semcal_cli.batch.tasks import LOG, PART, TIMES, Task
from semcal_cli.cli import Ending, run
from semcal_cli.cli.ci import GITHUB_ACTIONS, GITHUB_STEP_SUMMARY
from semcal_cli.files.messages import os_reason
from semcal_cli.jobs.serving import serve


def main() -> None:
    """Run tasks until there are no more; the batch tells the CI system of all of them together."""
    for name in (GITHUB_ACTIONS, GITHUB_STEP_SUMMARY):
        os.environ.pop(name, None)
    serve(_do)


def _do(question: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the state of a task's files, then the outcome of its command."""
    task = Task(**question | {"arguments": tuple(question["arguments"]), "also": tuple(question["also"])})
    yield {"files": {path: state and vars(state) for path, state in read_inputs(task).items()}}
    yield _execute(task)


def _execute(task: Task) -> dict[str, Any]:
    """Run the command of a task, with its output redirected to files."""
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
    return {
        "exit_code": ending.exit_code,
        "error": ending.line or f"the command ended with exit code {ending.exit_code}",
        "is_of_machine": is_of_machine(ending.failure, folder),
    }


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
