"""Writing of files as a whole or not at all, so that a crash leaves no incomplete file.

Outputs that are not regular files, such as descriptors, pipes and devices, are written to and not replaced. Links are
refused: whoever made the folder of an output, such as a drive from a stranger, would choose what is written.
"""

import errno
import fcntl
import os
import re
import select
import stat
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import takewhile
from pathlib import Path
from time import monotonic, sleep
from typing import BinaryIO

from semcal_cli.config.file_limits import MAX_DOCUMENT_BYTES
from semcal_cli.errors import InputError, SemcalError, os_reason
from semcal_cli.files.input_files import (
    LINK,
    check_own_file,
    check_size,
    is_folder,
    kind_of,
    read_reason,
)

STANDARD_INPUT, STANDARD_OUTPUT = Path("/dev/stdin"), Path("/dev/stdout")
PATIENCE_S, RETRY_S = 5.0, 0.05
"""Time to wait for the reader of a named pipe, which may be starting at the same time, and time between two tries."""
_NUMBERED = re.compile(r"/(?:dev|proc/self)/fd/([0-9]{1,9})")
_NAMED = {"/dev/stdin": 0, "/dev/stdout": 1, "/dev/stderr": 2}


def write_text(text: str, path: Path) -> None:
    """Write a text as UTF-8 with `write_bytes`."""
    write_bytes(text.encode("utf-8"), path)


def write_bytes(content: bytes, path: Path) -> None:
    """Write a file as a whole or not at all: to a temporary file next to it, which is then renamed.

    A descriptor of this process (such as /dev/stdout), a device or a pipe is written to and never replaced.
    A replaced file keeps its permissions.

    Raises:
        InputError: the path holds a link, or the file cannot be written. An existing file is then untouched.
        BrokenPipeError: nothing reads the descriptor any more.
    """
    try:
        if (number := descriptor(path)) is not None:
            _write_to_descriptor(content, number)
            return
        mode = os.lstat(path).st_mode if kind_of(path) else None
        if mode is not None and not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            _check_no_link(path)
            _write_to_special(content, path)
        else:
            _replace(path, [content], mode)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {read_reason(error)}") from None


def write_parts(parts: Iterable[bytes], path: Path) -> None:
    """Write a regular file as a whole or not at all, from its parts one after another; it is not there if they fail.

    Raises:
        InputError: the path holds something that is no file, or the file cannot be written.
        Exception: whatever making the parts raises.
    """
    check_own_file(path)
    try:
        _replace(path, parts, None)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {read_reason(error)}") from None


def _check_no_link(path: Path, needed: str = "a file or nothing") -> None:
    """Check that a path of an output holds no link, which would redirect the output.

    Raises:
        InputError: it holds a link.
    """
    if descriptor(path) is None and kind_of(path) == LINK:
        raise InputError(f"{path}: found a link, expected {needed}")


def _replace(target: Path, parts: Iterable[bytes], mode: int | None) -> None:
    temporary = target.with_name(f".{os.urandom(8).hex()}.tmp")
    try:
        with _temporary_file(temporary) as file:
            file.writelines(parts)
            file.flush()
            os.fsync(file.fileno())
            if mode is not None:
                os.fchmod(file.fileno(), stat.S_IMODE(mode))
            if not temporary.exists():
                # Python follows the link to the file only if it is given a folder, which is then ignored.
                os.link(f"/proc/self/fd/{file.fileno()}", temporary, src_dir_fd=file.fileno())
        temporary.replace(target)
    finally:
        with suppress(OSError):
            temporary.unlink()


def _temporary_file(path: Path) -> BinaryIO:
    """Open a file without a name, so that a killed process leaves none behind; a named file if that is impossible."""
    with suppress(OSError, AttributeError):  # Only Linux has unnamed files, on some of its file systems.
        if Path("/proc/self/fd").exists():
            return os.fdopen(os.open(path.parent, os.O_TMPFILE | os.O_WRONLY, 0o666), "wb")
    return path.open("xb")


