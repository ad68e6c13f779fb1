"""A batch on a Dask cluster whose workers share the drives' storage."""

from __future__ import annotations

import logging
import multiprocessing
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from semcal_cli.errors import InputError, check_installed, reason
from semcal_cli.many.batch.processes import Worker
from semcal_cli.many.batch.run import Execute, Run, execute_task
from semcal_cli.many.batch.tasks import Outcome, Task, failed_outcome

if TYPE_CHECKING:
    from distributed import Client, Future

Item = TypeVar("Item")
Answer = TypeVar("Answer")
CONNECT_S = 30
_thread_state = threading.local()
"""Process of each thread of a Dask worker, which is kept for the next batch."""


def connect(address: str) -> Client:
    """Connect to a scheduler.

    Raises:
        InputError: distributed is not installed, or no scheduler answers at the address.
    """
    check_installed(f"--dask {address}", "distributed", "dask")
    from distributed import Client

    # What it would log of a lost scheduler, with tracebacks, is said in one line.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        return Client(address, timeout=CONNECT_S)
    except Exception as error:  # What it raises depends on the address, TLS and the version of the library.
        raise InputError(f"--dask {address}: found no scheduler: {reason(error)}") from None


def execute_on(client: Client, folder: Path, run: Run) -> Execute:
    """Run tasks on a cluster, one drive on each thread of its workers; other workers repeat those of a lost worker."""

    def execute(tasks: Sequence[Task]) -> Generator[Outcome, None, None]:
        for task, get in on_cluster(client, partial(_execute, str(folder), run), tasks):
            try:
                yield get()
            except LostWorkerError as error:
                # There is no record of this, so the next run repeats the drive.
                yield failed_outcome(task.drive, str(error))

    return execute


class LostWorkerError(Exception):
    """The worker of an item was lost again and again."""


def on_cluster(
    client: Client, work: Callable[[Item], Answer], items: Iterable[Item]
) -> Generator[tuple[Item, Callable[[], Answer]], None, None]:
    """Work on items on a cluster, and yield each when it is done, with a function that returns what the work returned.

    That function raises whatever the work raised, `LostWorkerError`, or `InputError` if the scheduler is lost or a
    worker cannot load semcal.

    Raises:
        InputError: the scheduler is lost.
    """
    from distributed import KilledWorker, as_completed

    scheduler: Any = client.scheduler
    address = scheduler.address
    lost = InputError(
        f"--dask {address}: lost the scheduler; what is finished is kept, and the same command goes on"
    )

    def get(done: Future[Answer]) -> Answer:
        try:
            answer: Answer = done.result()
        except KilledWorker:
            raise LostWorkerError("its worker was lost repeatedly") from None
        except CancelledError:
            raise lost from None
        except OSError:
            if done.status == "error":  # The work raised it.
                raise
            raise lost from None
        except (ImportError, AttributeError) as error:
            needed = f"expected semcal {version('semcal')} for all workers"
            raise InputError(f"--dask {address}: a worker found {reason(error)}, {needed}") from None
        return answer

    items_by_future: dict[Future[Answer], Item] = {}
    try:
        items_by_future |= {client.submit(work, item, pure=False): item for item in items}
        for done in as_completed(items_by_future):
            yield items_by_future[done], partial(get, done)
    except (OSError, CancelledError):
        raise lost from None
    finally:
        with suppress(OSError, CancelledError):
            client.cancel(list(items_by_future))


def worker_of_thread() -> Worker:
    """Return the process of this thread of a worker of the cluster, which stays for the next item."""
    # Dask's nannies make workers daemons, which must not have child processes; ours end with their worker.
    multiprocessing.current_process().daemon = False
    if not hasattr(_thread_state, "process"):
        _thread_state.process = Worker()
    process: Worker = _thread_state.process
    return process


def _execute(folder: str, run: Run, task: Task) -> Outcome:
    """Run the task of a drive on a worker of the cluster."""
    return execute_task(Path(folder), worker_of_thread(), run, task)
