"""Many drives in one call, in processes of this machine or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from semcal_cli import pipeline
from semcal_cli.api.results import Calibration
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import Drive
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.many.batch.cluster import LostWorkerError, on_cluster, worker_of_thread
from semcal_cli.many.batch.processes import ProcessError, Worker, in_processes
from semcal_cli.observations.loading import load
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.provenance import with_provenance
from semcal_cli.threads import num_cores, set_num_threads

if TYPE_CHECKING:
    from distributed import Client

OneDrive = TypeVar("OneDrive", bound=Drive | Path | str)


def batch(
    drives: Iterable[OneDrive],
    config: CalibrationConfig | None = None,
    *,
    jobs: int = 1,
    client: Client | None = None,
    initial_pose: InitialPose | None = None,
    timeout_s: float | None = None,
) -> Generator[tuple[OneDrive, Calibration | Exception], None, None]:
    """Calibrate many drives, and yield each with its calibration, or the error that ended it, as soon as it is done.

    Each drive runs in a process, which may crash or hang without harm to the others; closing the iterator ends them. A
    script calls this below `if __name__ == "__main__":`, because a new process imports the script. Drives of arrays are
    sent to the processes. `semcal batch` also stores finished drives, and resumes after a stop.

    Args:
        drives: Drives, their folders or their drive.yaml files.
        config: All settings; the defaults if not given.
        jobs: Number of drives that run at a time on this machine and share its cores.
        client: Dask client of a cluster, which runs one drive on each thread of its workers; None uses this machine.
        initial_pose: Pose of each drive to search around or to start from.
        timeout_s: Longest time for one drive, in seconds; None for no limit.

    Yields:
        The drive as it was given, and its calibration, or an error: `InputError` or `CalibrationError` of the drive,
        `SemcalError` if its process ended or took too long.
    """
    num_threads = 1 if client is not None else max(num_cores() // jobs, 1)
    calibrate = partial(_calibrate, config, initial_pose, num_threads)
    if client is None:
        do = partial(_ask, calibrate, timeout_s)
        yield from in_processes(list(drives), lambda worker, drive: (drive, do(worker, drive)), jobs)
        return
    for drive, get in on_cluster(client, partial(_on_worker, calibrate, timeout_s), list(drives)):
        try:
            yield drive, get()
        except LostWorkerError as error:
            yield drive, SemcalError(str(error))


def _on_worker(
    calibrate: Callable[[OneDrive], CalibrationDocument], timeout_s: float | None, drive: OneDrive
) -> Calibration | Exception:
    """Calibrate a drive in the process of a thread of a cluster's worker."""
    return _ask(calibrate, timeout_s, worker_of_thread(), drive)


def _ask(
    calibrate: Callable[[OneDrive], CalibrationDocument],
    timeout_s: float | None,
    worker: Worker,
    drive: OneDrive,
) -> Calibration | Exception:
    """Let a process calibrate a drive, and return its calibration, or the error that ended it."""
    try:
        return Calibration.of(worker.ask(calibrate, drive, timeout_s=timeout_s), drive)
    except ProcessError as error:
        return SemcalError(f"timed out after {timeout_s:g} s" if error.is_timed_out else str(error))
    except Exception as error:
        return error


def _calibrate(
    config: CalibrationConfig | None,
    initial_pose: InitialPose | None,
    num_threads: int,
    drive: Drive | Path | str,
) -> CalibrationDocument:
    """Calibrate a drive in this process, with `num_threads` threads."""
    set_num_threads(num_threads)
    data = load(drive, config)
    calibration = pipeline.calibrate(data, config, initial_pose=initial_pose)
    return with_provenance(calibration, data, start=None if initial_pose is None else initial_pose.source)
