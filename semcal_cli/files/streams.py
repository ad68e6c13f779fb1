"""Outputs that are no regular files: descriptors, pipes and devices. They are written to, not replaced."""

import errno
import fcntl
import os
import re
import select
import stat
import sys
from pathlib import Path
from time import monotonic, sleep

from semcal_cli.errors import InputError
from semcal_cli.files.reading import MAX_DOCUMENT_BYTES, check_size

STANDARD_INPUT, STANDARD_OUTPUT = Path("/dev/stdin"), Path("/dev/stdout")
MAX_LINKS = 40
PATIENCE_S = 5.0
"""Time that a named pipe has to find its reader: both sides may have been started together."""
RETRY_S = 0.05
_OF_ANY_PROCESS = re.compile(r"/proc/[0-9]+(/task/[0-9]+)?/fd")


def descriptor(path: Path) -> int | None:
    """Find the descriptor of this process that a path names: 1 for /dev/stdout, 3 for /dev/fd/3.

    The path may be a link to such a name. Its real path does not help: that is the file that the shell opened.

    Returns:
        The number of the descriptor, or None if the path names none.

    Raises:
        InputError: the path names a descriptor of another process.
    """
    ours = {os.path.realpath(name) for name in ("/dev/fd", "/proc/self/fd", "/proc/thread-self/fd")}
    place = path
    for _ in range(MAX_LINKS):
        folder = os.path.realpath(place.parent)
        if folder in ours:
            return int(place.name) if re.fullmatch("[0-9]{1,9}", place.name) else None
        if _OF_ANY_PROCESS.fullmatch(folder):
            raise InputError(f"{path}: found a descriptor of another process, needed a file")
        try:
            place = Path(folder, place.readlink())
        except OSError:
            break
    return None


def check_descriptor(path: Path) -> None:
    """Check that a path that names a descriptor can be written to; other paths pass.

    Raises:
        InputError: the descriptor is not open, or only for reading.
    """
    number = descriptor(path)
    if number is None:
        return
    try:
        # Python knows whether it was open at the start; another file may have its number by now.
        if number == 1 and sys.stdout is None:
            raise OSError
        mode = fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE
    except OSError:
        raise InputError(f"{path}: found a descriptor that is not open, needed one to write to") from None
    if mode == os.O_RDONLY:
        raise InputError(f"{path}: found a descriptor that is only read from, needed one to write to")


def takes_several(path: Path) -> bool:
    """Tell whether several outputs may follow each other in a path: in a descriptor or a device as /dev/null."""
    try:
        return descriptor(path) is not None or stat.S_ISCHR(path.stat().st_mode)
    except OSError:
        return False


def is_standard_stream(path: Path) -> bool:
    """Tell whether a path is the file that the shell opened as standard output or standard error."""
    for number in (1, 2):
        try:
            if os.path.samestat(path.stat(), os.fstat(number)):
                return True
        except OSError:
            continue
    return False


def read_standard_input() -> bytes:
    """Read standard input to its end, or to the largest size of a document.

    Raises:
        InputError: it is not open, or larger.
    """
    if sys.stdin is None:
        raise InputError(f"{STANDARD_INPUT}: found a descriptor that is not open, needed one to read from")
    content = sys.stdin.buffer.read(MAX_DOCUMENT_BYTES + 1)
    check_size(STANDARD_INPUT, len(content), MAX_DOCUMENT_BYTES)
    return content


def write_to_descriptor(content: bytes, number: int) -> None:
    """Write to a descriptor of this process, after all that Python has written to its standard streams.

    Raises:
        OSError: the descriptor cannot be written to; a `BrokenPipeError` if nothing reads it any more.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    rest = memoryview(content)
    while rest:
        try:
            rest = rest[os.write(number, rest) :]
        except BlockingIOError:
            select.select([], [number], [])


def write_to_special(content: bytes, path: Path) -> None:
    """Write to a pipe or a device by its path.

    Raises:
        InputError: nothing reads the pipe.
        OSError: the path cannot be written to.
    """
    number = _open_special(path)
    os.set_blocking(number, True)
    with os.fdopen(number, "wb") as file:
        file.write(content)


def _open_special(path: Path) -> int:
    """Open a pipe or a device without waiting for ever for the reader of a pipe."""
    deadline = monotonic() + PATIENCE_S
    while True:
        try:
            return os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        except OSError as error:
            if error.errno != errno.ENXIO or not stat.S_ISFIFO(path.stat().st_mode):
                raise
        if monotonic() > deadline:
            raise InputError(f"{path}: found a pipe that nothing reads, needed a reader")
        sleep(RETRY_S)
