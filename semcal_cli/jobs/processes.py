"""Processes that work on one item after another, so that loaded code and data stay; each may crash or hang.

A process receives its tasks as lines of JSON on standard input, and answers with lines of JSON on standard output.
It exits when its input ends: see `semcal_cli.jobs.serving` for its side.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import Any, TypeVar

CHUNK = 65_536
FAULTS = frozenset({signal.SIGFPE, signal.SIGILL, signal.SIGSEGV, signal.SIGSYS, signal.SIGTRAP})
"""Signals that a process brings upon itself; all others come from outside. So does SIGBUS: the file behind mapped
memory has shrunk, or its disk is full or broken. So does SIGABRT, with which the core ends where memory is refused, as
the kernel's SIGKILL does elsewhere. Some bugs abort as well: the question is then asked again in vain."""

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")


class StoppedError(Exception):
    """The run has ended before this item was done."""


@dataclass(frozen=True)
class Reply:
    """The answers of a process to one question."""

    answers: list[Any]
    failure: str | None = None
    """Cause of a failure; the process has ended then, and answers may be missing. None without a failure."""
    is_timed_out: bool = False
    is_from_outside: bool = False
    """Whether the process was ended from outside, or ended before its first answer: the question is not to blame."""


def command(module: str) -> tuple[str, ...]:
    """Make the command that runs `main` of a module.

    The process finds packages where this one does. `-m` would look in the working folder first, and any file may be
    there.
    """
    code = f"import sys; sys.path = sys.argv[1:]; from {module} import main; main()"
    return (sys.executable, "-c", code, *sys.path)


class Process:
    """The asking side of one process."""

    def __init__(self, module: str) -> None:
        # The process has its own group: its children end with it, and this process handles Ctrl-C.
        self._process = subprocess.Popen(
            command(module), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        self._rest = b""

    def ask(self, question: Any, num_answers: int, deadline: float | None) -> Reply:
        """Ask a question, and wait for its answers until a deadline of the monotonic clock."""
        assert self._process.stdin is not None
        answers: list[Any] = []
        try:
            self._process.stdin.write(json.dumps(question).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            return self._ended(answers)
        while len(answers) < num_answers:
            line = self._read_line(deadline)
            if line is None:
                self.kill()
                return Reply(answers, "timed out", is_timed_out=True)
            if not line:
                return self._ended(answers)
            try:
                answers.append(json.loads(line))
            except ValueError:
                self.kill()
                return Reply(answers, f"the process answered {line[:40]!r}")
        return Reply(answers)

    def kill(self) -> None:
        """Kill the process and its children."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """Kill the process, and close its pipes."""
        self.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def _ended(self, answers: list[Any]) -> Reply:
        """Describe how the process ended."""
        code = self._process.wait()
        if code >= 0:
            failure = f"the process ended with exit code {code}"
            return Reply(answers, failure, is_from_outside=not answers)
        try:
            name = signal.Signals(-code).name
        except ValueError:  # Real-time signals have numbers only.
            name = f"signal {-code}"
        more = ", as when memory runs out" if name == "SIGKILL" else ""
        return Reply(answers, f"the process was ended by {name}{more}", is_from_outside=-code not in FAULTS)

    def _read_line(self, deadline: float | None) -> bytes | None:
        """Read a line; empty at the end of the output, None at the deadline."""
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


class Processes:
    """One process for each thread that asks; each runs `main` of a module."""

    def __init__(self, module: str) -> None:
        self._module = module
        self._of_thread = threading.local()
        self._lock = threading.Lock()
        self._all: list[Process] = []
        self._is_stopped = False

    def ask(self, question: Any, *, num_answers: int = 1, timeout_s: float | None = None) -> Reply:
        """Ask this thread's process a question; one that fails is replaced before the next question.

        Raises:
            StoppedError: the run was stopped.
        """
        deadline = None if timeout_s is None else monotonic() + timeout_s
        process = self._process()
        reply = process.ask(question, num_answers, deadline)
        if self._is_stopped:
            raise StoppedError
        if reply.failure is not None:
            # It is closed now: a batch of many failures would run out of descriptors.
            del self._of_thread.process
            with self._lock:
                self._all.remove(process)
            process.close()
        return reply

    def stop(self) -> None:
        """End all processes."""
        with self._lock:
            self._is_stopped = True
            for process in self._all:
                process.kill()

    def close(self) -> None:
        """End all processes; called when no thread asks any more."""
        for process in self._all:
            process.close()

    def _process(self) -> Process:
        process: Process | None = getattr(self._of_thread, "process", None)
        if process is None:
            with self._lock:
                if self._is_stopped:
                    raise StoppedError
                process = self._of_thread.process = Process(self._module)
                self._all.append(process)
        return process


def in_processes(
    items: Sequence[Item], do: Callable[[Processes, Item], Outcome], module: str, num_jobs: int
) -> Generator[Outcome, None, None]:
    """Work on items on this machine, several at a time, and yield the outcome of each when it is done.

    Args:
        items: Items to work on.
        do: Asks a process to do an item; its exceptions end the run.
        module: Module whose `main` the processes run.
        num_jobs: Number of processes at a time.
    """
    processes = Processes(module)
    # The pool is not used in a `with`, which would wait for all items when this process is told to stop.
    threads = ThreadPoolExecutor(num_jobs)
    try:
        for done in as_completed([threads.submit(do, processes, item) for item in items]):
            yield done.result()
    finally:
        processes.stop()
        threads.shutdown(cancel_futures=True)
        processes.close()
