"""Failures that are the machine's, not the drive's: another run may succeed without any change."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path

MACHINE = frozenset(
    {
        *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO),
        *(errno.ENOMEM, errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.EBUSY, errno.EINTR, errno.ENOLCK),
        *(errno.ESTALE, errno.ETIMEDOUT, errno.ENOTCONN, errno.EHOSTDOWN, errno.EHOSTUNREACH, errno.ENETDOWN),
    }
)
"""Errors of the system that no file's content causes: full and broken disks, limits, lost storage."""


def is_of_machine(failure: BaseException | None, folder: Path) -> bool:
    """Tell whether a run failed for the machine's reasons.

    Args:
        failure: The error that ended the run, if any.
        folder: Folder of the results: whatever cannot be written there is not the drive's fault.
    """
    return any(
        isinstance(cause, MemoryError)
        or (isinstance(cause, OSError) and (cause.errno in MACHINE or _is_in(cause.filename, folder)))
        for cause in _causes(failure)
    )


def _causes(failure: BaseException | None) -> Iterator[BaseException]:
    """Yield an error, and those that it was raised for; an error for the user is raised for one of the system."""
    while failure is not None:
        yield failure
        failure = failure.__cause__ or failure.__context__


def _is_in(name: object, folder: Path) -> bool:
    return isinstance(name, str) and os.path.realpath(name).startswith(os.path.realpath(folder) + os.sep)
