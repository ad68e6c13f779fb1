"""A drive with the camera and the clock that a result estimated together with its transform.

Earlier poses of the result belong to the camera and the clock that the calibration started with.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from semcal_cli.config import AUTO, CueName
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive
from semcal_cli.observations.cues.cue_table import cues_of_options, cues_with_files, policy_of
from semcal_cli.observations.motion import delayed, twists_per_s
from semcal_cli.observations.observations import Observations
from semcal_cli.result.calibration_document import CalibrationDocument, with_estimates
from semcal_cli.result.refined_camera import camera_differences, offset_words


class Applied(NamedTuple):
    """A drive with the camera and the clock of a result, and where these differ from the drive's own."""

    drive: Drive
    changes: tuple[tuple[str, str], ...] = ()
    """Label and line of each difference: `camera` or `clock`, and which one is used."""

    @property
    def sentences(self) -> list[str]:
        """The differences as sentences."""
        return [f"The {label} is {line}." for label, line in self.changes]


def apply_result(record: CalibrationDocument | None, drive: Drive, name: str) -> Applied:
    """Return a drive with the camera and the clock that a result estimated together with its transform.

    An estimated camera with another lens or image size belongs to other images; the drive then keeps its own camera and
    clock. It also keeps both if the result estimated none, or did not keep them.

    Args:
        record: The result; None, or one without a camera and a clock, leaves the drive unchanged.
        drive: The drive.
        name: Name of the result's file.
    """
    if record is None:
        return Applied(drive)
    applied = record.applied_to(drive) if _fits(record, drive) else drive
    changes = {"camera": _camera_line(record, drive, name), "clock": _clock_line(record, drive, name)}
    return Applied(applied, tuple((label, line) for label, line in changes.items() if line is not None))


def cues_applied(
    record: CalibrationDocument | None,
    cues: tuple[CueName, ...],
    drive: Drive,
    *,
    with_features: bool = False,
) -> tuple[CueName, ...]:
    """Replace the cues `auto` by those that a result compared, if the drive has their files.

    Args:
        record: The result; None leaves the cues unchanged.
        cues: The requested cues.
        drive: The drive.
        with_features: Whether to include features, which have no classes.
    """
    if record is None or cues != AUTO:
        return cues
    before = cues_of_options(record.settings.options)
    has_vectors = any(cue.has_vectors for cue in policy_of(before).cues.values())
    return AUTO if has_vectors and not with_features else cues_with_files(before, drive)


def _camera_line(record: CalibrationDocument, drive: Drive, name: str) -> str | None:
    """Describe which camera is used if the result and the drive have different ones."""
    used, own = record.used_camera, drive.camera
    if not _is_of_same_images(used, own):
        kind = f"{used.model} of {used.width} x {used.height} pixels"
        return f"that of {drive.path}: the camera of {name} is {kind}"
    if record.has_found_camera:
        differences, whose = camera_differences(record.applied_to(drive).camera, own, "drive"), name
    else:
        differences, whose = camera_differences(own, used, name), str(drive.path)
    return f"that of {whose}: {', '.join(differences)}" if differences else None


def _clock_line(record: CalibrationDocument, drive: Drive, name: str) -> str | None:
    """Describe which clock is used if that of the result is known and differs from the drive's."""
    used_s, own_s = record.used_offset_s, drive.time_offset_s
    if drive.motion is None or used_s is None or used_s == own_s:
        return None
    if record.has_found_clock and _fits(record, drive):
        return f"that of {name}: {offset_words(used_s)} (drive: {_in_ms(own_s)})"
    return f"that of {drive.path}: {offset_words(own_s)} ({name}: {_in_ms(used_s)})"


def as_begun(record: CalibrationDocument | None, drive: Drive) -> Drive:
    """Return a drive with the camera and the clock of a result before the joint estimate.

    The clock is that of the drive if the result does not state the one that it started with.

    Args:
        record: The result; None, or one that kept neither another camera nor another clock, leaves the drive unchanged.
        drive: The drive, which may have another camera and another clock by now.
    """
    if record is None or not _fits(record, drive):
        return drive
    # The estimated camera, which fits, is of the same images as that of the input.
    camera = record.input.camera if record.has_found_camera else None
    offset_s = record.clock.given_s if record.clock and record.clock.is_kept else None
    return with_estimates(drive, camera, offset_s)


def seen_as(observations: Observations, own: Drive, other: Drive) -> Observations:
    """Convert observations to another camera of the same images and another clock.

    Args:
        observations: Points and images as the drive's camera and clock see them.
        own: The drive.
        other: The same drive with another camera and another time offset.
    """
    if own.camera != other.camera:
        observations = replace(observations, camera=other.camera)
    later_s = other.time_offset_s - own.time_offset_s
    return delayed(observations, later_s) if later_s and twists_per_s(observations) else observations


def _fits(record: CalibrationDocument, drive: Drive) -> bool:
    """Whether the camera that a result estimated, if it kept one, belongs to the drive's images."""
    return not record.has_found_camera or _is_of_same_images(record.used_camera, drive.camera)


def _in_ms(time_offset_s: float) -> str:
    return f"{1000.0 * time_offset_s:.1f} ms"


def _is_of_same_images(a: Camera, b: Camera) -> bool:
    return (a.model, a.width, a.height) == (b.model, b.width, b.height)
