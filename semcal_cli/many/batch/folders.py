"""The folders of a batch's results, which are apart from the drives, made by a batch, and free of links and pipes.

Each folder gets a marker before anything else is written there. A batch thus recognises its own folders, even if it was
killed at any moment, and never replaces a file that a person wrote.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from semcal_cli.errors import InputError, os_reason
from semcal_cli.files.input_files import FILE, FOLDER, LINK, check_own_file, kind_of, read_start
from semcal_cli.files.output_files import lock_file, make_folder, open_own
from semcal_cli.many.batch.records import CSV, JSONL
from semcal_cli.many.batch.tasks import LOG, PART, RECORD, RESULTS, TIMES, Task, folder_of

LOCK, MARKER = ".lock", ".semcal_batch"
"""Markers of the folder of all results and of a drive's folder."""
MARK = b"A folder of semcal batch, which replaces its files.\n"
"""Content of a marker."""
OF_ALL = (LOCK, CSV, JSONL)
OF_DRIVE = (MARKER, RECORD, LOG, TIMES, *RESULTS.values(), *(f"{name}{PART}" for name in RESULTS.values()))
TEMPORARY = re.compile(r"\.[0-9a-f]{16}\.tmp")
"""Names of the files that `files.writing` renames when they are complete."""
_NEEDED = "expected a folder that is new, empty or from a batch"


def check_folders(tasks: Sequence[Task], folder: Path, output: Path) -> None:
    """Check the folders of the results before any work.

    Each drive has its own, they are apart from the drives, and only a batch wrote the files in them.

    Args:
        tasks: The tasks, whose folders are in `folder`.
        folder: The folder of all results, which need not exist.
        output: The same as the user wrote it, for messages.

    Raises:
        InputError: two drives have the same folder, results would be among the files of a drive or in the way of a file
            of the batch, or a folder contains a file that would be replaced, a link, or the results of another batch.
    """
    drives = [task.drive for task in tasks]
    _check_distinct_folders(drives)
    _check_apart(drives, output)
    _check_made_by_batch(tasks, folder, output)


def _check_apart(drives: Iterable[str], output: Path) -> None:
    """Check that the folder of all results is not a drive's folder, and that neither is inside the other."""
    results = os.path.realpath(output)
    for drive in drives:
        for folder in _folders_of_drive(drive):
            shared = os.path.commonpath([results, folder])
            if shared in (results, folder):
                relation = "the folder of" if results == folder else "a folder in"
                relation = relation if shared == folder else "a folder that contains"
                raise InputError(
                    f"{output}: found {relation} drive {drive}, expected a folder apart from the drives"
                )


def _check_distinct_folders(drives: Iterable[str]) -> None:
    """Check that no two drives share a results folder, and that no such folder has the name of a file of the batch."""
    owners: dict[PurePosixPath, str] = {}
    for drive in drives:
        owner = owners.setdefault(folder_of(drive), drive)
        if owner != drive:
            raise InputError(
                f"{owner}, {drive}: found two drives whose results would go to the same folder {folder_of(drive)}, "
                "expected different names or two batches"
            )
    for folder, drive in owners.items():
        for path in (folder, *folder.parents[:-1]):
            if path.name in (OF_DRIVE if path.parent in owners else ()) or str(path) in OF_ALL:
                raise InputError(
                    f"{drive}: found a drive whose results would go to {path}, a file of the batch; choose another name"
                )


def _check_made_by_batch(tasks: Sequence[Task], folder: Path, output: Path) -> None:
    """Check that only a batch wrote the files in the results folders."""
    for name in OF_ALL:
        check_own_file(output / name)
    above = [
        drive_folder / name
        for drive_folder in Path(os.path.realpath(folder)).parents
        for name in (LOCK, MARKER)
    ]
    for marker in (folder / MARKER, *above):
        if _mark(marker) == MARK:
            raise InputError(f"{output}: found the results of another batch in {marker.parent}, {_NEEDED}")
    _check_marker(folder / LOCK, output)
    for task in tasks:
        drive_folder = _find_folder(task, folder, output)
        if drive_folder is not None:
            name_of_folder = output / drive_folder.relative_to(folder)
            if _mark(drive_folder / LOCK) == MARK:
                raise InputError(
                    f"{output}: found the results of another batch in {name_of_folder}, {_NEEDED}"
                )
            _check_marker(drive_folder / MARKER, name_of_folder)


@contextmanager
def claim_folder(folder: Path) -> Iterator[int]:
    """Lock and mark the folder of all results; yields the descriptor of the lock.

    Raises:
        InputError: another batch is using the folder, or it cannot be written to.
    """
    with lock_file(folder / LOCK, "batch") as lock:
        _write_mark(lock, folder / LOCK)
        yield lock


def is_still_claimed(lock: int, folder: Path) -> bool:
    """Return whether the folder of a lock is still there; a person may have removed or replaced it."""
    with suppress(OSError):
        return os.path.samestat(os.fstat(lock), os.lstat(folder / LOCK))
    return False


def make_folder_of_drive(task: Task, folder: Path) -> None:
    """Make and mark the folder of a drive's results, and check that nothing but files is where files will be written.

    Raises:
        InputError: the folder cannot be made, or a link, a pipe or a folder is in the way.
    """
    drive_folder = Path(task.folder)
    _find_folder(task, folder, folder)
    make_folder(drive_folder)
    for name in OF_DRIVE:
        check_own_file(drive_folder / name)
    if _mark(drive_folder / MARKER) != MARK:
        with open_own(drive_folder / MARKER) as marker:
            _write_mark(marker.fileno(), drive_folder / MARKER)


def _folders_of_drive(drive: str) -> set[str]:
    """Find the real folders of a drive; a drive file that is a link has two."""
    path = Path(drive)
    if kind_of(path.resolve()) == FILE:
        return {os.path.realpath(path.parent), str(path.resolve().parent)}
    return {os.path.realpath(path)}


def _check_marker(marker: Path, name_of_folder: Path) -> None:
    """Check that a folder has a marker or no files that would be replaced."""
    mark, folder = _mark(marker), marker.parent
    if mark == MARK:
        return
    names = set[str]()
    with suppress(OSError):  # There is no such folder, or the batch cannot write there.
        names = {path.name for path in folder.iterdir()}
    replaceable = {name for name in names if name in OF_ALL or name in OF_DRIVE or TEMPORARY.fullmatch(name)}
    # A batch that was killed at its start leaves part of a marker. Only files and links are ever replaced.
    kept = {name for name in replaceable if kind_of(folder / name) in (FILE, LINK)}
    if foreign := kept - ({marker.name} if MARK.startswith(mark) else set()):
        raise InputError(f"{name_of_folder}: found {min(foreign)}, which no batch wrote, {_NEEDED}")


def _find_folder(task: Task, folder: Path, output: Path) -> Path | None:
    """Find the folder of a drive's results, which must not be a link; None if there is none yet."""
    path = folder
    for part in Path(task.folder).relative_to(folder).parts:
        path /= part
        kind = kind_of(path)
        if kind == LINK:
            raise InputError(
                f"{output / path.relative_to(folder)}: found a link, expected a folder or nothing"
            )
        if kind != FOLDER:
            return None
    return path


def _mark(path: Path) -> bytes:
    return read_start(path, len(MARK) + 1) if kind_of(path) == FILE else b""


def _write_mark(marker: int, path: Path) -> None:
    """Write a marker, or the rest of one whose writing was interrupted."""
    try:
        num_written = os.fstat(marker).st_size
        if num_written < len(MARK):
            os.write(marker, MARK[num_written:])
            os.fsync(marker)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {os_reason(error)}") from None