def _write_to_descriptor(content: bytes, number: int) -> None:
    """Write to a descriptor of this process, after everything that Python has written to its standard streams."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    rest = memoryview(content)
    while rest:
        try:
            rest = rest[os.write(number, rest) :]
        except BlockingIOError:
            select.select([], [number], [])


def _write_to_special(content: bytes, path: Path) -> None:
    """Write to a pipe or a device. Waits at most `PATIENCE_S` for the reader of a pipe."""
    deadline, number = monotonic() + PATIENCE_S, None
    while number is None:
        try:
            number = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        except OSError as error:
            if error.errno != errno.ENXIO or not path.is_fifo():
                raise
            if monotonic() > deadline:
                raise InputError(f"{path}: found a pipe that nothing reads, expected a reader") from None
            sleep(RETRY_S)
    os.set_blocking(number, True)
    with os.fdopen(number, "wb") as file:
        file.write(content)


def descriptor(path: Path) -> int | None:
    """Find the descriptor of this process that a path names: 1 for /dev/stdout, 3 for /dev/fd/3, or None.

    The real path of a descriptor does not show this, because it is the file that the shell opened.
    """
    match = _NUMBERED.fullmatch(str(path))
    return int(match[1]) if match else _NAMED.get(str(path))


def check_descriptor(path: Path) -> None:
    """Check that a path that names a descriptor can be written to; other paths pass.

    Raises:
        InputError: the descriptor is not open, or is open only for reading.
    """
    number = descriptor(path)
    if number is None:
        return
    try:
        # Python knows whether it was open at the start. Another file may have taken its number since.
        if number == 1 and sys.stdout is None:
            raise OSError
        mode = fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE
    except OSError:
        raise InputError(f"{path}: found a descriptor that is not open, expected one to write to") from None
    if mode == os.O_RDONLY:
        raise InputError(
            f"{path}: found a descriptor that is open only for reading, expected one to write to"
        )


def check_suffix(path: Path | None, *suffixes: str) -> None:
    """Check the suffix of an output, in small or capital letters; None is no output.

    Raises:
        InputError: it is none of these.
    """
    if path is not None and path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected {' or '.join(suffixes)}")


def is_standard_stream(path: Path) -> bool:
    """Return whether a path is the file behind standard output or standard error."""
    for number in (1, 2):
        with suppress(OSError):
            if os.path.samestat(path.stat(), os.fstat(number)):
                return True
    return False


def read_standard_input() -> bytes:
    """Read standard input to its end, up to the maximum size of a document.

    Raises:
        InputError: it is not open, or is too large.
    """
    if sys.stdin is None:
        raise InputError(f"{STANDARD_INPUT}: found a descriptor that is not open, expected one to read from")
    content = sys.stdin.buffer.read(MAX_DOCUMENT_BYTES + 1)
    check_size(STANDARD_INPUT, len(content), MAX_DOCUMENT_BYTES)
    return content


def check_replaceable(path: Path) -> None:
    """Check that `write_bytes` may create or replace a file, before its content is computed.

    Raises:
        InputError: the path holds a link, or its folder is not writable.
    """
    _check_no_link(path)
    folder = Path(os.path.realpath(path.parent))
    if not os.access(folder, os.W_OK):
        raise InputError(f"{path}: no permission to write to its folder {folder}")


def make_folder(path: Path, root: Path | None = None) -> None:
    """Create a folder unless it exists.

    Args:
        path: The folder.
        root: A folder above it, below which no folder may be a link; the user named it, and semcal names what is below.

    Raises:
        InputError: the folder cannot be created, or a folder on the way is a link.
    """
    if root is not None:
        for folder in [path, *path.parents][: len(path.relative_to(root).parts)]:
            _check_no_link(folder, "a folder or nothing")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be created: {os_reason(error)}") from None


@contextmanager
def no_empty_folder(path: Path) -> Iterator[None]:
    """Remove a folder and the folders above it again if the block created them, failed and left them empty."""
    missing = [folder for folder in (path, *path.parents) if not is_folder(folder)]
    try:
        yield
    except BaseException:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()
        raise


@contextmanager
def remove_if_refused(root: Path) -> Iterator[Callable[[bytes, Path], None]]:
    """Yield a function that writes a file below a folder; what it added is removed again if the block is refused."""
    files, folders = list[Path](), list[Path]()

    def write(content: bytes, path: Path) -> None:
        is_new, missing = not path.exists(), takewhile(lambda folder: not folder.exists(), path.parents)
        folders.extend([*missing][::-1])
        make_folder(path.parent, root)
        write_bytes(content, path)
        files.extend([path] * is_new)

    try:
        yield write
    except SemcalError:
        for file in files:
            file.unlink(missing_ok=True)
        for folder in reversed(folders):
            with suppress(OSError):  # others may have written to it
                folder.rmdir()
        raise


@contextmanager
def lock_file(file: Path, run: str) -> Iterator[int]:
    """Lock a file, and thereby its folder, for this run; the lock ends with the process that holds it.

    Args:
        file: File to lock; it is created, with its folder, if it is missing.
        run: Kind of run, for the message.

    Yields:
        Descriptor of the file, for appending to it.

    Raises:
        InputError: another process holds the lock, or the file is a special file or cannot be written to.
    """
    make_folder(file.parent)
    with open_own(file) as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{file.parent}: found another {run} using this folder, expected a separate folder"
            ) from None
        yield stream.fileno()


def open_own(file: Path) -> BinaryIO:
    """Open a file of semcal's own for appending; it is created if it is missing.

    Raises:
        InputError: the path holds a link, a pipe or a folder, or the file cannot be written to.
    """
    check_own_file(file)
    try:
        # A link that takes the file's place now is not followed either, and a pipe is not waited for.
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        return os.fdopen(os.open(file, flags, 0o666), "ab", buffering=0)
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {os_reason(error)}") from None
