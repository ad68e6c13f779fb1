"""The camera and the clock that were estimated together with a pose, with their intervals, and in words."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from semcal_cli.drive.camera import K_ENTRIES, Camera, intrinsic_names, intrinsic_value, without_last_zeros
from semcal_cli.errors import describe, listed, mismatch
from semcal_cli.files.validation import Figure, StrictModel, Width, length
from semcal_cli.readable import figure
from semcal_cli.result.uncertainty import Variance, check_covariance

OF_DRIVE = "the transform belongs to the camera of the drive"

Offset = Annotated[float, Field(ge=-2.0, le=2.0)]
"""Time offset, seconds: twice the range that a drive may state."""
JointRows: TypeAlias = tuple[tuple[float, ...], ...]


def _check_joint(rows: JointRows) -> JointRows:
    counts = {len(row) for row in rows}
    if counts != {len(rows)}:
        found = f"{len(rows)} rows with {min(counts)} to {max(counts)} entries"
        raise mismatch(found, "as many entries as rows")
    return check_covariance(rows)


def _check_line(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise mismatch(describe(text), "one line of text")
    return text


def _check_interval(*, is_determined: bool, **ends: float | None) -> None:
    """Check that an estimate has an interval if and only if it is determined."""
    if {end is not None for end in ends.values()} != {is_determined}:
        is_so = "determined" if is_determined else "not determined"
        figures = " and ".join(f"{name} {end}" for name, end in ends.items())
        raise mismatch(f"one that is {is_so} with {figures}", "both if it is determined, and none if not")


class Intrinsic(StrictModel):
    """An intrinsic that was estimated together with the pose."""

    given: Figure
    """Value of the drive's camera."""
    found: Figure
    """Estimate; the given value if the data do not determine it."""
    sigma: Width | None
    """Standard error of the estimate; null if the data do not determine it."""
    half_width_95: Width | None
    """Half width of its 95 % interval, by Student's t; null if the data do not determine it."""
    is_determined: bool
    """Whether the data determine it better than it was known before."""

    @model_validator(mode="after")
    def _check_determined(self) -> Intrinsic:
        _check_interval(is_determined=self.is_determined, sigma=self.sigma, half_width_95=self.half_width_95)
        return self


class CheckedIntrinsics(StrictModel):
    """What the frames say of the intrinsics of the drive, which the transform belongs to."""

    intrinsics: Annotated[dict[str, Intrinsic], Field(min_length=1)]
    """Estimates by name: fx, fy, cx, cy in pixels, and k1 where the lens has it."""
    is_confirmed: bool
    """Whether the frames would show every error of these intrinsics that turns the camera by more than 1.5 degrees or
    moves it by more than 0.3 m. If not, the interval of the transform holds only if K is right."""


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
            tuple[Annotated[tuple[Variance, ...], length(7, 32)], ...],
            length(7, 32),
            AfterValidator(_check_joint),
        ]
        | None
    )
    """Covariance of the twist xi of the pose, in metres and radians, then of the intrinsics in order, then of the time
    offset in seconds, if it was estimated and is determined; null if it could not be computed. It holds at the pose of
    the estimate, which is the transform only if the estimate is kept."""

    @model_validator(mode="after")
    def _check_names(self) -> RefinedCamera:
        names = intrinsic_names(self.found.model)
        if unknown := [name for name in self.intrinsics if name not in names]:
            raise mismatch(
                f"intrinsics {listed(unknown)}", f"names of {self.found.model}: {', '.join(names)}"
            )
        for name, estimate in self.intrinsics.items():
            value = intrinsic_value(self.found, name)
            if not math.isclose(value, estimate.found, rel_tol=1e-9, abs_tol=1e-9):
                raise mismatch(
                    f"{name} {value} of the camera and {estimate.found} of its estimate", "one value"
                )
        return self


