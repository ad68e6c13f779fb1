"""Sweeps of a LiDAR that turns while its rig moves at a speed that the drive does not give.

A point at the azimuth `a` from the view of the camera is measured `a / w` after the LiDAR faces the camera, at `w`
radians per second. A rig that moves along the view at the speed `v` meanwhile comes nearer by `v a / w`, which moves a
point at the depth `z` by `tan(a) a v / (w z)` radians towards one side, left and right of the view alike. A camera
that is elsewhere by `t` moves it by `t / z`, at all azimuths alike: so the images show the speed. Of a motion across
the view they show nothing, because a camera that is nearer looks the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Drive
from semcal_cli.drive.lidar import Spin
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations

MIN_LEVEL = 0.5
"""Smallest part of the view across the axis about which the LiDAR turns: a camera that looks up or down is never
faced."""


class Skew(NamedTuple):
    """How the sweeps of a drive are skewed by a speed along the view of its camera."""

    spin: Spin
    view: npt.NDArray[np.float32]
    """(3,) direction in which the camera looks, across the axis of the spin, LiDAR frame."""
    later_s: float
    """Time from the moment at which the LiDAR faces the camera to that of the image, seconds."""

    @classmethod
    def of(cls, drive: Drive, T_camera_lidar: Pose) -> Skew | None:
        """Describe the skew at a pose (4, 4); None if there is none, or nothing tells when the LiDAR sees the view.

        There is none where the drive says anything of its motion. Only a camera that the LiDAR triggers is known to
        look where the LiDAR faces.
        """
        if drive.lidar is None or drive.lidar.spin is None or drive.motion is not None:
            return None
        level = T_camera_lidar[2, :2]
        length = float(np.linalg.norm(level))
        if drive.synchronization != "hardware" or length < MIN_LEVEL:
            return None
        return cls(drive.lidar.spin, np.array([*level / length, 0.0], np.float32), drive.time_offset_s)

    def removed(self, observations: Observations, speed_m_s: float) -> Observations:
        """Move each point to where the LiDAR would have seen it at the moment of the image, at a speed along the view.

        Args:
            observations: Points and images, as the drive gives them.
            speed_m_s: Speed along the view, negative backwards, metres per second.
        """
        if speed_m_s == 0.0:
            return observations
        moment_s = float(self.spin.times(self.view[None])[0]) + self.later_s
        clouds = []
        for cloud in observations.clouds:
            since_s = self.spin.times(observations.rays(cloud.points)) - moment_s
            moved = cloud.points + np.float32(speed_m_s * since_s[:, None]) * self.view
            clouds.append(cloud.with_points(moved))
        return observations.with_clouds(clouds)
