"""The process that does the drives of a batch: see `semcal_cli.batch.worker`."""

from __future__ import annotations

import json
import os
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

from semcal_cli.batch.tasks import LOG, TIMES, Task, read_inputs
from semcal_cli.cli import run


def main() -> None:
    """Answer questions until there are no more."""
    # The commands' own output goes to files.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    questions: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(questions,), daemon=True).start()
    while True:
        question = json.loads(questions.get())
        task = Task(**question | {"arguments": tuple(question["arguments"]), "also": tuple(question["also"])})
        _answer(
            answers, {"files": {path: state and vars(state) for path, state in read_inputs(task).items()}}
        )
        _answer(answers, _execute(task))


def _listen(questions: SimpleQueue[str]) -> None:
    """Hear the end of the input at once: whoever asks has gone, and wants no answer any more."""
    for line in sys.stdin:
        questions.put(line)
    os._exit(1)


def _answer(answers: TextIO, answer: dict[str, Any]) -> None:
    answers.write(json.dumps(answer) + "\n")
    answers.flush()


def _execute(task: Task) -> dict[str, Any]:
    """Run the command of a task, with its output in files."""
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
    """Let what is written to a descriptor go to a file for a while."""
    before = os.dup(descriptor)
    try:
        with path.open("wb") as file:
            os.dup2(file.fileno(), descriptor)
            yield
    finally:
        os.dup2(before, descriptor)
        os.close(before)
