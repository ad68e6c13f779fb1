"""What a fleet of drives says of one rig: where the camera is, who disagrees, and whether something moved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli.assessment.limits import Check, Verdict, judge
from semcal_cli.config import Limits
from semcal_cli.fleet.members import Member
from semcal_cli.geometry.poses import Pose

Order: TypeAlias = Literal["stamp", "name"]


@dataclass(frozen=True)
class Offset:
    """How far a transform is from another, along and about the axes of the other's camera."""

    center_m: npt.NDArray[np.float64]
    """(3,) of the camera's place."""
    rotation_deg: npt.NDArray[np.float64]
    """(3,)"""
    half_widths: npt.NDArray[np.float64]
    """(6,) of the 95 % intervals, metres and degrees."""

    @property
    def words(self) -> str:
        """How far it is in all."""
        center_cm, rotation_deg = 100.0 * np.linalg.norm(self.center_m), np.linalg.norm(self.rotation_deg)
        return f"{center_cm:.2f} cm and {rotation_deg:.3f} deg"

    def judge(self, limits: Limits) -> tuple[Check, ...]:
        """Judge it along and about each axis, and in all."""
        return judge(self.center_m.tolist(), self.rotation_deg.tolist(), self.half_widths.tolist(), limits)


@dataclass(frozen=True)
class ComparedDrive:
    """A drive beside what holds at its time."""

    member: Member
    time: float
    part: int
    expected: npt.NDArray[np.float64]
    """(6,) what holds then relative to what holds at the last drive: the camera's place and rotation, metres and
    degrees."""
    offset: Offset
    disagrees: bool
    """By more than chance explains."""
    is_far: bool
    """Whether the offset itself, whatever its interval, is beyond a limit."""
    verdict: Verdict
    """`fail` if the offset is surely beyond a limit."""

    @property
    def is_suspect(self) -> bool:
        """Whether it may be beyond a limit, and nobody knows."""
        return self.is_far and self.verdict != "fail"


@dataclass(frozen=True)
class Part:
    """A stretch of time in which the rig stayed as it was, or the whole of a fleet that drifts."""

    first: str
    last: str
    num_drives: int
    T_camera_lidar: Pose
    """At its end."""
    half_widths: npt.NDArray[np.float64]
    """(6,) of the 95 % intervals of the camera's place and rotation, metres and degrees."""
    change: Offset | None
    """From the part before; None for the first."""
    change_in_all: Offset | None
    """From the first part, if that is not the one before."""


@dataclass(frozen=True)
class Fleet:
    """What the drives of a rig say together."""

    verdict: Verdict
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    """What a reader has to know that is no reason for the verdict."""
    checks: tuple[Check, ...]
    """Of what they agree on; single drives are judged beside."""
    T_camera_lidar: Pose
    """At the last drive."""
    covariance: npt.NDArray[np.float64]
    """(6, 6) of a twist on its left, (rho, phi)."""
    scatter: npt.NDArray[np.float64]
    """(6,) standard deviation of the camera's place and rotation beyond what drives say of themselves, metres and
    degrees."""
    order: Order
    """`stamp`: times are days since the first; `name`: they count drives, since stamps do not compare."""
    parts: tuple[Part, ...]
    drift: Offset | None
    """From the first drive to the last, if it explains them better than changes do."""
    drives: tuple[ComparedDrive, ...]
    """In the order of time."""
    left_out: tuple[Member, ...]
    limits: Limits
