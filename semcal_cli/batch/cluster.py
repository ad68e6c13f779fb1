"""A batch on a Dask cluster whose workers share the drives' storage."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from semcal_cli.batch.processes import Worker
from semcal_cli.batch.run import Execute, Run, execute_task
from semcal_cli.batch.tasks import Outcome, Task, failed
from semcal_cli.errors import InputError, check_installed

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S = 30
_of_thread = threading.local()
"""Process of each thread of a worker of the cluster; it stays for the next batch."""


def connect(address: str) -> Client:
    """Connect to a scheduler.

    Raises:
        InputError: distributed is not installed, or no scheduler answers at the address.
    """
    check_installed(f"--dask {address}", "distributed", "dask")
    from distributed import Client

    try:
        return Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"--dask {address}: found no scheduler there: {reason}") from None


def execute_on(client: Client, folder: Path, run: Run) -> Execute:
    """Run tasks on a cluster, one drive on each thread of its workers; other workers repeat those of a lost worker."""

    def execute(tasks: Sequence[Task]) -> Generator[Outcome, None, None]:
        from distributed import KilledWorker, as_completed

        of_task = {client.submit(_execute, str(folder), run, task, pure=False): task for task in tasks}
        try:
            for done in as_completed(of_task):
                try:
                    yield done.result()
                except KilledWorker:
                    # There is no record of this: the next run does the drive again.
                    yield failed(of_task[done].drive, "its worker was lost again and again")
        finally:
            client.cancel(list(of_task))

    return execute


def _execute(folder: str, run: Run, task: Task) -> Outcome:
    """Run the task of a drive on a worker of the cluster."""
    # Dask's nannies make their workers daemons, which may have no processes; ours end with them.
    multiprocessing.current_process().daemon = False
    if not hasattr(_of_thread, "process"):
        _of_thread.process = Worker()
    return execute_task(Path(folder), _of_thread.process, run, task)
