"""A transform that is known beforehand, to start at or to verify."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from semcal_cli.geometry.baseline import check_baseline
from semcal_cli.geometry.poses import Pose


@dataclass(frozen=True)
class InitialPose:
    """A transform that the user knows something about."""

    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar."""
    name: str
    """What messages call it."""
    source: Path | None = None
    """The file it is from; None if it was typed."""

    def check_distance(self, max_baseline_m: float) -> None:
        """Check that the camera is as near to the LiDAR as it has to be.

        Raises:
            InputError: it is farther away.
        """
        check_baseline(self.name, self.T_camera_lidar, max_baseline_m)
