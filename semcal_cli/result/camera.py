"""The camera and the clock that were estimated together with a pose, with their intervals."""

from __future__ import annotations

import math
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from semcal_cli.drive.camera import Camera, intrinsic_names, intrinsic_value
from semcal_cli.errors import describe, listed, mismatch
from semcal_cli.files.validation import Figure, StrictModel, Width, length
from semcal_cli.result.uncertainty import check_covariance

JointEntry = Annotated[float, Field(ge=-1e40, le=1e40)]
Offset = Annotated[float, Field(ge=-2.0, le=2.0)]
"""Offset of two clocks, in seconds: of what a drive may say, with as much again."""


JointRows: TypeAlias = tuple[tuple[float, ...], ...]


def _check_joint(rows: JointRows) -> JointRows:
    counts = {len(row) for row in rows}
    if counts != {len(rows)}:
        found = f"{len(rows)} rows with {min(counts)} to {max(counts)} entries"
        raise mismatch(found, "as many as rows")
    return check_covariance(rows)


def _check_line(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise mismatch(describe(text), "one line of text")
    return text


def _check_interval(*, is_determined: bool, **ends: float | None) -> None:
    """Check that an estimate has an interval exactly if it is determined."""
    if {end is not None for end in ends.values()} != {is_determined}:
        is_so = "determined" if is_determined else "not determined"
        figures = " and ".join(f"{name} {end}" for name, end in ends.items())
        raise mismatch(f"one that is {is_so} with {figures}", "both if it is determined, and none if not")


class Intrinsic(StrictModel):
    """An intrinsic that was estimated together with the pose."""

    given: Figure
    """Value of the drive's camera."""
    found: Figure
    """Estimate; that of the drive's camera where the data do not determine it."""
    sigma: Width | None
    """Standard error of the estimate; null where the data do not determine it."""
    half_width_95: Width | None
    """Half width of its 95 % interval, by Student's t; null where the data do not determine it."""
    is_determined: bool
    """Whether the data tell it more closely than what was known before."""

    @model_validator(mode="after")
    def _check_determined(self) -> Intrinsic:
        _check_interval(is_determined=self.is_determined, sigma=self.sigma, half_width_95=self.half_width_95)
        return self


class RefinedCamera(StrictModel):
    """Camera whose intrinsics were estimated together with the pose."""

    is_kept: bool
    """Whether the transform belongs to the found camera. If not, it belongs to that of the drive."""
    held_out_gain_nats: Figure
    """Mutual information of held-out data with the found camera and its pose minus that with the drive's camera."""
    held_out_sigma_nats: Width | None
    """Standard error of the gain; null if all points lie in one part of the images."""
    found: Camera
    """The camera with the estimates."""
    intrinsics: Annotated[dict[str, Intrinsic], Field(min_length=1)]
    """Estimates by name: fx, fy, cx, cy in pixels, and coefficients of the lens."""
    joint_covariance: (
        Annotated[
            tuple[Annotated[tuple[JointEntry, ...], length(7, 32)], ...],
            length(7, 32),
            AfterValidator(_check_joint),
        ]
        | None
    )
    """Covariance of the pose's twist xi, in metres and radians, of the intrinsics in their order, and last of the
    offset of the clock in seconds, if it was estimated and is determined; null if it could not be computed. It is about
    the pose of the estimate, which is the transform only if it is kept."""

    @model_validator(mode="after")
    def _check_names(self) -> RefinedCamera:
        known = intrinsic_names(self.found.model)
        if unknown := [name for name in self.intrinsics if name not in known]:
            raise mismatch(
                f"intrinsics {listed(unknown)}", f"names of {self.found.model}: {', '.join(known)}"
            )
        for name, each in self.intrinsics.items():
            if not math.isclose(
                value := intrinsic_value(self.found, name), each.found, rel_tol=1e-9, abs_tol=1e-9
            ):
                raise mismatch(f"{name} {value} of the camera and {each.found} of its estimate", "one value")
        return self


class Clock(StrictModel):
    """Offset of the camera's clock that was estimated together with the pose."""

    time_offset_s: Offset
    """Time by which pictures are later than image_stamp says, in seconds; negative if they are earlier. It takes the
    place of the drive's own offset, which it contains."""
    given_s: Offset | None = None
    """Offset that the drive had when the calibration began, in seconds. Absent in files that do not state it."""
    sigma_s: Width | None
    """Standard error of the estimate; null if it is not determined."""
    half_width_95_s: Width | None
    """Half width of the 95 % interval, by Student's t; null if it is not determined."""
    is_determined: bool
    """Whether the drive's motion tells the offset."""
    is_kept: bool
    """Whether the transform belongs to pictures that are later by the offset. If not, it belongs to those of the
    drive."""
    meaning: Annotated[str, AfterValidator(_check_line)]
    """The offset in words, without its interval."""
    joint_covariance: (
        Annotated[
            tuple[Annotated[tuple[JointEntry, ...], length(7, 7)], ...],
            length(7, 7),
            AfterValidator(check_covariance),
        ]
        | None
    ) = None
    """Covariance of the pose's twist xi, in metres and radians, and last of the offset in seconds, whatever the
    intrinsics are if these were estimated, too; null if the offset is not determined. It is about the pose of the
    estimate, which is the transform only if it is kept. Absent in files that do not state it."""

    @model_validator(mode="after")
    def _check_determined(self) -> Clock:
        _check_interval(
            is_determined=self.is_determined,
            sigma_s=self.sigma_s,
            half_width_95_s=self.half_width_95_s,
        )
        if self.is_determined:
            return self
        if self.is_kept:
            raise mismatch("a clock that is kept and not determined", "one that is determined")
        if self.joint_covariance is not None:
            raise mismatch("a joint_covariance of a clock that is not determined", "null")
        return self
