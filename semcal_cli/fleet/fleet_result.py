"""The combined result of the drives of one rig: the camera's pose, the drives that disagree, and the changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.config import Limits
from semcal_cli.fleet.fleet_drives import FleetDrive
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, quaternion_xyzw
from semcal_cli.many.chronology import Order
from semcal_cli.pipeline.verdict import AxisVerdict, Verdict, judge
from semcal_cli.result.provenance import versions


@dataclass(frozen=True)
class Offset:
    """The offset of a transform from another one, along and about the axes of the other camera."""

    values: npt.NDArray[np.float64]
    """(6,) offset of the camera centre, metres, and of the rotation, degrees."""
    half_widths: npt.NDArray[np.float64]
    """(6,) half widths of the 95 % intervals, metres and degrees."""

    @property
    def distance_m(self) -> float:
        """Length of the offset of the camera centre, metres."""
        return float(np.linalg.norm(self.values[:3]))

    @property
    def angle_deg(self) -> float:
        """Angle of the offset of the rotation, degrees."""
        return float(np.linalg.norm(self.values[3:]))

    def judge(self, limits: Limits) -> tuple[AxisVerdict, ...]:
        """Judge the offset along and about each axis, and in total."""
        return judge(self.values[:3].tolist(), self.values[3:].tolist(), self.half_widths.tolist(), limits)

    def describe(self) -> dict[str, Any]:
        """Make the entries of the offset in the document of a fleet."""
        return _by_kind(self.values) | _by_kind(self.half_widths, "half_width_95_")


@dataclass(frozen=True)
class ComparedDrive:
    """A drive compared with the rig's pose at its time."""

    drive: FleetDrive
    time: float
    part: int
    expected: npt.NDArray[np.float64]
    """(6,) camera centre and rotation of the rig at the time of the drive, relative to the last drive; metres and
    degrees."""
    offset: Offset
    disagrees: bool
    """Whether the offset is larger than chance explains."""
    is_far: bool
    """Whether the offset itself is beyond a limit, whatever its interval."""
    verdict: Verdict
    """`fail` if the offset is beyond a limit with its whole interval."""

    @property
    def is_suspect(self) -> bool:
        """Whether the offset is beyond a limit, but not with its whole interval."""
        return self.is_far and self.verdict != "fail"

    def describe(self) -> dict[str, Any]:
        """Make the entry of the drive in the document of a fleet."""
        return {
            "drive": self.drive.name,
            "status": "disagrees" if self.disagrees else "agrees",
            "verdict": self.verdict,
            "stamp": self.drive.stamp,
            "time": self.time,
            "part": self.part,
            **self.offset.describe(),
        }


@dataclass(frozen=True)
class RigPart:
    """A period in which the rig did not change, or the whole of a fleet that drifts."""

    first: str
    last: str
    num_drives: int
    T_camera_lidar: Pose
    """T_camera_lidar (4, 4) at the end of the period."""
    half_widths: npt.NDArray[np.float64]
    """(6,) half widths of the 95 % intervals of the camera centre and rotation, metres and degrees."""
    change: Offset | None
    """Offset from the part before; None for the first part."""
    overall_change: Offset | None
    """Offset from the first part, unless that is the part before."""

    def describe(self) -> dict[str, Any]:
        """Make the entry of the period in the document of a fleet."""
        return {
            "first": self.first,
            "last": self.last,
            "num_drives": self.num_drives,
            "T_camera_lidar": self.T_camera_lidar.tolist(),
            **_by_kind(self.half_widths, "half_width_95_"),
            "change": None if self.change is None else self.change.describe(),
            "change_from_first": None if self.overall_change is None else self.overall_change.describe(),
        }


@dataclass(frozen=True)
class Fleet:
    """The combined result of the drives of a rig."""

    verdict: Verdict
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    """Notes for the reader that do not affect the verdict."""
    checks: tuple[AxisVerdict, ...]
    """Checks of the combined pose; single drives have their own verdicts."""
    T_camera_lidar: Pose
    """T_camera_lidar (4, 4) at the last drive."""
    covariance: npt.NDArray[np.float64]
    """(6, 6) covariance of a twist on the left of the pose, (rho, phi)."""
    scatter: npt.NDArray[np.float64]
    """(6,) standard deviation of the camera centre and rotation beyond the stated errors of the drives, metres and
    degrees."""
    order: Order
    """`stamp`: times are days since the first drive; `name`: times count drives, since stamps cannot be compared."""
    parts: tuple[RigPart, ...]
    drift: Offset | None
    """Offset from the first drive to the last, if a drift explains the drives better than changes do."""
    drives: tuple[ComparedDrive, ...]
    """Drives in chronological order."""
    left_out: tuple[FleetDrive, ...]
    limits: Limits


def describe_fleet(fleet: Fleet, hashes: Mapping[str, str], reference: str | None = None) -> dict[str, Any]:
    """Make the document of a fleet, which is written as YAML or JSON.

    Args:
        fleet: Combined result of the drives.
        hashes: SHA-256 of each file that was read, by name.
        reference: SHA-256 of the file of the transform that the rig should have.
    """
    T, limits = fleet.T_camera_lidar, fleet.limits
    return {
        "semcal_fleet": 1,
        "status": fleet.verdict,
        "reasons": list(fleet.reasons),
        "notes": list(fleet.notes),
        "T_camera_lidar": T.tolist(),
        "T_lidar_camera": inverse(T).tolist(),
        "translation_m": T[:3, 3].tolist(),
        "quaternion_xyzw": quaternion_xyzw(T).tolist(),
        "uncertainty": {
            "covariance": fleet.covariance.tolist(),
            **_by_kind(fleet.parts[-1].half_widths, "half_width_95_"),
        },
        "scatter": _by_kind(fleet.scatter),
        "checks": [asdict(check) for check in fleet.checks],
        "parts": [part.describe() for part in fleet.parts],
        "drift": None if fleet.drift is None else fleet.drift.describe(),
        "order": fleet.order,
        "drives": [
            *(compared.describe() for compared in fleet.drives),
            *(
                {"drive": drive.name, "status": "left_out", "reason": drive.left_out}
                for drive in fleet.left_out
            ),
        ],
        "limits": {"rotation_deg": limits.rotation_deg, "translation_m": limits.translation_m},
        "input": {"reference": reference, "sha256": dict(hashes)},
        "versions": {name: versions()[name] for name in ("semcal", "numpy")},
    }


def _by_kind(values: npt.NDArray[np.float64], prefix: str = "") -> dict[str, Any]:
    """Name figures (6,) of the camera centre and of the rotation."""
    return {
        f"{prefix}camera_center_m": values[:3].tolist(),
        f"{prefix}rotation_deg": values[3:].tolist(),
    }
