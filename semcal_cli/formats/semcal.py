"""semcal's own files: p_camera = T_camera_lidar * p_lidar, as stored.

A calibration, a drive with its reference, what `fleet` writes, or a bare transform, as `convert` writes it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import model_validator

from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import MAX_OFFSET_S, Drive
from semcal_cli.errors import InputError, MisplacedError
from semcal_cli.files.validation import (
    StatedTransform,
    StrictModel,
    Transform,
    Vector3,
    Vector4,
    Version,
    Widths,
    check_not_newer,
    validate,
)
from semcal_cli.formats.format import Format, FormatOptions, Source, document_writer
from semcal_cli.formats.lenses import check_same_camera, tell, tell_clock, with_count
from semcal_cli.geometry.poses import Pose, orthonormal
from semcal_cli.result.calibration import Calibration, check_forms
from semcal_cli.result.uncertainty import Uncertainty

CALIBRATION, DRIVE, TRANSFORM = "semcal_calibration", "semcal_drive", "semcal_transform"
FLEET = "semcal_fleet"


class _Transform(StrictModel):
    semcal_transform: Version = 1
    T_camera_lidar: Transform


class _Widths(StrictModel):
    half_width_95_camera_center_m: Widths
    half_width_95_rotation_deg: Widths


class _Fleet(StrictModel):
    """The part of a fleet's result that is used; the other keys are for readers."""

    semcal_fleet: Version
    T_camera_lidar: StatedTransform
    T_lidar_camera: StatedTransform
    translation_m: Vector3
    quaternion_xyzw: Vector4
    uncertainty: _Widths

    @model_validator(mode="after")
    def _check_agreement(self) -> _Fleet:
        check_forms(
            np.array(self.T_camera_lidar), self.T_lidar_camera, self.translation_m, self.quaternion_xyzw
        )
        return self

    @classmethod
    def read(cls, source: Source) -> _Fleet:
        """Read the used part of a fleet's result."""
        kept = {name: source.mapping[name] for name in cls.model_fields if name in source.mapping}
        widths = kept.get("uncertainty")
        if isinstance(widths, dict):
            kept["uncertainty"] = {name: widths[name] for name in _Widths.model_fields if name in widths}
        return validate(cls, kept, source.path)


def record_in(source: Source) -> Calibration | None:
    """The calibration in a file; None if the file is not a calibration of semcal's.

    Raises:
        InputError: the file is a calibration, and wrong.
    """
    if CALIBRATION not in source.mapping:
        return None
    return validate(Calibration, source.document, source.path)


def camera_in(source: Source) -> Camera | None:
    """The camera that the transform in a file belongs to: a calibration's, or a drive's; None if there is none.

    Raises:
        InputError: the file is a calibration or a drive, and wrong.
    """
    if (record := record_in(source)) is not None:
        return record.used_camera
    return validate(Drive, source.document, source.path).camera if DRIVE in source.mapping else None


def half_widths_in(source: Source) -> tuple[float, ...] | None:
    """The half widths (6,) of a transform's 95 % intervals, metres and degrees; None if none is known or believed.

    Raises:
        InputError: the file is a result of semcal's, and wrong.
    """
    known: Uncertainty | _Widths | None = None
    if FLEET in source.mapping:
        known = _Fleet.read(source).uncertainty
    elif (record := record_in(source)) is not None:
        known = record.believed_uncertainty
    if known is None:
        return None
    return (*known.half_width_95_camera_center_m, *known.half_width_95_rotation_deg)


def _read(source: Source, options: FormatOptions) -> Pose:
    if CALIBRATION in source.mapping:
        return validate(Calibration, source.document, source.path).pose
    if DRIVE in source.mapping:
        drive = validate(Drive, source.document, source.path)
        if drive.T_camera_lidar is None:
            needed = "needed a transform, or a drive with T_camera_lidar"
            raise MisplacedError(f"{source.path}: found a drive without a reference, {needed}")
        return np.array(drive.T_camera_lidar)
    if FLEET in source.mapping:
        return orthonormal(np.array(_Fleet.read(source).T_camera_lidar))
    return np.array(validate(_Transform, source.document, source.path).T_camera_lidar)


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    if CALIBRATION in document or FLEET in document:
        raise InputError(
            "--into: found a result, which says how sure its own transform is, needed another file"
        )
    try:
        check_not_newer(document, (DRIVE, TRANSFORM))
    except ValueError as error:
        raise InputError(f"{options.file}: {error}") from None
    if DRIVE not in document:
        document.setdefault(TRANSFORM, 1)
        document["T_camera_lidar"] = T_camera_lidar.tolist()
        tell_clock(options, is_set=False)
    else:
        _put_into_drive(document, T_camera_lidar.tolist(), options)


def _put_into_drive(document: dict[str, Any], rows: list[list[float]], options: FormatOptions) -> None:
    """Replace the transform, the intrinsics and the clock of a drive, which must be one before and after."""
    assert options.file is not None
    validate(Drive, {**document, "T_camera_lidar": rows}, options.file)
    if options.intrinsics is not None:
        _set_camera(document["camera"], options.intrinsics, options)
    if options.time_offset_s is not None:
        _set_clock(document, options.time_offset_s, options)
    document["T_camera_lidar"] = rows
    validate(Drive, document, options.file)
    if options.intrinsics is not None:
        tell(options, options.intrinsics)
    tell_clock(options, is_set=True)


def _set_camera(block: dict[str, Any], camera: Camera, options: FormatOptions) -> None:
    """Replace the intrinsics in the camera of a drive."""
    model = ("camera.model", block["model"], camera.model)
    check_same_camera(options, camera, [block["width"], block["height"]], model)
    camera = with_count(camera, len(block.get("distortion", ())))
    block["K"] = [list(row) for row in camera.K]
    if "distortion" in block or any(camera.distortion):
        block["distortion"] = list(camera.distortion)
    if camera.parameters:
        block["parameters"] = dict(camera.parameters)


def _set_clock(document: dict[str, Any], time_offset_s: float, options: FormatOptions) -> None:
    """Replace the offset of the camera's clock in a drive, which holds those of some size only."""
    if abs(time_offset_s) > MAX_OFFSET_S:
        raise InputError(
            f"{options.file}: time_offset_s: found {time_offset_s:g} to be set, needed {-MAX_OFFSET_S:g} to "
            f"{MAX_OFFSET_S:g}: correct image_stamp by it instead"
        )
    document["time_offset_s"] = time_offset_s


def _is_bare(source: Source) -> bool:
    """Whether a file holds nothing but the matrix under its name, which says which way round it is."""
    return source.mapping.keys() == {"T_camera_lidar"}


FORMAT = Format(
    "semcal",
    "p_camera = T p_lidar: T_camera_lidar of a calibration, a drive, a fleet or a bare transform",
    lambda source: bool({CALIBRATION, DRIVE, FLEET, TRANSFORM} & source.mapping.keys()) or _is_bare(source),
    _read,
    document_writer(_put),
    _put,
)
