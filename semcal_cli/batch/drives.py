"""The drives of a batch, by their names, and what their results' folders are called."""

from __future__ import annotations

import codecs
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import TextIO

from semcal_cli.drive.document import DRIVE_FILE, drive_file
from semcal_cli.errors import InputError, printable
from semcal_cli.files.reading import MAX_DOCUMENT_BYTES, is_folder, read_start

LISTS = (".txt", ".list")
MAGIC = "*?["
MAX_SHOWN = 200
"""Characters of a wrong name that a message shows."""
MAX_NAME_BYTES = 4095
"""Longest name of a file, which is that of Linux: looking up the parts of one of megabytes takes minutes."""


def find_drives(arguments: Sequence[str], stdin: TextIO | None) -> list[str]:
    """List drives, each once, in the order of their names.

    Args:
        arguments: Folders, drive files, patterns, text files with one of these a line, or - for standard input.
        stdin: Standard input; None if it is closed.

    Raises:
        InputError: no drives are named, a pattern matches nothing, a list cannot be read, or a name or the working
            folder's is not one line of UTF-8 text.
    """
    _checked(str(Path.cwd()))
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


def _expanded(argument: str, stdin: TextIO | None) -> list[str]:
    if argument == "-":
        if stdin is None:
            raise InputError("standard input: found none, needed a list of drives")
        return _listed(stdin.buffer.read(MAX_DOCUMENT_BYTES + 1), "standard input")
    path = Path(argument)
    if path.suffix.lower() in LISTS and not is_folder(path):
        return _listed(read_start(path, MAX_DOCUMENT_BYTES + 1), argument)
    return [_checked(name) for name in _matches(argument)]


def _listed(content: bytes, source: str) -> list[str]:
    """Names of drives, one on each line; empty lines and lines that begin with # are ignored.

    Raises:
        InputError: a line is no text; the message names it.
    """
    if len(content) > MAX_DOCUMENT_BYTES:
        raise InputError(f"{source}: found more than {MAX_DOCUMENT_BYTES >> 20} MiB, needed a list of drives")
    names = []
    for number, line in enumerate(content.removeprefix(codecs.BOM_UTF8).splitlines(), start=1):
        where = f"{source}: line {number}: "
        name = _checked(line.strip().decode(errors="surrogateescape"), where)
        if name and not name.startswith("#"):
            names += [_checked(found, where) for found in _matches(name)]
    return names


def _checked(name: str, where: str = "") -> str:
    """Check that a name can stand in a line of the summary and of the terminal.

    Raises:
        InputError: it is too long, is not UTF-8, or has a line break or a NUL.
    """
    if (num_bytes := len(name.encode(errors="surrogateescape"))) > MAX_NAME_BYTES:
        raise InputError(f"{where}found a name of {num_bytes:,} bytes, needed at most {MAX_NAME_BYTES:,}")
    text = name.encode(errors="surrogateescape").decode(errors="backslashreplace")
    if text != name:
        found = "a name that is not UTF-8"
    elif "\0" in name or name.splitlines() not in ([name], []):
        found = "a NUL or a line break in a name"
    else:
        return name
    shown = printable(text[:MAX_SHOWN])
    raise InputError(f"{where}{shown}: found {found}, needed one line of UTF-8 text")


def _matches(name: str) -> list[str]:
    path = Path(name)
    if not any(character in name for character in MAGIC) or _exists(path):
        return [name]
    root = Path(path.anchor)
    try:
        found = sorted(map(str, root.glob(str(path.relative_to(root)))))
    except (OSError, ValueError) as error:
        raise InputError(f"{name}: found no pattern: {' '.join(str(error).splitlines())}") from None
    if not found:
        raise InputError(f"{name}: found nothing of this pattern, needed drives")
    return found


def _exists(path: Path) -> bool:
    """Tell whether a path exists; one that is too long for the system does not."""
    with suppress(OSError):
        return path.exists()
    return False
