"""Writing of files as a whole or not at all, so that a crash leaves no incomplete file."""

import os
import stat
from contextlib import suppress
from pathlib import Path

from semcal_cli.errors import InputError, os_reason
from semcal_cli.files.reading import read_reason
from semcal_cli.files.streams import descriptor, write_to_descriptor, write_to_special


def write_text(text: str, path: Path) -> None:
    """Write a UTF-8 file as `write_bytes` does."""
    write_bytes(text.encode("utf-8"), path)


def write_bytes(content: bytes, path: Path) -> None:
    """Write a file as a whole or not at all: to a temporary file beside it, which is then renamed.

    A descriptor of this process (such as /dev/stdout), a device or a pipe is never replaced: the content goes into it.
    A file that is replaced keeps its permissions.

    Raises:
        InputError: the file cannot be written. An existing file stays untouched then.
        BrokenPipeError: nothing reads the descriptor any more.
    """
    target, number = Path(os.path.realpath(path)), descriptor(path)
    try:
        if number is not None:
            write_to_descriptor(content, number)
            return
        mode = target.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            write_to_special(content, path)
            return
    except FileNotFoundError:
        mode = None
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {read_reason(error)}") from None
    temporary = target.with_name(f".{os.urandom(8).hex()}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if mode is not None:
            temporary.chmod(stat.S_IMODE(mode))
        temporary.replace(target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {read_reason(error)}") from None
    finally:
        with suppress(OSError):
            temporary.unlink()


def check_replaceable(path: Path) -> None:
    """Check that `write_bytes` may make or replace a file, before the work for its content begins.

    Raises:
        InputError: nothing may be written to its folder.
    """
    folder = Path(os.path.realpath(path)).parent
    if not os.access(folder, os.W_OK):
        raise InputError(f"{path}: found no right to write to its folder {folder}, needed it")


def make_folder(path: Path) -> None:
    """Create a folder, unless it exists.

    Raises:
        InputError: the folder cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {os_reason(error)}") from None
