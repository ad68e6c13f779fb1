"""semcal's own files, which store p_camera = T_camera_lidar * p_lidar.

A calibration, a drive with a reference, a result of `fleet`, or a bare transform as `convert` writes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import model_validator

from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import MisplacedError
from semcal_cli.files.validation import (
    RigidTransform,
    StatedTransform,
    StrictModel,
    Vector3,
    Vector4,
    Version,
    Widths,
    validate,
)
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import orthonormal
from semcal_cli.result.calibration_document import CalibrationDocument, check_forms
from semcal_cli.result.uncertainty import Uncertainty

CALIBRATION, DRIVE, TRANSFORM = "semcal_calibration", "semcal_drive", "semcal_transform"
FLEET = "semcal_fleet"


class _Transform(StrictModel):
    semcal_transform: Version = 1
    T_camera_lidar: RigidTransform


class _Part(StrictModel):
    """The part of a fleet's result that is used here; the other keys are for people."""

    @model_validator(mode="before")
    @classmethod
    def _keep_known(cls, document: Any) -> Any:
        if not isinstance(document, dict):
            return document
        return {key: document[key] for key in cls.model_fields if key in document}


class _Widths(_Part):
    half_width_95_camera_center_m: Widths
    half_width_95_rotation_deg: Widths


class _Fleet(_Part):
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


@dataclass(frozen=True)
class Extrinsic:
    """The extrinsics of a file, and what semcal wrote with them. Properties raise an `InputError` if it is wrong."""

    T_camera_lidar: Pose
    """(4, 4) float64, p_camera = T_camera_lidar @ p_lidar, metres."""
    source: Source
    asks: tuple[str, ...]
    """What files of this format leave open, by the names of options: see `Format`."""

    @cached_property
    def record(self) -> CalibrationDocument | None:
        """The calibration that semcal wrote with the transform; None if the file is not a calibration."""
        if CALIBRATION not in self.source.mapping:
            return None
        return validate(CalibrationDocument, self.source.document, self.source.path)

    @property
    def warnings(self) -> list[str]:
        """A line that says that the transform is not trusted; none if nothing speaks against it."""
        if self.record is None or self.record.status != "not_trusted":
            return []
        return [f"{self.source.path}: the transform is not trusted; see its reasons"]

    @cached_property
    def half_widths(self) -> tuple[float, ...] | None:
        """Half widths (6,) of the 95 % intervals, metres and degrees; None if they are unknown or not believed."""
        uncertainty: Uncertainty | _Widths | None = None
        if FLEET in self.source.mapping:
            uncertainty = validate(_Fleet, self.source.document, self.source.path).uncertainty
        elif self.record is not None:
            uncertainty = self.record.believed_uncertainty
        if uncertainty is None:
            return None
        return (*uncertainty.half_width_95_camera_center_m, *uncertainty.half_width_95_rotation_deg)

    @cached_property
    def covariance(self) -> Matrix | None:
        """Covariance (6, 6) of a normal distribution: see `FormatOptions`; None if it is not known or not believed."""
        return None if self.record is None else self.record.believed_covariance

    @cached_property
    def camera(self) -> Camera | None:
        """The camera of the calibration or of the drive, to which the transform belongs; None if the file has none."""
        if self.record is not None:
            return self.record.used_camera
        return None if self._drive is None else self._drive.camera

    @cached_property
    def frame_ids(self) -> FrameIds | None:
        """Names of the frames of the recording that the transform belongs to; None if the file has none."""
        if self.record is not None:
            return self.record.input.frame_ids
        return None if self._drive is None else self._drive.frame_ids

    @cached_property
    def _drive(self) -> Drive | None:
        if DRIVE not in self.source.mapping:
            return None
        return validate(Drive, self.source.document, self.source.path)


def _read(source: Source, options: FormatOptions) -> Pose:
    if CALIBRATION in source.mapping:
        return validate(CalibrationDocument, source.document, source.path).pose
    if DRIVE in source.mapping:
        drive = validate(Drive, source.document, source.path)
        if drive.T_camera_lidar is None:
            needed = "expected a transform, or a drive with T_camera_lidar"
            raise MisplacedError(f"{source.path}: found a drive without a reference, {needed}")
        return np.array(drive.T_camera_lidar)
    if FLEET in source.mapping:
        return orthonormal(np.array(validate(_Fleet, source.document, source.path).T_camera_lidar))
    return np.array(validate(_Transform, source.document, source.path).T_camera_lidar)


def _make(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
    return {TRANSFORM: 1, "T_camera_lidar": T_camera_lidar.tolist()}


def _is_ours(source: Source) -> bool:
    """Return whether a file is semcal's, or holds only the matrix T_camera_lidar, whose name states its direction."""
    keys = source.mapping.keys()
    return bool({CALIBRATION, DRIVE, FLEET, TRANSFORM} & keys) or keys == {"T_camera_lidar"}


FORMAT = Format(
    "semcal",
    "p_camera = T p_lidar: T_camera_lidar of a calibration, a drive, a fleet or a bare transform",
    _is_ours,
    _read,
    _make,
)
