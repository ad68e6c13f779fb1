"""The process that calibrates the drives of a batch: see `semcal_cli.batch.execution`."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from semcal_cli.batch.tasks import LOG, TIMES, Task, read_inputs
from semcal_cli.cli import run
from semcal_cli.jobs.serving import serve


def main() -> None:
    """Run tasks until there are no more."""
    serve(_do)


def _do(question: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the state of a task's files, then the outcome of its command."""
    task = Task(**question | {"arguments": tuple(question["arguments"]), "also": tuple(question["also"])})
    yield {"files": {path: state and vars(state) for path, state in read_inputs(task).items()}}
    yield _execute(task)


def _execute(task: Task) -> dict[str, Any]:
    """Run the command of a task, with its output redirected to files."""
    folder, result = task.folder, str(task.result)
    arguments = [task.command, task.path, *task.arguments, "--threads", str(task.num_threads)]
    output = os.devnull
    if task.command == "calibrate":
        arguments += ["-o", result, "--log", f"{folder}/{TIMES}"]
    else:
        arguments.append("--json")
        output = f"{result}.part"
    try:
        with _redirected(2, Path(folder) / LOG), _redirected(1, Path(output)):
            try:
                code, error = run(arguments)
            except Exception as failure:
                traceback.print_exc()
                code, error = 1, f"{type(failure).__name__}: {failure}"
            sys.stdout.flush()
            sys.stderr.flush()
        if output != os.devnull and code != 1:
            Path(output).replace(result)
    except OSError as failure:
        return {"exit_code": 1, "error": f"{failure.filename}: {(failure.strerror or str(failure)).lower()}"}
    return {"exit_code": code, "error": error}


@contextmanager
def _redirected(descriptor: int, path: Path) -> Iterator[None]:
    """Redirect a file descriptor to a file for a while."""
    before = os.dup(descriptor)
    try:
        with path.open("wb") as file:
            os.dup2(file.fileno(), descriptor)
            yield
    finally:
        os.dup2(before, descriptor)
        os.close(before)
