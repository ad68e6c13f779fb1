"""The drives of a batch, and the folders of their results."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

from semcal_cli.drive.document import DRIVE_FILE, drive_file
from semcal_cli.errors import InputError
from semcal_cli.files.reading import is_folder, read_text

LISTS = (".txt", ".list")
MAGIC = "*?["


def find_drives(arguments: Sequence[str], stdin: Iterable[str]) -> list[str]:
    """List drives, each once, in the order of their names.

    Args:
        arguments: Folders, drive files, patterns, text files with one of these a line, or - for standard input.
        stdin: Lines of standard input.

    Raises:
        InputError: no drives are named, a pattern matches nothing, or a text file cannot be read.
    """
    found: dict[str, str] = {}
    for argument in arguments:
        for name in _expanded(argument, stdin):
            normal = os.path.normpath(name)
            # Two names of the same drive count once.
            found.setdefault(os.path.realpath(drive_file(Path(normal))), normal)
    if not found:
        raise InputError(f"{', '.join(arguments)}: found no drive, needed at least one")
    return sorted(found.values())


def folder_of(drive: str) -> PurePosixPath:
    """Folder of a drive's results, relative to the folder of all results: it has the drive's name."""
    path = PurePosixPath(drive)
    if path.name == DRIVE_FILE:
        path = path.parent
    parts = ["__" if part == ".." else part for part in path.parts if part != path.anchor]
    return PurePosixPath(*parts or ["_"])


def check_folders(drives: Iterable[str]) -> None:
    """Check that no two drives have the same results folder.

    Raises:
        InputError: two drives have the same folder.
    """
    owners: dict[PurePosixPath, str] = {}
    for drive in drives:
        owner = owners.setdefault(folder_of(drive), drive)
        if owner != drive:
            raise InputError(
                f"{owner}, {drive}: found two drives whose results would go to one folder, {folder_of(drive)}, needed "
                "other names, or two batches"
            )


def _expanded(argument: str, stdin: Iterable[str]) -> list[str]:
    if argument == "-":
        return _listed(stdin)
    path = Path(argument)
    if path.suffix.lower() in LISTS and not is_folder(path):
        return _listed(read_text(path).splitlines())
    return _matches(argument)


def _listed(lines: Iterable[str]) -> list[str]:
    """Names of drives, one on each line; empty lines and lines that begin with # are ignored."""
    stripped = (line.strip() for line in lines)
    return [name for line in stripped if line and not line.startswith("#") for name in _matches(line)]


def _matches(name: str) -> list[str]:
    path = Path(name)
    if not any(character in name for character in MAGIC) or path.exists():
        return [name]
    root = Path(path.anchor)
    found = sorted(map(str, root.glob(str(path.relative_to(root)))))
    if not found:
        raise InputError(f"{name}: found nothing of this pattern, needed drives")
    return found
