"""A transform that is known beforehand, as an initial guess or for verification."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import check_baseline
from semcal_cli.result.calibration_document import CalibrationDocument


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

    def check_distance(self, max_baseline_m: float) -> None:
        """Check that the camera is at most `max_baseline_m` from the LiDAR.

        Raises:
            InputError: the camera is farther away.
        """
        check_baseline(self.name, self.T_camera_lidar, max_baseline_m)
