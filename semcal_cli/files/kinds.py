"""What stands at a path, told without opening it."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from semcal_cli.errors import InputError

FILE, FOLDER, LINK = "a file", "a folder", "a link"
_TESTS = (
    (stat.S_ISREG, FILE),
    (stat.S_ISDIR, FOLDER),
    (stat.S_ISLNK, LINK),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)


def kind_of(path: Path) -> str | None:
    """Describe what stands at a path; links are not followed. None if nothing can be seen there."""
    try:
        mode = os.lstat(path).st_mode
    except (OSError, ValueError):
        return None
    return next((kind for is_kind, kind in _TESTS if is_kind(mode)), "a device")


def check_own_file(path: Path) -> None:
    """Check that a file of our own may be read, replaced or made: nothing else stands at its path.

    A link would lead the writing elsewhere, and the opening of a pipe may never end.

    Raises:
        InputError: something else stands there.
    """
    if (kind := kind_of(path)) not in (FILE, None):
        raise InputError(f"{path}: found {kind}, needed a file or nothing")
