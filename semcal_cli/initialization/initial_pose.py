"""A transform that is known beforehand, to start at or to verify."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.errors import InputError
from semcal_cli.geometry.poses import Pose, camera_center


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
        distance_m = math.hypot(*camera_center(self.T_camera_lidar))
        if distance_m > max_baseline_m:
            raise InputError(
                f"{self.name}: found the camera {distance_m:g} m from the LiDAR, needed at most {max_baseline_m:g} m; "
                f"--max-baseline-m sets the limit"
            )
