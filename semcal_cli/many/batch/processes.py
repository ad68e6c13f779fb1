"""Processes that work on one item after another and keep loaded code; each may crash or hang.

pebble watches them. With loky, one killed process would fail all waiting items, and items have no time limit.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, TimeoutError, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import resource_tracker
from queue import SimpleQueue
from typing import Any, TypeVar

from pebble import ProcessExpired, ProcessPool

FAULTS = frozenset({signal.SIGFPE, signal.SIGILL, signal.SIGSEGV, signal.SIGSYS, signal.SIGTRAP})
"""Signals that a process causes itself; all others come from outside. SIGBUS counts as from outside: the file behind
mapped memory has shrunk, or its disk is full or broken. So does SIGABRT, by which the core ends when it is refused
memory; elsewhere the kernel sends SIGKILL. Some bugs abort as well: the work is then repeated in vain."""

NUM_ATTEMPTS = 2
"""Number of times that a process may end before pebble sees its work begin; in rare cases, the work has just begun."""

Item = TypeVar("Item")
Result = TypeVar("Result")
Answer = TypeVar("Answer")


class ProcessError(Exception):
    """A process ended before its work was done."""

    def __init__(self, reason: str, *, is_timed_out: bool = False, is_from_outside: bool = False) -> None:
        """Keep the cause.

        Args:
            reason: The cause in words.
            is_timed_out: Whether the process was ended because it took too long.
            is_from_outside: Whether something else ended the process, so that the work is not to blame.
        """
        super().__init__(reason)
        self.is_timed_out, self.is_from_outside = is_timed_out, is_from_outside


class Worker:
    """A process that works for one thread at a time; it starts with the first request and is replaced if it ends."""

    def __init__(self) -> None:
        self._pool, self._is_stopped = _make_pool(), False
        self._answer: Future[Any] | None = None

    def ask(self, work: Callable[..., Answer], *arguments: object, timeout_s: float | None = None) -> Answer:
        """Let the process do some work, and return the result.

        Args:
            work: Function of a module; it is pickled, as are its arguments and its result.
            arguments: Arguments of the function.
            timeout_s: Time limit of the work in seconds.

        Raises:
            ProcessError: the process ended, or the time ran out.
            CancelledError: the worker was stopped.
            Exception: whatever the work raises.
        """
        for _ in range(NUM_ATTEMPTS):
            try:
                answer = self._pool.schedule(work, arguments, timeout=timeout_s)
            except RuntimeError:  # The process was ended while idle, and its pool with it.
                self._pool.join()
                self._pool = _make_pool()
                answer = self._pool.schedule(work, arguments, timeout=timeout_s)
            self._answer = answer
            if self._is_stopped:
                raise CancelledError
            try:
                return answer.result()
            except ProcessExpired as end:
                raise _error_of(end.exitcode) from None
            except BrokenProcessPool:
                continue
            except TimeoutError:
                if timeout_s is None:
                    raise
                raise ProcessError("timed out", is_timed_out=True) from None
        raise ProcessError("the process ended while it was starting", is_from_outside=True)

    def stop(self) -> None:
        """Refuse further work, and wake the thread that waits for an answer."""
        self._is_stopped = True
        if self._answer is not None:
            self._answer.cancel()
        self._pool.stop()

    def close(self) -> None:
        """End the process of a stopped worker that no thread uses any more."""
        self._pool.stop()
        self._pool.join()


def in_processes(
    items: Sequence[Item], do: Callable[[Worker, Item], Result], num_jobs: int
) -> Generator[Result, None, None]:
    """Work on items on this machine, several at a time, and yield each outcome when it is ready.

    Args:
        items: Items to work on.
        do: Does an item with the help of a worker; its exceptions end the run.
        num_jobs: Number of processes at a time.
    """
    workers = [Worker() for _ in range(min(num_jobs, len(items)))]
    free: SimpleQueue[Worker] = SimpleQueue()
    for worker in workers:
        free.put(worker)

    def do_by_any(item: Item) -> Result:
        worker = free.get()
        try:
            return do(worker, item)
        finally:
            free.put(worker)

    threads = ThreadPoolExecutor(num_jobs, initializer=_defer_interrupts)
    # The pool is not used in a `with` statement, which would wait for all items when this process is told to stop.
    try:
        for done in as_completed([threads.submit(do_by_any, item) for item in items]):
            yield done.result()
    finally:
        for worker in workers:
            worker.stop()
        threads.shutdown(cancel_futures=True)
        for worker in workers:
            worker.close()


def _defer_interrupts() -> None:
    """Block Ctrl-C in the processes that this thread starts, which inherit the mask, until they are ready for it."""
    # Python would start the tracker with the first process, and then unblock the signal.
    resource_tracker.ensure_running()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _make_pool() -> ProcessPool:
    """Make a pool of one process.

    Several processes in one pool share a pipe: what one takes from it when it is killed would be lost. A fork of this
    process would copy locks that its other threads hold.
    """
    return ProcessPool(1, initializer=_begin, context=multiprocessing.get_context("spawn"))


def _begin() -> None:
    """Prepare a new process."""
    # Its work reads empty input, and its output is discarded.
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(null, 1)
    # Unlike pebble's SIG_IGN, a handler is not inherited by programs that the work starts: Ctrl-C ends them.
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # pebble's handler would wait until the core returns, and turn the signal into an exit code.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent is gone, whatever it is doing."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _error_of(exit_code: int) -> ProcessError:
    """Describe how a process ended; `exit_code` is negative for a signal."""
    if exit_code >= 0:
        return ProcessError(f"the process exited with code {exit_code}")
    name = f"signal {-exit_code}"  # Real-time signals have numbers only.
    with suppress(ValueError):
        name = signal.Signals(-exit_code).name
    more = ", perhaps because memory ran out" if name == "SIGKILL" else ""
    return ProcessError(f"the process was killed by {name}{more}", is_from_outside=-exit_code not in FAULTS)
