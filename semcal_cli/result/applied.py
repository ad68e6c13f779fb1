"""A drive as a result sees it: with the camera and the clock that were estimated together with its transform.

The poses of a result before that estimate belong to the camera and the clock that it began with.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from semcal_cli.drive.delay import delayed, twists_per_s
from semcal_cli.drive.document import Camera, Drive
from semcal_cli.drive.observations import Observations
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
    if not _is_of_same_pictures(found, own):
        applied = applied.model_copy(update={"camera": own, "time_offset_s": drive.time_offset_s})
        kind = f"{found.model} of {found.width} x {found.height} pixels"
        changes.append(("camera", f"that of {drive.path}: the one of {name} is {kind}"))
    elif found != own:
        changes.append(("camera", f"that of {name}: {', '.join(camera_differences(found, own, 'drive'))}"))
    if drive.motion is not None and applied.time_offset_s != drive.time_offset_s:
        drives = f"drive: {1000.0 * drive.time_offset_s:.1f} ms"
        changes.append(("clock", f"that of {name}: {offset_words(applied.time_offset_s)} ({drives})"))
    return Applied(applied, tuple(changes))


def as_begun(record: Calibration | None, drive: Drive) -> Drive:
    """Give a drive the camera and the clock that a result began with: those of its poses before the joint estimate.

    The clock is that of the drive where the result does not hold the one that it began with.

    Args:
        record: The result; None, or one that kept neither another camera nor another clock, leaves the drive as it is.
        drive: The drive, which may have another camera and another clock by now.
    """
    if record is None or not _is_of_same_pictures(record.input.camera, drive.camera):
        return drive
    changes: dict[str, object] = {}
    if record.camera is not None and record.camera.is_kept:
        shutter = {"readout_s": drive.camera.readout_s, "direction": drive.camera.direction}
        changes["camera"] = record.input.camera.model_copy(update=shutter)
    clock = record.clock
    if clock is not None and clock.is_kept and clock.given_s is not None:
        changes["time_offset_s"] = clock.given_s
    return drive.model_copy(update=changes)


def seen_as(observations: Observations, own: Drive, other: Drive) -> Observations:
    """Give observations of a drive as another camera of the same pictures sees them, by another clock.

    Args:
        observations: Points and pictures as the drive's camera and clock see them.
        own: The drive.
        other: The same drive with another camera and another offset of the clock.
    """
    if own.camera != other.camera:
        observations = replace(observations, camera=other.camera)
    later_s = other.time_offset_s - own.time_offset_s
    return delayed(observations, later_s) if later_s and twists_per_s(observations) else observations


def _is_of_same_pictures(a: Camera, b: Camera) -> bool:
    return (a.model, a.width, a.height) == (b.model, b.width, b.height)
