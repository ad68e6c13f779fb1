"""The tasks of a batch, and the record that it keeps of each drive.

A record is written as a whole when the drive is done. It names the files that were read, with their hashes. A stopped
batch can then resume where it was, and run those drives again whose result would change.
"""

from __future__ import annotations

import hashlib
import json
import math
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from semcal_cli.drive.document import drive_file, first_stamp, read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_document
from semcal_cli.files.reading import read_bytes, read_text
from semcal_cli.files.writing import write_text
from semcal_cli.result.calibration import read_calibration
from semcal_cli.result.provenance import camera_hash

RECORD, LOG, TIMES = "record.json", "log.txt", "times.json"
RESULTS = {"calibrate": "calibration.yaml", "verify": "verification.json"}
FAILED = "failed"
"""Status of a drive without an answer."""


@dataclass(frozen=True)
class Task:
    """The run of a command on one drive, by any process; paths are absolute."""

    drive: str
    """Name of the drive as the user gave it."""
    path: str
    """The drive's folder or file."""
    folder: str
    """Folder of the drive's result, log and record."""
    command: str
    """`calibrate` or `verify`."""
    arguments: tuple[str, ...] = ()
    """Arguments of the command that change the answer."""
    also: tuple[str, ...] = ()
    """Files that the command reads beside those of the drive."""
    num_threads: int = 1
    """Threads of the Rust core."""
    timeout_s: float | None = None
    """Seconds after which the drive has failed; None: it may take as long as it does."""

    @property
    def result(self) -> Path:
        """File of the result."""
        return Path(self.folder) / RESULTS[self.command]


@dataclass(frozen=True)
class FileState:
    """Size, time and hash of a file when it was read."""

    size: int
    """Size in bytes."""
    mtime_ns: int
    """Time of the last change, in nanoseconds since 1970."""
    sha256: str
    """Hash of the content."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a drive: a line of the summary. It contains neither times nor machines."""

    drive: str
    """The drive as it was given."""
    status: str
    """`trusted`, `not_trusted` or `not_assessed`; `pass`, `fail` or `inconclusive`; or `failed`."""
    exit_code: int
    """Exit code of the command."""
    reasons: tuple[str, ...] = ()
    """Sentences that say why it is not trusted or has failed."""
    stamp: float | None = None
    """Stamp of the first frame in seconds, if it has one."""
    T_camera_lidar: tuple[tuple[float, ...], ...] | None = None
    """(4, 4) rows of the transform."""
    covariance: tuple[tuple[float, ...], ...] | None = None
    """(6, 6) covariance of xi = (rho, phi), camera frame, left perturbation."""
    mutual_information_nats: float | None = None
    """Mutual information at the transform."""
    camera: str | None = None
    """Hash of the camera's lens and image size: see `provenance.camera_hash`."""
    result: str | None = None
    """File of the result, relative to the folder of the batch."""


def read_state(path: Path) -> FileState | None:
    """Read the state of a file; None if the file cannot be read."""
    try:
        content, found = read_bytes(path), path.stat()
    except (InputError, OSError):
        return None
    return FileState(found.st_size, found.st_mtime_ns, hashlib.sha256(content).hexdigest())


def read_inputs(task: Task) -> dict[str, FileState | None]:
    """Read the state of each file that a task reads, by absolute path; for a broken drive, of its known files."""
    file = drive_file(Path(task.path))
    paths = [file, *map(Path, task.also)]
    with suppress(InputError):
        drive = read_drive(file)
        paths += map(drive.resolve, drive.files())
    return {str(path): read_state(path) for path in paths}


def write_record(
    task: Task, outcome: Outcome, inputs: dict[str, FileState | None], *, timed_out: bool
) -> None:
    """Write the record of a drive.

    Raises:
        InputError: the record cannot be written.
    """
    files = {path: state and vars(state) for path, state in inputs.items()}
    if outcome.result is not None:
        state = read_state(task.result)
        files[str(task.result)] = state and vars(state)
    document = {
        "asked": _asked(task),
        "timed_out_s": task.timeout_s if timed_out else None,
        "outcome": vars(outcome),
        "files": files,
    }
    write_text(json.dumps(document) + "\n", Path(task.folder) / RECORD)


def read_outcome(task: Task) -> Outcome | None:
    """Read the outcome of a drive; None if it has none, or if a new run could give another one."""
    try:
        document = json.loads(read_text(Path(task.folder) / RECORD))
        timed_out_s = document["timed_out_s"]
        has_more_time = timed_out_s is not None and (task.timeout_s or math.inf) > timed_out_s
        if document["asked"] != _asked(task) or has_more_time:
            return None
        if not all(_is_unchanged(Path(path), state) for path, state in document["files"].items()):
            return None
        return Outcome(**document["outcome"])
    except (InputError, ValueError, KeyError, TypeError, AttributeError):
        return None  # The file is missing, or something else wrote it.


def _asked(task: Task) -> dict[str, object]:
    """All that changes the answer, except the files."""
    asked = {"drive": task.drive, "path": task.path, "command": task.command}
    return {**asked, "arguments": list(task.arguments), "version": _version()}


@cache
def _version() -> str:
    """Version of semcal; looking it up takes milliseconds."""
    return version("semcal")


def _is_unchanged(path: Path, state: dict[str, Any] | None) -> bool:
    try:
        found = path.stat()
    except OSError:
        return state is None
    if state is None:
        return False
    if (found.st_size, found.st_mtime_ns) == (state["size"], state["mtime_ns"]):
        return True
    now = read_state(path)
    return now is not None and now.sha256 == state["sha256"]


def describe_result(task: Task, exit_code: int, result: str) -> Outcome:
    """Read the result of a command.

    Args:
        task: Task of the command.
        exit_code: Exit code of the command: 0, 3 or 4.
        result: Name of the result's file, relative to the folder of the batch.

    Raises:
        InputError: the file is not a result of the command.
    """
    if task.command == "calibrate":
        found = read_calibration(task.result)
        uncertainty = found.uncertainty
        return Outcome(
            task.drive,
            found.status,
            exit_code,
            found.reasons,
            first_stamp(read_drive(Path(task.path))),
            found.T_camera_lidar,
            None if uncertainty is None else uncertainty.covariance,
            found.quality.mutual_information_nats,
            camera_hash(found.input.camera),
            result,
        )
    document = read_document(task.result)
    return Outcome(
        task.drive,
        document["verdict"],
        exit_code,
        tuple(document["reasons"]),
        first_stamp(read_drive(Path(task.path))),
        tuple(map(tuple, document["T_camera_lidar"])),
        result=result,
    )
