"""The record that a batch keeps of each drive, and the summary of all drives.

A record is written in one step when the drive is done. It names the files that were read, with their hashes, so that a
stopped batch can resume and run only those drives again whose result would change. It also contains the hash of the
result that its outcome was made from, and a hash of itself: an edited record or result does not count. The bytes of a
summary do not depend on the machine or the duration.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

import numpy as np
from pydantic import JsonValue, TypeAdapter

from semcal_cli.config.file_limits import MAX_DOCUMENT_BYTES
from semcal_cli.drive.document import drive_file, read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.input_files import (
    FILE,
    check_own_file,
    hash_file,
    kind_of,
    read_text,
)
from semcal_cli.files.output_files import write_text
from semcal_cli.files.point_clouds import max_bytes
from semcal_cli.files.validation import StrictModel, Version, validate
from semcal_cli.geometry.poses import camera_center, quaternion_xyzw
from semcal_cli.many.batch.tasks import RECORD, Outcome, Task
from semcal_cli.result.uncertainty import Covariance

MAX_RECORD_BYTES = 32 << 20
"""Largest size of a record, enough for a drive of some 100,000 files."""
_version = cache(version)
"""Version of a package; looking it up takes milliseconds."""
SIGNED = ', "sha256": "'
"""Text before the hash of a record."""
WORST_FIRST = (1, 3, 4, 0)
"""Exit codes of drives, most important first."""
CSV, JSONL = "summary.csv", "summary.jsonl"
COLUMNS = (
    *("drive", "status", "exit_code", "mutual_information_nats"),
    *("translation_x_m", "translation_y_m", "translation_z_m", "qx", "qy", "qz", "qw"),
    *("camera_x_m", "camera_y_m", "camera_z_m"),
    *("sigma_camera_x_m", "sigma_camera_y_m", "sigma_camera_z_m"),
    *("sigma_rotation_x_deg", "sigma_rotation_y_deg", "sigma_rotation_z_deg"),
    *("stamp", "result", "reasons"),
)


class FileState(StrictModel):
    """Size, time and hash of a file when it was read."""

    size: int
    """Size in bytes."""
    mtime_ns: int
    """Time of the last change, in nanoseconds since 1970."""
    sha256: str | None
    """Hash of the content; null if a file of the drive is so large that the drive is refused."""


Inputs: TypeAlias = dict[str, FileState | None]
"""State of each file that a task reads, by absolute path; None for one that could not be read."""


class RecordedOutcome(Outcome):
    """An outcome in a record; its covariance is checked like that of a calibration."""

    covariance: Covariance | None = None


class Record(StrictModel):
    """All that a batch knows about a finished drive."""

    semcal_record: Version
    """Version of this format."""
    asked: dict[str, JsonValue]
    """Everything that affects the answer except the files."""
    timed_out_s: float | None
    """Time limit that the drive exceeded, in seconds; null if it did not."""
    outcome: RecordedOutcome
    """Outcome of the drive."""
    result: FileState | None
    """State of the result; null if there is none."""


_STATE: TypeAdapter[FileState | None] = TypeAdapter(FileState | None)
"""State of a file of a drive in a record; null if the file could not be read."""


def read_state(path: Path, *, with_hash: bool = True) -> FileState | None:
    """Read the state of a file; None if the file cannot be read."""
    try:
        digest, stat = hash_file(path) if with_hash else None, path.stat()
    except (InputError, OSError):
        return None
    return FileState(size=stat.st_size, mtime_ns=stat.st_mtime_ns, sha256=digest)


def read_inputs(task: Task) -> Inputs:
    """Read the state of each file that a task reads, by absolute path; for a broken drive, only of its known files.

    Sizes are checked first. A drive with a file that is too large to be read is refused: none of its files is hashed,
    and their state is size and time only.
    """
    file = drive_file(Path(task.path))
    paths = dict.fromkeys((file, *map(Path, task.other_files)), MAX_DOCUMENT_BYTES)
    with suppress(InputError):
        drive = read_drive(file)
        paths |= dict.fromkeys(
            map(drive.resolve, drive.files()), max(max_bytes(task.max_points), MAX_DOCUMENT_BYTES)
        )
    is_readable = all(_size(path) <= limit for path, limit in paths.items())
    return {str(path): read_state(path, with_hash=is_readable) for path in paths}


def write_record(task: Task, outcome: Outcome, inputs: Inputs, *, timed_out: bool) -> None:
    """Write the record of a drive.

    Raises:
        InputError: the record cannot be written.
    """
    result = None if outcome.result is None else read_state(task.result)
    document = {
        "semcal_record": 1,
        "asked": _request(task),
        "timed_out_s": task.timeout_s if timed_out else None,
        "outcome": vars(outcome),
        "result": result and vars(result),
        "files": {path: state and vars(state) for path, state in inputs.items()},
    }
    path = Path(task.folder) / RECORD
    check_own_file(path)
    write_text(_signed(json.dumps(document)), path)


def read_outcome(task: Task) -> Outcome | None:
    """Read the outcome of a drive; None if it has none or if a new run could give another one."""
    path = Path(task.folder) / RECORD
    if kind_of(path) != FILE:
        return None
    try:
        text = read_text(path, limit=MAX_RECORD_BYTES)
        unsigned = text.rpartition(SIGNED)[0] + "}"
        if text != _signed(unsigned):
            return None
        document = json.loads(unsigned)
        # The check ends at the first wrong file: there may be many, and pydantic would keep each error.
        files = {name: _STATE.validate_python(state) for name, state in document.pop("files").items()}
        record = validate(Record, document, path)
    except (InputError, ValueError, LookupError, AttributeError, TypeError, RecursionError):
        return None  # It is not a record, or one of another version.
    has_more_time = record.timed_out_s is not None and (task.timeout_s or math.inf) > record.timed_out_s
    if record.asked != _request(task) or has_more_time:
        return None
    if not record.outcome.is_failed:
        # A link does not count as a result.
        has_result = record.result is not None and kind_of(task.result) == FILE
        if not has_result or not _is_unchanged(str(task.result), record.result):
            return None
    if not all(_is_unchanged(path, state) for path, state in files.items()):
        return None
    return Outcome(**vars(record.outcome))


def _signed(text: str) -> str:
    """Add the hash of a record to its text, as the last key, which shows whether the text was edited."""
    return f'{text[:-1]}{SIGNED}{hashlib.sha256(text.encode()).hexdigest()}"}}\n'


def _size(path: Path) -> int:
    """Return the size of a file in bytes; 0 if there is none."""
    with suppress(OSError, ValueError):
        return path.stat().st_size
    return 0


def _request(task: Task) -> dict[str, object]:
    """Describe everything that affects the answer except the files."""
    request = {"drive": task.drive, "path": task.path, "command": task.command}
    return {**request, "arguments": list(task.arguments), "version": _version("semcal")}


def _is_unchanged(path: str, state: FileState | None) -> bool:
    try:
        stat = os.stat(path)  # noqa: PTH116 - making a Path takes longer than the call, for many files
    except (OSError, ValueError):
        return state is None
    if state is None:
        return False
    if (stat.st_size, stat.st_mtime_ns) == (state.size, state.mtime_ns):
        return True
    if stat.st_size != state.size or state.sha256 is None:
        return False
    current = read_state(Path(path))
    return current is not None and current.sha256 == state.sha256


def worst_exit_code(exit_codes: Iterable[int]) -> int:
    """Choose the exit code of a batch from those of its drives: 1, then 3, then 4, then 0."""
    return min(exit_codes, key=WORST_FIRST.index, default=0)


def write_summary(outcomes: Iterable[Outcome], folder: Path) -> None:
    """Write summary.csv and summary.jsonl.

    Raises:
        InputError: a file cannot be written.
    """
    lines, table = [], io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    for outcome in sorted(outcomes, key=lambda outcome: outcome.drive):
        lines.append(json.dumps(vars(outcome)) + "\n")
        writer.writerow(_row(outcome))
    for name, text in ((JSONL, "".join(lines)), (CSV, table.getvalue())):
        check_own_file(folder / name)
        write_text(text, folder / name)


def _row(outcome: Outcome) -> list[object]:
    pose: list[object] = [""] * 10
    sigmas: list[object] = [""] * 6
    if outcome.T_camera_lidar is not None:
        T = np.array(outcome.T_camera_lidar)
        pose = [*T[:3, 3].tolist(), *quaternion_xyzw(T).tolist(), *camera_center(T).tolist()]
    if outcome.covariance is not None:
        # The covariance is that of a twist on the left: rho moves the camera centre along the camera's axes.
        deviations = np.sqrt(np.diag(np.array(outcome.covariance))).tolist()
        sigmas = [*deviations[:3], *map(math.degrees, deviations[3:])]
    cells = (outcome.mutual_information_nats, outcome.stamp, outcome.result)
    information, stamp, result = ("" if value is None else value for value in cells)
    head = [outcome.drive, outcome.status, outcome.exit_code, information]
    return [*head, *pose, *sigmas, stamp, result, "; ".join(outcome.reasons)]
