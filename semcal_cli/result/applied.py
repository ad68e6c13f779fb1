"""A drive as a result sees it: with the camera and the clock that were estimated together with its transform."""

from __future__ import annotations

from typing import NamedTuple

from semcal_cli.drive.document import Drive
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.camera_words import camera_differences, offset_words


class Applied(NamedTuple):
    """A drive with the camera and the clock of a result, and what they have changed."""

    drive: Drive
    changes: tuple[tuple[str, str], ...] = ()
    """A label and a line for each change: `camera` or `clock`, and what is used instead of what."""


def apply_result(record: Calibration | None, drive: Drive, name: str) -> Applied:
    """Give a drive the camera and the clock that a result estimated together with its transform.

    A camera with another lens or picture size is of other pictures, so the drive keeps its own then.

    Args:
        record: The result; None, or one without a camera and a clock, leaves the drive as it is.
        drive: The drive.
        name: Name of the result's file.
    """
    if record is None:
        return Applied(drive)
    applied, changes = record.applied_to(drive), list[tuple[str, str]]()
    found, own = applied.camera, drive.camera
    if (found.model, found.width, found.height) != (own.model, own.width, own.height):
        applied = applied.model_copy(update={"camera": own, "time_offset_s": drive.time_offset_s})
        kind = f"{found.model} of {found.width} x {found.height} pixels"
        changes.append(("camera", f"that of {drive.path}: the one of {name} is {kind}"))
    elif found != own:
        changes.append(("camera", f"that of {name}: {', '.join(camera_differences(found, own, 'drive'))}"))
    if drive.motion is not None and applied.time_offset_s != drive.time_offset_s:
        drives = f"drive: {1000.0 * drive.time_offset_s:.1f} ms"
        changes.append(("clock", f"that of {name}: {offset_words(applied.time_offset_s)} ({drives})"))
    return Applied(applied, tuple(changes))
