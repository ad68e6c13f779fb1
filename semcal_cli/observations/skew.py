"""Sweeps of a LiDAR that turns while its rig moves at a speed that the drive does not give.

A point at the azimuth `a` from the view of the camera is measured `a / w` after the LiDAR faces the camera, at `w`
radians per second. A rig that moves along the view at the speed `v` meanwhile comes nearer by `v a / w`, which moves a
point at the depth `z` by `tan(a) a v / (w z)` radians towards one side, left and right of the view alike. A camera
that is elsewhere by `t` moves it by `t / z`, at all azimuths alike: so the images show the speed. Of a motion across
the view they show nothing, because a camera that is nearer looks the same.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle, repeat
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Drive
from semcal_cli.drive.lidar import Spin
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.observations.observations import LabelledCloud, Observations, along_at
from semcal_cli.threads import thread_pool

MIN_LEVEL = 0.5
"""Smallest part of the view across the axis about which the LiDAR turns: a camera that looks up or down is never
faced."""
MAX_FACING_SEAM = 0.0
"""Largest cosine of the angle between the view and the seam. On either side of a seam, points are a turn apart, and no
side of it may be in the image."""

MOMENT_SIGMA_S = 0.004
"""Standard deviation of the moment of the images where the drive states none: the LiDAR of KITTI makes the cameras
expose 3.7 ms after it faces forward (`tests/benchmarks/spin.py`)."""


class Skew(NamedTuple):
    """How the sweeps of a drive are skewed by a speed along the view of its camera."""

    spin: Spin
    view: npt.NDArray[np.float32]
    """(3,) direction in which the camera looks, across the axis of the spin, LiDAR frame."""
    moments_s: tuple[float, ...]
    """Moment of the image of each frame, or of all frames alike, on the clock of the spin's times, seconds."""
    moment_sigma_s: float = MOMENT_SIGMA_S
    """Standard deviation of the moments, seconds."""
    center: str = "cx"
    """The coordinate of the principal point whose errors look like a speed: cx, or cy of a camera on its side."""

    @classmethod
    def of(cls, drive: Drive, T_camera_lidar: Pose) -> Skew | None:
        """Describe the skew at a pose (4, 4); None if there is none, or nothing tells when the LiDAR sees the view.

        There is none where the drive says anything of its motion. Where frames have no stamps, the camera is taken to
        look where the LiDAR faces.
        """
        if drive.lidar is None or drive.lidar.spin is None or drive.motion is not None:
            return None
        spin, level = drive.lidar.spin, T_camera_lidar[2, :2]
        length = float(np.linalg.norm(level))
        if drive.synchronization != "hardware" or length < MIN_LEVEL:
            return None
        view = np.array([*level / length, 0.0], np.float32)
        seam = np.radians(spin.seam_deg)
        if view @ [np.cos(seam), np.sin(seam), 0.0] > MAX_FACING_SEAM:
            return None
        facing_s = float(spin.times(view[None])[0])
        moments_s = [
            facing_s
            if frame.image_stamp is None or frame.points_stamp is None
            else frame.image_stamp - frame.points_stamp
            for frame in drive.frames
        ]
        is_stated = "time_offset_sigma_s" in drive.model_fields_set
        return cls(
            spin,
            view,
            tuple(moment_s + drive.time_offset_s for moment_s in moments_s),
            drive.time_offset_sigma_s if is_stated else MOMENT_SIGMA_S,
            "cx" if along_at(T_camera_lidar) == "rows" else "cy",
        )

    @property
    def since_facing_s(self) -> float:
        """Mean time from when the LiDAR faces the view of the camera to the image, seconds; negative before."""
        return float(np.mean(self.moments_s) - self.spin.times(self.view[None])[0])

    @classmethod
    def undone(
        cls, observations: Observations, drive: Drive, T_camera_lidar: Pose, speed_m_s: float
    ) -> Observations:
        """Deskew the observations of a drive by a speed that a calibration (4, 4) found; without one, as they are."""
        skew = cls.of(drive, T_camera_lidar)
        return observations if skew is None else skew.deskewed(observations, speed_m_s)

    def deskewed(self, observations: Observations, speed_m_s: float) -> Observations:
        """Move each point to where the LiDAR would have seen it at the moment of the image, at a speed along the view.

        Args:
            observations: Points and images, as the drive gives them.
            speed_m_s: Speed along the view, negative backwards, metres per second.
        """
        return observations if speed_m_s == 0.0 else self.at_speeds(observations)(speed_m_s)

    def at_speeds(self, observations: Observations) -> Callable[[float], Observations]:
        """Return a function that deskews these observations by a speed; the times of the points are computed once."""

        def seconds(cloud: LabelledCloud, moment_s: float) -> Numbers:
            return self.spin.times(observations.rays(cloud.points)) - moment_s

        def moved(cloud: LabelledCloud, since_s: Numbers, speed_m_s: float) -> LabelledCloud:
            return cloud.with_points(cloud.points + np.float32(speed_m_s * since_s[:, None]) * self.view)

        clouds = observations.clouds
        with thread_pool() as pool:
            # The frames by one cue follow those by another.
            since_s = list(pool.map(seconds, clouds, cycle(self.moments_s)))

        def at_speed(speed_m_s: float) -> Observations:
            if speed_m_s == 0.0:
                return observations
            with thread_pool() as pool:
                return observations.with_clouds(pool.map(moved, clouds, since_s, repeat(speed_m_s)))

        return at_speed
