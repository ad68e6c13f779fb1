"""The tasks of a batch and their outcomes: what a drive's result says, or why there is none."""

from __future__ import annotations

import codecs
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, TextIO, TypeAlias

from pydantic import Field, model_validator

from semcal_cli.config import MAX_POINTS
from semcal_cli.config.file_limits import MAX_DOCUMENT_BYTES
from semcal_cli.drive.document import DRIVE_FILE, RIG_FILE, drive_file, read_drive
from semcal_cli.drive.frames import Stamp
from semcal_cli.errors import InputError, printable
from semcal_cli.files.documents import read_document
from semcal_cli.files.input_files import is_folder, read_start
from semcal_cli.files.validation import Figure, FileName, RigidTransform, StrictModel, length, validate
from semcal_cli.result.calibration_document import Topic, read_calibration
from semcal_cli.result.provenance import camera_hash
from semcal_cli.result.uncertainty import Covariance, CovarianceEntries, check_part

LIST_SUFFIXES = (".txt", ".list")
PATTERN_CHARACTERS = "*?["
MAX_SHOWN = 200
"""Number of characters of a wrong name that a message shows."""
MAX_NAME_BYTES = 4095
"""Longest file name, which is Linux's limit: resolving a name of megabytes would take minutes."""


def find_drives(arguments: Sequence[str], stdin: TextIO | None) -> list[str]:
    """List drives, each once, ordered by name.

    Args:
        arguments: Drives, folders of drives, drive files, patterns, text files with one of these on each line, or -
            for standard input.
        stdin: Standard input; None if it is closed.

    Raises:
        InputError: no drives are named, a pattern matches nothing, a list cannot be read, or a name or the working
            folder is not one line of UTF-8 text.
    """
    _check_name(str(Path.cwd()))
    names: dict[str, str] = {}
    for argument in arguments:
        for name in _expand(argument, stdin):
            normal = os.path.normpath(name)
            # Two names of the same drive count once.
            names.setdefault(os.path.realpath(drive_file(Path(normal))), normal)
    if not names:
        raise InputError(f"{', '.join(arguments)}: found no drive, needed at least one")
    return sorted(names.values())


def folder_of(drive: str) -> PurePosixPath:
    """Name the folder of a drive's results after the drive, relative to the folder of all results."""
    path = PurePosixPath(drive)
    if path.name == DRIVE_FILE:
        path = path.parent
    parts = ["__" if part == ".." else part for part in path.parts if part != path.anchor]
    return PurePosixPath(*parts or ["_"])


def _expand(argument: str, stdin: TextIO | None) -> list[str]:
    if argument == "-":
        if stdin is None:
            raise InputError("standard input: found none, expected a list of drives")
        return _read_list(stdin.buffer.read(MAX_DOCUMENT_BYTES + 1), "standard input")
    path = Path(argument)
    if path.suffix.lower() in LIST_SUFFIXES and not is_folder(path):
        return _read_list(read_start(path, MAX_DOCUMENT_BYTES + 1), argument)
    return [_check_name(name) for name in _matches(argument)]


def _read_list(content: bytes, source: str) -> list[str]:
    """Read names of drives, one on each line; empty lines and lines that begin with # are ignored."""
    if len(content) > MAX_DOCUMENT_BYTES:
        raise InputError(
            f"{source}: found more than {MAX_DOCUMENT_BYTES >> 20} MiB, expected a list of drives"
        )
    names = []
    for number, line in enumerate(content.removeprefix(codecs.BOM_UTF8).splitlines(), start=1):
        where = f"{source}: line {number}: "
        name = _check_name(line.strip().decode(errors="surrogateescape"), where)
        if name and not name.startswith("#"):
            names += [_check_name(match, where) for match in _matches(name)]
    return names


def _check_name(name: str, where: str = "") -> str:
    """Check that a name fits in one line of the summary and of the terminal."""
    text = name.encode(errors="surrogateescape").decode(errors="backslashreplace")
    if (
        text == name
        and "\0" not in name
        and len(name.splitlines()) <= 1
        and len(name.encode()) <= MAX_NAME_BYTES
    ):
        return name
    needed = f"expected one line of UTF-8 text of at most {MAX_NAME_BYTES:,} bytes"
    raise InputError(f"{where}{printable(text[:MAX_SHOWN])}: found an invalid file name, {needed}")


def _matches(name: str) -> list[str]:
    path = Path(name)
    # Path.exists raises an error on names that are too long for the system; access only says no.
    is_drive = any(os.access(path / file, os.F_OK) for file in (DRIVE_FILE, RIG_FILE))
    if is_folder(path) and not is_drive and (drives := [*path.glob(f"*/{DRIVE_FILE}")]):
        return sorted(str(file.parent) for file in drives)
    if not any(character in name for character in PATTERN_CHARACTERS) or os.access(path, os.F_OK):
        return [name]
    root = Path(path.anchor)
    try:
        matches = sorted(map(str, root.glob(str(path.relative_to(root)))))
    except (OSError, ValueError) as error:
        raise InputError(f"{name}: found an invalid pattern: {' '.join(str(error).splitlines())}") from None
    if not matches:
        raise InputError(f"{name}: found no match for this pattern, expected drives")
    return matches


