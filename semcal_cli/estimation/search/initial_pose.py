"""A transform that is known beforehand, as an initial guess or for verification."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import check_baseline
from semcal_cli.result.calibration_document import CalibrationDocument

MIN_UPRIGHT = math.cos(math.radians(45.0))
"""Smallest cosine of the angle between two z axes that are both called vertical: half-way to a horizontal one."""


@dataclass(frozen=True)
class InitialPose:
    """A transform that the user gives."""

    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres."""
    name: str
    """Name in messages."""
    source: Path | None = None
    """File of the transform; None if no file states it."""
    direction: str | None = None
    """Direction of the matrix in the file, if the user had to state it."""
    record: CalibrationDocument | None = None
    """The calibration that semcal wrote with the transform, if there is one."""

    @property
    def looks_along_z(self) -> bool:
        """Whether the camera looks up or down the LiDAR's z axis, as if its body frame were its optical one."""
        return abs(float(self.T_camera_lidar[2, 2])) >= MIN_UPRIGHT

    def check_distance(self, max_baseline_m: float) -> None:
        """Check that the camera is at most `max_baseline_m` from the LiDAR.

        Raises:
            InputError: the camera is farther away.
        """
        check_baseline(self.name, self.T_camera_lidar, max_baseline_m)
