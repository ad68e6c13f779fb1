"""When a spinning LiDAR measured each point, where its files do not say: the time is the azimuth.

A laser that points a few degrees beside the direction in which the LiDAR faces, as some of an HDL-64E do, is off by
one or two milliseconds.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.drive.document import Lidar, Spin
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.geometry.arrays import Numbers, Points

SHARES = {"start": 0.0, "middle": 0.5, "end": 1.0}
"""Share of a sweep that has passed at each moment that a stamp may state."""


def spin_times(lidar: Lidar | None, cloud: SweepCloud) -> Numbers | None:
    """Compute the times of the points of a sweep from their azimuths.

    Args:
        lidar: The LiDAR of the drive.
        cloud: The sweep.

    Returns:
        (N,) seconds after `points_stamp`; None if the file has times, or the LiDAR's spin is not stated.
    """
    if lidar is None or lidar.spin is None or cloud.time is not None:
        return None
    return azimuth_times(lidar.spin, cloud.points)


def azimuth_times(spin: Spin, points: Points) -> Numbers:
    """Compute when a LiDAR faces points (N, 3), LiDAR frame, in seconds (N,) after the stamp of their sweep."""
    azimuths = np.arctan2(points[:, 1], points[:, 0], dtype=np.float64)
    turns = (azimuths - np.radians(spin.seam_deg)) / (-2.0 * np.pi if spin.clockwise else 2.0 * np.pi)
    times: Numbers = (turns % 1.0 - SHARES[spin.stamp]) / spin.rate_hz
    return times
