"""Reading of whole regular files, up to a limit, and tests of paths."""

from __future__ import annotations

import errno
import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from numpy.lib.format import open_memmap

from semcal_cli.config.file_limits import MAX_DOCUMENT_BYTES
from semcal_cli.errors import InputError, mismatch, os_reason
from semcal_cli.geometry.arrays import Array

_WITHOUT_WAITING = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""Flags that open a pipe without waiting for a writer."""
_MAX_POINTER_BYTES, _POINTER = 1024, b"version https://git-lfs.github.com/spec/"
"""Size of the largest pointer that Git LFS writes in place of a file, and its first bytes; see its specification."""
_PIECE_BYTES = 1 << 20
"""Bytes that are read and hashed at a time."""


def is_folder(path: Path) -> bool:
    """Return whether a path is a folder; names that are too long for the system are not."""
    with suppress(OSError):
        return path.is_dir()
    return False


def is_same_file(a: Path, b: Path) -> bool:
    """Return whether two paths lead to the same file, also through links."""
    return os.path.realpath(a) == os.path.realpath(b)


@contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file for reading; pipes and devices are refused, because reading them may not end.

    The kind of file is tested before it is opened, because opening a device may have side effects, and again
    afterwards, because another file may have taken its name.

    Raises:
        InputError: the file is missing, cannot be read, is a special file, or a Git LFS pointer in place of the file.
    """
    try:
        _check_regular(path, path.stat())
        with os.fdopen(os.open(path, _WITHOUT_WAITING), "rb") as file:
            _check_regular(path, os.fstat(file.fileno()))
            if 0 < size_of(file) <= _MAX_POINTER_BYTES:
                if file.read(len(_POINTER)) == _POINTER:
                    needed = "the file itself: run `git lfs pull`"
                    raise InputError(f"{path}: {mismatch('a Git LFS pointer', needed)}")
                file.seek(0)
            yield file
    except OSError as error:
        if error.errno == errno.ENXIO:
            raise _no_file(path, "a special file") from None
        raise InputError(f"{path}: {read_reason(error)}") from None


def size_of(file: BinaryIO) -> int:
    """Return the size of an open file in bytes."""
    return os.fstat(file.fileno()).st_size


def check_size(path: Path, size: int, limit: int, needed_for: str = "") -> None:
    """Check the size of a file in bytes; `needed_for` says what the limit applies to.

    Raises:
        InputError: the file is larger than the limit.
    """
    if size > limit:
        raise InputError(f"{path}: {mismatch(f'{size:,} bytes', f'at most {limit:,}{needed_for}')}")


def read_bytes(path: Path, *, limit: int = MAX_DOCUMENT_BYTES) -> bytes:
    """Read a regular file of at most `limit` bytes.

    Raises:
        InputError: the file is missing, cannot be read, or is too large.
    """
    with open_file(path) as file:
        size = size_of(file)
        check_size(path, size, limit)
        content = file.read(size + 1)
        # Files that the system generates, such as those in /proc, have size 0.
        while len(content) <= limit and (more := file.read(min(_PIECE_BYTES, limit + 1))):
            content += more
        check_size(path, len(content), limit)
        return content


def read_start(path: Path, count: int) -> bytes:
    """Read the first `count` bytes of a regular file.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    with open_file(path) as file:
        return file.read(count)


def read_text(path: Path, *, limit: int = MAX_DOCUMENT_BYTES) -> str:
    """Read a UTF-8 file of at most `limit` bytes, with or without a byte order mark.

    Raises:
        InputError: the file is missing, is too large, or is not UTF-8.
    """
    try:
        return read_bytes(path, limit=limit).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8 text") from None


def hash_file(path: Path) -> str:
    """Compute the SHA-256 of a regular file of any size, in hexadecimal digits.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    from hashlib import sha256

    digest = sha256()
    with open_file(path) as file:
        while piece := file.read(_PIECE_BYTES):
            digest.update(piece)
    return digest.hexdigest()


def read_reason(error: OSError) -> str:
    """Describe in a few words why a path cannot be read or written."""
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return "no such file or folder"
    return os_reason(error)


def _check_regular(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise _no_file(path, "a folder" if stat.S_ISDIR(status.st_mode) else "a special file")


def _no_file(path: Path, kind: str) -> InputError:
    return InputError(f"{path}: found {kind}, expected a file")


FILE, FOLDER, LINK = "a file", "a folder", "a link"
_TESTS = (
    (stat.S_ISREG, FILE),
    (stat.S_ISDIR, FOLDER),
    (stat.S_ISLNK, LINK),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)


def kind_of(path: Path) -> str | None:
    """Describe what is at a path, without following links. None if nothing is found there."""
    try:
        mode = os.lstat(path).st_mode
    except (OSError, ValueError):
        return None
    return next((kind for is_kind, kind in _TESTS if is_kind(mode)), "a device")


def check_own_file(path: Path) -> None:
    """Check that a file of semcal's own may be read, replaced or created: its path holds a regular file or nothing.

    A link would redirect the output, and opening a pipe may never return.

    Raises:
        InputError: the path holds something else.
    """
    if (kind := kind_of(path)) not in (FILE, None):
        raise InputError(f"{path}: found {kind}, expected a file or nothing")


def map_array(path: Path, max_bytes: int, needed_for: str = "") -> Array:
    """Map the array of a `.npy` file of at most `max_bytes` bytes into memory, without reading it.

    Args:
        path: The file.
        max_bytes: Maximum size.
        needed_for: What the limit applies to, for the message.

    Raises:
        InputError: the file is missing, is too large, or holds no array.
    """
    with open_file(path) as file:
        check_size(path, size_of(file), max_bytes, needed_for)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return open_memmap(path, mode="r")  # Python objects are refused.
    except Exception:  # The header is a Python literal, which can fail in many ways.
        raise InputError(f"{path}: found no NumPy array") from None
