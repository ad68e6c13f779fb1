"""What a batch asks of a process, and what it keeps of every drive.

A record is written when all is done, and as a whole. It names the files that were read, with their hashes: so a batch
that was stopped goes on where it was, and does again what would come out differently.
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
"""The status of a drive that gave no answer."""


@dataclass(frozen=True)
class Task:
    """One drive to be done, by whichever process does it; paths are absolute."""

    drive: str
    """As it was given."""
    path: str
    """The drive's folder or file."""
    folder: str
    """Where its result, log and record go."""
    command: str
    """`calibrate` or `verify`."""
    arguments: tuple[str, ...] = ()
    """Of the command, that change the answer."""
    also: tuple[str, ...] = ()
    """Files that it reads beside the drive's."""
    num_threads: int = 1
    """Threads of the Rust core."""
    timeout_s: float | None = None
    """Seconds after which the drive has failed; None: it may take as long as it does."""

    @property
    def result(self) -> Path:
        """The file of the result."""
        return Path(self.folder) / RESULTS[self.command]


@dataclass(frozen=True)
class FileState:
    """A file as it was read."""

    size: int
    """Size in bytes."""
    mtime_ns: int
    """Time of the last change, in nanoseconds since 1970."""
    sha256: str
    """Hash of the content."""


@dataclass(frozen=True)
class Outcome:
    """What came of a drive: a line of the summary. Neither times nor machines are part of it."""

    drive: str
    """The drive as it was given."""
    status: str
    """`trusted`, `not_trusted` or `not_assessed`; `pass`, `fail` or `inconclusive`; or `failed`."""
    exit_code: int
    """Exit code of the command."""
    reasons: tuple[str, ...] = ()
    """Sentences that say why it is not trusted or has failed."""
    stamp: float | None = None
    """Seconds, of the first frame, if it has one."""
    T_camera_lidar: tuple[tuple[float, ...], ...] | None = None
    """(4, 4) rows of the transform."""
    covariance: tuple[tuple[float, ...], ...] | None = None
    """(6, 6) of xi = (rho, phi), camera frame, left perturbation."""
    mutual_information_nats: float | None = None
    """Mutual information at the transform."""
    camera: str | None = None
    """Tells lens and picture size from others: see `provenance.camera_hash`."""
    result: str | None = None
    """Its file, relative to the batch's folder."""


def read_state(path: Path) -> FileState | None:
    """Give the state of a file, or nothing if it cannot be read."""
    try:
        content, found = read_bytes(path), path.stat()
    except (InputError, OSError):
        return None
    return FileState(found.st_size, found.st_mtime_ns, hashlib.sha256(content).hexdigest())


def read_inputs(task: Task) -> dict[str, FileState | None]:
    """Give the state of each file that a task reads, by absolute path; of a broken drive, those that are known."""
    file = drive_file(Path(task.path))
    paths = [file, *map(Path, task.also)]
    with suppress(InputError):
        drive = read_drive(file)
        paths += map(drive.resolve, drive.files())
    return {str(path): read_state(path) for path in paths}


def write_record(
    task: Task, outcome: Outcome, inputs: dict[str, FileState | None], *, timed_out: bool
) -> None:
    """Keep what came of a drive.

    Raises:
        InputError: it cannot be written.
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
    """Give what came of a drive, if it would come out the same again."""
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
        return None  # There is none, or somebody wrote something else there.


def _asked(task: Task) -> dict[str, object]:
    """What changes the answer, beside the files."""
    asked = {"drive": task.drive, "path": task.path, "command": task.command}
    return {**asked, "arguments": list(task.arguments), "version": _version()}


@cache
def _version() -> str:
    """Of semcal; looking it up takes milliseconds."""
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
    """Read what a command wrote.

    Args:
        task: What was asked.
        exit_code: How it ended: 0, 3 or 4.
        result: The name of its file, relative to the batch's folder.

    Raises:
        InputError: it is not what the command writes.
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
