"""A run of the experiment on trust, and its outcome."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semcal_cli.geometry.poses import Pose, compare_poses
from semcal_cli.result.calibration import Calibration

CONFIDENT_SIGMAS = 4.0
CONFIDENT_DEG, CONFIDENT_CM = 0.2, 5.0
"""Limits of a confidently wrong calibration: its error is beyond all of these."""
WRONG_DEG, WRONG_CM = 0.3, 6.0
"""Limits of a wrong calibration of a spoiled drive: its error is beyond one of these."""


@dataclass(frozen=True)
class Case:
    """One run on the drive of one seed."""

    kind: str
    """Kind of the run: `good`, `mine`, a key of `trust.BAD` or of `spoiled.KINDS`, or `verify`."""
    seed: int
    """Seed of the drive."""
    num_pairs: int
    """Number of frames that are used."""
    noise: float
    """Share of wrong labels on both sides."""
    draw: int = 0
    """Number of the random draw on this drive."""


@dataclass(frozen=True)
class Outcome:
    """The statement of a calibration or a verification, and its true errors."""

    kind: str
    """Kind of the case; for a verification one of `trust.OFFSETS`."""
    seed: int
    """Seed of the drive."""
    rig: str
    """Name of the rig."""
    num_pairs: int
    """Number of frames that were used."""
    noise: float
    """Share of wrong labels on both sides."""
    status: str
    """Status of the calibration, `failed`, or the verdict of `verify`."""
    reasons: str
    """Sentences that speak against the transform."""
    errors: tuple[float, ...] = ()
    """Errors of the camera centre in centimetres and of the rotation in degrees, along the camera's axes; from the
    nearest of several true poses."""
    sigmas: tuple[float, ...] = ()
    """Stated standard errors of `errors`."""
    half_widths: tuple[float, ...] = ()
    """Half widths of the stated intervals of `errors`."""
    notes: str = ""
    """Sentences that do not speak against the transform."""
    has_frame: bool | None = None
    """Whether the result names the frame at which the camera was knocked, within one; None for other kinds."""
    num_axes_inside: int | None = None
    """Number of the axes of the knock that lie inside the stated intervals; None without a stated knock."""
    is_told: bool | None = None
    """Whether the result says what is wrong with a spoiled drive, as `spoiled.KINDS` asks; None if nothing is asked."""
    detail: str = ""
    """Figures behind `is_told`."""

    @property
    def is_confidently_wrong(self) -> bool:
        """Whether a trusted pose is off by more than four standard errors, 0.2 degrees and 5 cm."""
        if not self.is_trusted:
            return False
        pairs = zip(self.errors, self.sigmas, (CONFIDENT_CM,) * 3 + (CONFIDENT_DEG,) * 3, strict=True)
        return any(abs(error) > max(CONFIDENT_SIGMAS * sigma, least) for error, sigma, least in pairs)

    @property
    def is_trusted(self) -> bool:
        """Whether the calibration trusts its pose."""
        return self.status == "trusted"

    @property
    def axes_inside(self) -> list[bool]:
        """Whether the error along each axis lies within the stated interval; empty without intervals."""
        pairs = zip(self.errors, self.half_widths, strict=True) if self.half_widths else ()
        return [abs(error) <= half for error, half in pairs]

    @property
    def is_inside(self) -> bool:
        """Whether the errors along all axes lie within the stated intervals."""
        return len(self.half_widths) > 0 and all(self.axes_inside)

    @property
    def center_cm(self) -> float:
        """Distance of the camera centre from the truth."""
        return float(np.linalg.norm(self.errors[:3]))

    @property
    def rotation_deg(self) -> float:
        """Angle of the rotation from the truth."""
        return float(np.linalg.norm(self.errors[3:]))

    @property
    def is_wrong(self) -> bool:
        """Whether the pose is farther than 0.3 degrees or 6 cm from the truth."""
        return distance_in_limits(self.errors) > 1.0


def errors_of(T_camera_lidar: Pose, truth: Pose) -> tuple[float, ...]:
    """Errors (6,) of a pose, as in `Outcome.errors`: centimetres and degrees, along the camera's axes."""
    error = compare_poses(T_camera_lidar, truth)
    return *error.camera_center_xyz_cm, *error.rotation_xyz_deg


def distance_in_limits(errors: Sequence[float]) -> float:
    """Size of errors, as in `Outcome.errors`, in units of `WRONG_CM` and `WRONG_DEG`, whichever is larger."""
    if not errors:
        return 0.0
    return float(max(np.linalg.norm(errors[:3]) / WRONG_CM, np.linalg.norm(errors[3:]) / WRONG_DEG))


def with_statement(outcome: Outcome, calibration: Calibration, errors: tuple[float, ...]) -> Outcome:
    """Add what a calibration states, and its errors (6,), centimetres and degrees."""
    outcome = replace(
        outcome,
        status=calibration.status,
        reasons="; ".join(calibration.reasons),
        notes="; ".join(calibration.notes),
        errors=errors,
    )
    if (uncertainty := calibration.uncertainty) is None:
        return outcome
    return replace(
        outcome,
        sigmas=(*(100.0 * x for x in uncertainty.sigma_camera_center_m), *uncertainty.sigma_rotation_deg),
        half_widths=(
            *(100.0 * x for x in uncertainty.half_width_95_camera_center_m),
            *uncertainty.half_width_95_rotation_deg,
        ),
    )