class Clock(StrictModel):
    """Time offset of the camera that was estimated together with the pose."""

    time_offset_s: Offset
    """Time by which images are later than image_stamp says, in seconds; negative if they are earlier. It
    replaces the offset of the drive, which it includes."""
    given_s: Offset | None = None
    """Offset of the drive when the calibration started, in seconds. Absent in older files."""
    sigma_s: Width | None
    """Standard error of the estimate; null if it is not determined."""
    half_width_95_s: Width | None
    """Half width of the 95 % interval, by Student's t; null if it is not determined."""
    is_determined: bool
    """Whether the motion of the drive determines the offset."""
    is_kept: bool
    """Whether the transform belongs to images that are later by the offset. If not, it belongs to those of the
    drive."""
    meaning: Annotated[str, AfterValidator(_check_line)]
    """The offset in words, without its interval."""
    joint_covariance: (
        Annotated[
            tuple[Annotated[tuple[Variance, ...], length(7, 7)], ...],
            length(7, 7),
            AfterValidator(check_covariance),
        ]
        | None
    ) = None
    """Covariance of the twist xi of the pose, in metres and radians, then of the offset in seconds, marginalised over
    the intrinsics if these were estimated, too; null if the offset is not determined. It holds at the pose of the
    estimate, which is the transform only if the estimate is kept. Absent in older files."""

    @model_validator(mode="after")
    def _check_determined(self) -> Clock:
        _check_interval(
            is_determined=self.is_determined, sigma_s=self.sigma_s, half_width_95_s=self.half_width_95_s
        )
        if self.is_determined:
            return self
        if self.is_kept:
            raise mismatch("a clock that is kept and not determined", "one that is determined")
        if self.joint_covariance is not None:
            raise mismatch("a joint_covariance of a clock that is not determined", "null")
        return self


class IntrinsicText(NamedTuple):
    """An intrinsic as text, to two significant digits of its interval."""

    name: str
    given: str
    found: str
    half_width: str
    """Half width of the 95 % interval; empty if the data do not determine the intrinsic, or it is not trusted."""
    unit: str
    """` px` for those in K, empty for the others."""
    is_determined: bool

    @property
    def line(self) -> str:
        """The intrinsic with its interval, and the value that the drive has."""
        if self.is_determined:
            half = f" +- {self.half_width}" if self.half_width else ""
            return f"{self.name} {self.found}{half}{self.unit} (drive: {self.given})"
        return f"{self.name} not determined: kept at {self.given}{self.unit}"


def intrinsic_texts(camera: RefinedCamera, *, is_trusted: bool) -> list[IntrinsicText]:
    """Write each intrinsic that was estimated, with its interval if the calibration is trusted."""
    texts = []
    for name, estimate in camera.intrinsics.items():
        if estimate.half_width_95 is None:
            before, after, half = f"{estimate.given:.6g}", f"{estimate.found:.6g}", ""
        else:
            half = figure(estimate.half_width_95)
            digits = len(half.partition(".")[2])
            # Adding zero avoids -0.0000.
            before, after = (
                f"{round(value, digits) + 0.0:.{digits}f}" for value in (estimate.given, estimate.found)
            )
        unit = " px" if name in K_ENTRIES else ""
        texts.append(
            IntrinsicText(name, before, after, half if is_trusted else "", unit, estimate.is_determined)
        )
    return texts


def kept_sentence(camera: RefinedCamera) -> str:
    """Describe whether the transform belongs to the estimated intrinsics, and what held-out data gain by them."""
    sigma = camera.held_out_sigma_nats
    gain = f"{camera.held_out_gain_nats:.4f}{'' if sigma is None else f' +- {sigma:.4f}'} nats"
    if camera.is_kept:
        return f"kept: held-out data gain {gain}"
    if not any(estimate.is_determined for estimate in camera.intrinsics.values()):
        return f"not kept: the data determine none of them; {OF_DRIVE}"
    return f"not kept: held-out data gain {gain}; {OF_DRIVE}"


def clock_sentence(clock: Clock, *, is_trusted: bool) -> str:
    """Describe how far the clock of the images is off, with the 95 % interval if the calibration is trusted."""
    if not clock.is_determined or clock.half_width_95_s is None:
        return clock.meaning
    not_kept = "" if clock.is_kept else "; not kept: the transform belongs to the stamps of the drive"
    half = f", +- {figure(1000.0 * clock.half_width_95_s)} ms" if is_trusted else ""
    return f"{clock.meaning}{half}{not_kept}"


def offset_words(time_offset_s: float) -> str:
    """Describe by how much images are later or earlier than their stamps."""
    if time_offset_s == 0.0:
        return "image stamps are right"
    side = "later" if time_offset_s > 0.0 else "earlier"
    return f"images are {1000.0 * abs(time_offset_s):.1f} ms {side} than their stamps say"


def camera_differences(camera: Camera, other: Camera, whose: str) -> list[str]:
    """List the differences between two cameras, except for how well they are known and their masks.

    Args:
        camera: The camera.
        other: The other camera.
        whose: Name of the other camera, to put before its values.
    """
    values = {name: (intrinsic_value(camera, name), intrinsic_value(other, name)) for name in K_ENTRIES}
    differences = [f"{name} {a:.6g} ({whose}: {b:.6g})" for name, (a, b) in values.items() if a != b]
    names = [name for name in Camera.model_fields if name not in ("K", "intrinsics_sigma", "mask")]
    a, b = map(without_last_zeros, (camera, other))
    return differences + [f"another {name}" for name in names if getattr(a, name) != getattr(b, name)]
