"""The result of combining the drives of one rig: the camera's pose, the drives that disagree, and the changes."""

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
    """The offset of a transform from another one, along and about the axes of the other one's camera."""

    center_m: npt.NDArray[np.float64]
    """(3,) offset of the camera's centre, metres."""
    rotation_deg: npt.NDArray[np.float64]
    """(3,) offset of the rotation, degrees."""
    half_widths: npt.NDArray[np.float64]
    """(6,) half widths of the 95 % intervals, metres and degrees."""

    def judge(self, limits: Limits) -> tuple[Check, ...]:
        """Judge the offset along and about each axis, and in all."""
        return judge(self.center_m.tolist(), self.rotation_deg.tolist(), self.half_widths.tolist(), limits)


@dataclass(frozen=True)
class ComparedDrive:
    """A drive compared with the rig's pose at its time."""

    member: Member
    time: float
    part: int
    expected: npt.NDArray[np.float64]
    """(6,) camera's place and rotation at the time of the drive, relative to those at the last drive; metres and
    degrees."""
    offset: Offset
    disagrees: bool
    """Whether the offset is larger than chance explains."""
    is_far: bool
    """Whether the offset itself, whatever its interval, is beyond a limit."""
    verdict: Verdict
    """`fail` if the offset is surely beyond a limit."""

    @property
    def is_suspect(self) -> bool:
        """Whether the offset is beyond a limit, but not surely."""
        return self.is_far and self.verdict != "fail"


@dataclass(frozen=True)
class Part:
    """A stretch of time in which the rig stayed as it was, or the whole of a fleet that drifts."""

    first: str
    last: str
    num_drives: int
    T_camera_lidar: Pose
    """T_camera_lidar (4, 4) at the end of the stretch."""
    half_widths: npt.NDArray[np.float64]
    """(6,) half widths of the 95 % intervals of the camera's place and rotation, metres and degrees."""
    change: Offset | None
    """Offset from the part before; None for the first part."""
    change_in_all: Offset | None
    """Offset from the first part, unless that is the part before."""


@dataclass(frozen=True)
class Fleet:
    """The combined result of the drives of a rig."""

    verdict: Verdict
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    """Notes for the reader that do not affect the verdict."""
    checks: tuple[Check, ...]
    """Checks of the combined pose; single drives have their own verdicts."""
    T_camera_lidar: Pose
    """T_camera_lidar (4, 4) at the last drive."""
    covariance: npt.NDArray[np.float64]
    """(6, 6) covariance of a twist on the left of the pose, (rho, phi)."""
    scatter: npt.NDArray[np.float64]
    """(6,) standard deviation of the camera's place and rotation beyond the stated errors of the drives, metres and
    degrees."""
    order: Order
    """`stamp`: times are days since the first drive; `name`: times count drives, since stamps do not compare."""
    parts: tuple[Part, ...]
    drift: Offset | None
    """Offset from the first drive to the last, if a drift explains the drives better than changes do."""
    drives: tuple[ComparedDrive, ...]
    """Drives in the order of time."""
    left_out: tuple[Member, ...]
    limits: Limits
