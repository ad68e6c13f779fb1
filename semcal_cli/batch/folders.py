"""The folders of a batch's results: apart from the drives, made by a batch, and free of links and pipes.

Each folder gets a marker before anything else is written there. A batch then knows its own folders, also after it was
killed at any moment, and never replaces a file that a person wrote.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from semcal_cli.batch.records import CSV, JSONL, has_record, has_summary
from semcal_cli.batch.tasks import LOG, PART, RECORD, RESULTS, TIMES, Task, folder_of
from semcal_cli.drive.document import drive_file, read_drive
from semcal_cli.errors import InputError, os_reason
from semcal_cli.files.reading import FILE, FOLDER, LINK, check_own_file, kind_of, read_start, read_text
from semcal_cli.files.writing import locked, open_own

LOCK, MARKER = ".lock", ".semcal_batch"
"""Markers of the folder of all results and of a drive's."""
MARK = b"A folder of semcal batch, which replaces its files.\n"
"""Content of a marker."""
OF_ALL = (LOCK, CSV, JSONL)
OF_DRIVE = (MARKER, RECORD, LOG, TIMES, *RESULTS.values(), *(f"{name}{PART}" for name in RESULTS.values()))
_APART = "needed a folder apart from the drives"
_NEEDED = "needed a folder that is new, empty or of a batch"
_OUTWARD = re.compile(r"\.\.|\\|(?:^|[\s\"'\[{,:])/", re.MULTILINE)
"""What the text of a drive has that names files elsewhere: parents, absolute paths, or escapes, which may hide them."""
TEMPORARY = re.compile(r"\.[0-9a-f]{16}\.tmp")
"""Names of the files that `files.writing` renames when they are whole."""


def check_apart(drives: Iterable[str], output: Path) -> None:
    """Check that the folder of all results is no drive's folder, and that none of them lies in the other.

    The folders of the files that a drive names are its own as well, wherever they are.

    Args:
        drives: The drives, folders or files.
        output: The folder as the user gave it.

    Raises:
        InputError: results would lie among the files of a drive.
    """
    results = os.path.realpath(output)
    for drive in drives:
        own = _folders_of_drive(drive)
        for folder in own:
            shared = os.path.commonpath([results, folder])
            if shared in (results, folder):
                found = "the folder of" if results == folder else "a folder in"
                found = found if shared == folder else "a folder that holds"
                raise InputError(f"{output}: found {found} drive {drive}, {_APART}")
        for folder in _folders_of_files(drive):
            shared = os.path.commonpath([results, folder])
            # A folder that holds the drive, and with it one of its files, may hold results as well.
            is_above = any(os.path.commonpath([folder, place]) == folder for place in own)
            if shared == results or (shared == folder and not is_above):
                found = "a folder in one with" if shared == folder else "a folder that holds"
                found = "a folder with" if results == folder else found
                raise InputError(f"{output}: found {found} files of drive {drive}, {_APART}")


def check_distinct_folders(drives: Iterable[str]) -> None:
    """Check that no two drives have the same results folder, and that none has the name of a file of results.

    Raises:
        InputError: two drives have the same folder, or a drive's folder would be in the way of a file.
    """
    owners: dict[PurePosixPath, str] = {}
    for drive in drives:
        owner = owners.setdefault(folder_of(drive), drive)
        if owner != drive:
            raise InputError(
                f"{owner}, {drive}: found two drives whose results would go to one folder, {folder_of(drive)}, needed "
                "other names, or two batches"
            )
    for folder, drive in owners.items():
        for path in (folder, *folder.parents[:-1]):
            if path.name in (OF_DRIVE if path.parent in owners else ()) or str(path) in OF_ALL:
                raise InputError(
                    f"{drive}: found a drive whose results would go to {path}, a file of the batch, needed another name"
                )


def check_made_by_batch(tasks: Sequence[Task], folder: Path, output: Path) -> None:
    """Check that no file of the results folders was written by anything but a batch; to be called before any work.

    Args:
        tasks: The tasks, whose folders lie in `folder`.
        folder: The folder of all results, which need not exist.
        output: The same as the user gave it, for messages.

    Raises:
        InputError: a folder has a file that would be replaced, or a link is in the way.
    """
    for name in OF_ALL:
        check_own_file(output / name)
    _check_of_no_other_batch(folder, output)
    _check_made_by_batch(folder / LOCK, has_summary, output)
    for task in tasks:
        place = _find_folder(task, folder, output)
        if place is not None:
            if _mark(place / LOCK) == MARK:
                raise InputError(
                    f"{output / place.relative_to(folder)}: found the results of another batch, {_NEEDED}"
                )
            _check_made_by_batch(place / MARKER, has_record, output / place.relative_to(folder))


