"""A process that does one drive after another, so that what is loaded once stays; it may crash or hang.

It is told what to do in lines of JSON on its standard input, and answers in such lines on its standard output: the
state of the files first, then how the command ended. When its input ends it goes.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import Any

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

# It finds packages where this process does: `-m` would look in the working folder first, which may hold anything.
COMMAND = (
    sys.executable,
    "-c",
    "import sys; sys.path = sys.argv[1:]; from semcal_cli.cli.worker import main; main()",
    *sys.path,
)
CHUNK = 65_536


class StoppedError(Exception):
    """The batch is over before this drive was done."""


class Worker:
    """The other end of the process."""

    def __init__(self) -> None:
        # Its own group: what it starts ends with it, and Ctrl-C is ours to answer.
        self._process = subprocess.Popen(
            COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        self._rest = b""

    def ask(
        self, question: dict[str, Any], deadline: float | None
    ) -> tuple[list[dict[str, Any]], str | None]:
        """Ask for a command.

        Returns:
            The answers, two if all went well, and what went wrong otherwise: then the process is gone.
        """
        assert self._process.stdin is not None
        answers: list[dict[str, Any]] = []
        try:
            self._process.stdin.write(json.dumps(question).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            return answers, self._end()
        while len(answers) < 2:
            line = self._read_line(deadline)
            if line is None:
                self.kill()
                return answers, "timeout"
            if not line:
                return answers, self._end()
            try:
                answers.append(json.loads(line))
            except ValueError:
                self.kill()
                return answers, f"the process answered {line[:40]!r}"
        return answers, None

    def kill(self) -> None:
        """End it, and what it started."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """End it, and let go of what it was asked and answered through."""
        self.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def _end(self) -> str:
        """Say how the process ended."""
        code = self._process.wait()
        if code >= 0:
            return f"the process ended with exit code {code}"
        name = signal.Signals(-code).name
        more = ", as when memory runs out" if name == "SIGKILL" else ""
        return f"the process was ended by {name}{more}"

    def _read_line(self, deadline: float | None) -> bytes | None:
        """Read a line; empty at the end, None when time is up."""
        assert self._process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            while b"\n" not in self._rest:
                if not selector.select(None if deadline is None else max(deadline - monotonic(), 0.0)):
                    return None
                chunk = os.read(self._process.stdout.fileno(), CHUNK)
                if not chunk:
                    return b""
                self._rest += chunk
        line, self._rest = self._rest.split(b"\n", 1)
        return line


class Workers:
    """One process for each thread that asks."""

    def __init__(self, root: Path) -> None:
        """Take the folder that results are named relative to."""
        self.root = root
        self._mine = threading.local()
        self._lock = threading.Lock()
        self._all: list[Worker] = []
        self._is_stopped = False

    def execute(self, task: Task) -> Outcome:
        """Do a drive, and keep what came of it; a folder that cannot be written to is the failure of one drive.

        Raises:
            StoppedError: the batch was.
        """
        try:
            return self._execute(task)
        except InputError as error:
            return Outcome(task.drive, FAILED, 1, (str(error),))
        except OSError as error:
            reason = f"{error.filename or task.folder}: {(error.strerror or str(error)).lower()}"
            return Outcome(task.drive, FAILED, 1, (reason,))

    def _execute(self, task: Task) -> Outcome:
        folder = Path(task.folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be made: {(error.strerror or str(error)).lower()}") from None
        deadline = None if task.timeout_s is None else monotonic() + task.timeout_s
        answers, failure = self._worker().ask(asdict(task), deadline)
        if self._is_stopped:
            raise StoppedError
        inputs = {p: s and FileState(**s) for p, s in answers[0]["files"].items()} if answers else {}
        if failure is not None:
            del self._mine.worker
            reason = f"timed out after {task.timeout_s:g} s" if failure == "timeout" else failure
            outcome = Outcome(task.drive, FAILED, 1, (reason,))
            with suppress(OSError), (folder / LOG).open("a") as log:
                log.write(f"{reason}\n")
        elif answers[1]["exit_code"] in (0, 3, 4):
            result = (folder / RESULTS[task.command]).relative_to(self.root).as_posix()
            outcome = describe_result(task, answers[1]["exit_code"], result)
        else:
            outcome = Outcome(task.drive, FAILED, 1, (answers[1]["error"],))
        write_record(task, outcome, inputs, timed_out=failure == "timeout")
        return outcome

    def stop(self) -> None:
        """End all processes."""
        with self._lock:
            self._is_stopped = True
            for worker in self._all:
                worker.kill()

    def close(self) -> None:
        """End all processes, when no thread asks any more."""
        for worker in self._all:
            worker.close()

    def _worker(self) -> Worker:
        worker: Worker | None = getattr(self._mine, "worker", None)
        if worker is None:
            with self._lock:
                if self._is_stopped:
                    raise StoppedError
                worker = self._mine.worker = Worker()
                self._all.append(worker)
        return worker
