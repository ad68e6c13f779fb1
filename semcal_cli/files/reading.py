"""Reading of regular files as a whole, and tests of paths."""

import os
import stat
from contextlib import suppress
from pathlib import Path

from semcal_cli.errors import InputError
from semcal_cli.files.messages import os_reason


def is_folder(path: Path) -> bool:
    """Tell whether a path is a folder, also for names that are too long for the system."""
    with suppress(OSError):
        return path.is_dir()
    return False


def is_same_file(a: Path, b: Path) -> bool:
    """Tell whether two paths lead to one file, by links or otherwise."""
    return os.path.realpath(a) == os.path.realpath(b)


def read_bytes(path: Path, count: int | None = None) -> bytes:
    """Read a regular file, or its first `count` bytes; pipes and devices are refused, since reading them may not end.

    Raises:
        InputError: the file is missing, or cannot be read.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            found = "a folder" if path.is_dir() else "no regular file"
            raise InputError(f"{path}: found {found}, needed a file")
        with path.open("rb") as file:
            return file.read() if count is None else file.read(count)
    except OSError as error:
        raise InputError(f"{path}: {read_reason(error)}") from None


def read_text(path: Path) -> str:
    """Read a UTF-8 file, with or without a byte order mark.

    Raises:
        InputError: the file is missing, or is not UTF-8.
    """
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8 text") from None


def read_reason(error: OSError) -> str:
    """Describe in a few words why a path cannot be read or written."""
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return "no such file or folder"
    return os_reason(error)