@contextmanager
def claimed(folder: Path) -> Iterator[int]:
    """Lock the folder of all results, and mark it; gives the descriptor of the lock.

    Raises:
        InputError: another batch is using the folder, or it cannot be written to.
    """
    with locked(folder / LOCK, "batch") as lock:
        _write_mark(lock, folder / LOCK)
        yield lock


def is_still_claimed(lock: int, folder: Path) -> bool:
    """Tell whether the folder of a lock is still there; a person may have removed or replaced it."""
    with suppress(OSError):
        return os.path.samestat(os.fstat(lock), os.lstat(folder / LOCK))
    return False


def make_folder_of_drive(task: Task, folder: Path) -> None:
    """Make and mark the folder of a drive's results, and check that only files stand where files will be written.

    Raises:
        InputError: the folder cannot be made, or a link, a pipe or a folder is in the way.
    """
    place = Path(task.folder)
    _find_folder(task, folder, folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{place}: cannot be made: {os_reason(error)}") from None
    for name in OF_DRIVE:
        check_own_file(place / name)
    if _mark(place / MARKER) != MARK:
        with open_own(place / MARKER) as marker:
            _write_mark(marker.fileno(), place / MARKER)


def _folders_of_drive(drive: str) -> set[str]:
    """Real folders of a drive's files; a drive file that is a link has two."""
    path, is_file = Path(drive), False
    with suppress(OSError):  # The system refuses to look up names that are too long.
        is_file = path.is_file()
    if not is_file:
        return {os.path.realpath(path)}
    return {os.path.realpath(path.parent), str(path.resolve().parent)}


def _folders_of_files(drive: str) -> set[str]:
    """Real folders of the files that a drive names; none for a drive that cannot be read.

    A drive whose names cannot lead out of its own folder is not parsed, which takes long for many drives.
    """
    with suppress(InputError, OSError, ValueError):
        file = drive_file(Path(drive))
        with os.scandir(file.parent) as entries:
            has_links = any(entry.is_symlink() for entry in entries)
        if has_links or _OUTWARD.search(read_text(file)):
            opened = read_drive(file)
            return set(map(os.path.realpath, {opened.resolve(name).parent for name in opened.files()}))
    return set()


def _check_made_by_batch(marker: Path, is_earlier: Callable[[Path], bool], shown: Path) -> None:
    """Check that a folder has a marker, no files to lose, or results of a version that wrote no markers."""
    mark, folder = _mark(marker), marker.parent
    if mark == MARK:
        return
    # A batch that is killed as it begins leaves a part of a marker; the lock of earlier versions is empty.
    names = _names_of_results(folder) - ({marker.name} if MARK.startswith(mark) else set())
    if names and (marker.name in names or not is_earlier(folder)):
        raise InputError(f"{shown}: found {min(names)}, which no batch wrote, {_NEEDED}")


def _check_of_no_other_batch(folder: Path, output: Path) -> None:
    """Check that a folder of all results is no drive's of another batch, and lies in no results of one.

    Raises:
        InputError: it is, or it does.
    """
    if _mark(folder / MARKER) == MARK:
        raise InputError(f"{output}: found the results of one drive of another batch, {_NEEDED}")
    for above in Path(os.path.realpath(folder)).parents:
        if MARK in (_mark(above / LOCK), _mark(above / MARKER)):
            raise InputError(f"{output}: found a folder in {above}, the results of another batch, {_NEEDED}")


def _find_folder(task: Task, folder: Path, output: Path) -> Path | None:
    """Find the folder of a drive's results; None if there is none yet.

    Raises:
        InputError: the folder, or one that it lies in, is a link.
    """
    place = folder
    for part in Path(task.folder).relative_to(folder).parts:
        place /= part
        kind = kind_of(place)
        if kind == LINK:
            raise InputError(
                f"{output / place.relative_to(folder)}: found a link, needed a folder or nothing"
            )
        if kind != FOLDER:
            return None
    return place


def _names_of_results(folder: Path) -> set[str]:
    """Names of results that a folder has, of files and links only: nothing else is ever replaced."""
    try:
        with os.scandir(folder) as entries:
            return {entry.name for entry in entries if _is_ours(entry.name) and not _is_safe(entry)}
    except OSError:
        return set()  # There is no such folder, or the batch cannot write there.


def _is_ours(name: str) -> bool:
    return name in OF_ALL or name in OF_DRIVE or TEMPORARY.fullmatch(name) is not None


def _is_safe(entry: os.DirEntry[str]) -> bool:
    return kind_of(Path(entry.path)) not in (FILE, LINK)


def _mark(path: Path) -> bytes:
    """Read a marker; empty if there is none."""
    return read_start(path, len(MARK) + 1) if kind_of(path) == FILE else b""


def _write_mark(marker: int, path: Path) -> None:
    """Write a marker, or what is missing of one whose writing was interrupted."""
    try:
        written = os.fstat(marker).st_size
        if written < len(MARK):
            os.write(marker, MARK[written:])
            os.fsync(marker)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {os_reason(error)}") from None
