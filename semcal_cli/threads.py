"""The threads of one process: those of the core, and pools for what is in Python or in other libraries."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

from semcal_cli import _core

_num_threads: int | None = None


def num_cores() -> int:
    """Count the cores that this process may use; macOS knows only those of the machine."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def set_num_threads(num_threads: int | None) -> None:
    """Let this process work on so many threads at a time; None takes all that it may use."""
    global _num_threads
    _num_threads = num_threads
    if num_threads is not None:
        _core.set_num_threads(num_threads)


def thread_pool() -> ThreadPoolExecutor:
    """Make a pool of as many threads, for the `with` statement."""
    return ThreadPoolExecutor(_num_threads or num_cores())