RECORD, LOG, TIMES = "record.json", "log.txt", "times.json"
RESULTS = {"calibrate": "calibration.yaml", "verify": "verification.json"}
PART = ".part"
"""Suffix of a result that is being written."""
FAILED = "failed"
"""Status of a drive without an answer."""
OutcomeStatus: TypeAlias = Literal[
    "trusted", "not_trusted", "not_assessed", "pass", "fail", "inconclusive", "failed"
]


@dataclass(frozen=True)
class Task:
    """The run of a command on one drive, in any process; paths are absolute."""

    drive: str
    """Name of the drive as the user wrote it."""
    path: str
    """The drive's folder or file."""
    folder: str
    """Folder of the drive's result, log and record."""
    command: str
    """`calibrate` or `verify`."""
    arguments: tuple[str, ...] = ()
    """Arguments of the command that affect the answer."""
    other_files: tuple[str, ...] = ()
    """Files that the command reads besides those of the drive."""
    num_threads: int = 1
    """Threads of its process."""
    max_points: int = MAX_POINTS
    """Points of the largest sweep that the command reads."""
    timeout_s: float | None = None
    """Seconds after which the drive has failed; None without a limit."""

    @property
    def result(self) -> Path:
        """File of the result."""
        return Path(self.folder) / RESULTS[self.command]

    @property
    def unfinished_result(self) -> Path:
        """File of the result while it is being written."""
        return self.result.with_name(f"{self.result.name}{PART}")

    @property
    def log(self) -> Path:
        """File of what the command prints."""
        return Path(self.folder) / LOG

    @property
    def times(self) -> Path:
        """File of the events of the command, with their times."""
        return Path(self.folder) / TIMES


class Outcome(StrictModel):
    """The outcome of a drive: a line of the summary. It contains neither times nor machines."""

    drive: FileName
    """The drive as it was given."""
    status: OutcomeStatus
    """Status of the calibration, verdict of `verify`, or `failed`."""
    exit_code: Literal[0, 1, 3, 4]
    """Exit code of the command."""
    reasons: Annotated[tuple[str, ...], length(0)]
    """Sentences that say why the drive is not trusted or has failed."""
    topics: Annotated[tuple[Topic, ...], length(0)] = ()
    """Topic of each reason, which is its entry in docs/troubleshooting.md; empty for a drive that has failed."""
    stamp: Stamp | None = None
    """Stamp of the first frame in seconds, if it has one."""
    T_camera_lidar: RigidTransform | None = None
    """(4, 4) rows of the transform."""
    covariance: CovarianceEntries | None = None
    """(6, 6) covariance of xi = (rho, phi), camera frame, left perturbation."""
    mutual_information_nats: Figure | None = None
    """Mutual information at the transform."""
    camera: Annotated[str, Field(pattern=r"\S")] | None = None
    """Hash of the camera, given or estimated, that the transform belongs to; see `provenance.camera_hash`."""
    result: FileName | None = None
    """File of the result, relative to the folder of the batch."""
    covariance_of_intrinsics: Covariance | None = None
    """(6, 6) part of the covariance from errors of K, which all drives of a camera share."""

    _check_part = model_validator(mode="after")(check_part)

    @property
    def is_failed(self) -> bool:
        """Whether the drive has no answer."""
        return self.status == FAILED


def failed_outcome(drive: str, reason: str) -> Outcome:
    """Make the outcome of a drive without an answer; its reason is put on one line of valid UTF-8."""
    text = reason.encode(errors="backslashreplace").decode()
    reasons = (" ".join(text.splitlines()),)
    return Outcome(drive=drive, status="failed", exit_code=1, reasons=reasons)


def describe_outcome(task: Task, exit_code: int, line: str) -> Outcome:
    """Describe the outcome of a command that ended.

    Args:
        task: Task of the command.
        exit_code: Exit code of the command.
        line: The error that the command printed; empty if there was none.

    Raises:
        InputError: the file of the result is not a result of the command.
    """
    if exit_code in (0, 3, 4):
        return describe_result(task, exit_code)
    return failed_outcome(task.drive, line or f"the command ended with exit code {exit_code}")


def describe_result(task: Task, exit_code: int) -> Outcome:
    """Read the result of a command.

    Args:
        task: Task of the command.
        exit_code: Exit code of the command: 0, 3 or 4.

    Raises:
        InputError: the file is not a result of the command.
    """
    fields: dict[str, Any] = {"drive": task.drive, "exit_code": exit_code}
    fields["stamp"] = read_drive(Path(task.path)).first_stamp
    fields["result"] = str(folder_of(task.drive) / task.result.name)
    if task.command == "calibrate":
        calibration = read_calibration(task.result)
        uncertainty = calibration.uncertainty
        fields |= {
            "status": calibration.status,
            "reasons": calibration.reasons,
            "topics": calibration.topics,
            "T_camera_lidar": calibration.rows_camera_lidar,
            "covariance": uncertainty and uncertainty.covariance,
            "mutual_information_nats": calibration.quality.mutual_information_nats,
            "camera": camera_hash(calibration.used_camera),
            "covariance_of_intrinsics": uncertainty and uncertainty.covariance_of_intrinsics,
        }
    else:
        document = read_document(task.result)
        fields |= {key: document.get(key) for key in ("reasons", "topics", "T_camera_lidar")}
        fields["status"] = document.get("verdict")
    return validate(Outcome, fields, task.result)
