"""The threads of one process: those of the core, and pools for Python and other libraries."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

from semcal_cli import core

_num_threads: int | None = None


def num_cores() -> int:
    """Count the cores that this process may use; on macOS, all cores of the machine."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def set_num_threads(num_threads: int | None) -> None:
    """Set the number of threads of this process; None uses one per available core."""
    global _num_threads
    _num_threads = num_threads
    if num_threads is not None:
        core.set_num_threads(num_threads)


def thread_pool() -> ThreadPoolExecutor:
    """Make a pool with that number of threads, for the `with` statement."""
    return ThreadPoolExecutor(_num_threads or num_cores())
