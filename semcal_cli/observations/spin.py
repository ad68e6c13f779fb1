"""When a spinning LiDAR measured each point, where its files do not say: the time is the azimuth.

A laser that points a few degrees beside the direction in which the LiDAR faces, as some of an HDL-64E do, is off by
one or two milliseconds.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.drive.document import Lidar, Spin
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.geometry.arrays import Numbers, Points

NUM_PARTS = 180
"""Number of parts into which the points of a sweep are divided to see whether they are in the order of one turn."""
MIN_COHERENCE = 0.9
"""Smallest length of the mean of the directions in a part: parts of one turn span some 2 degrees, those of a file that
lists ring by ring span a third of a turn or more."""
MIN_SHARE_ONWARD = 0.95
"""Smallest share of the parts that follow the one before in the direction of the turn."""
TURN_DEG = 300.0, 400.0
"""Range of the whole turn."""
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


def seam_of(points: Points) -> tuple[bool, float] | None:
    """Find where a sweep begins if its points are in the order of one turn, as many recorders write them.

    Args:
        points: (N, 3) metres, LiDAR frame.

    Returns:
        Whether the LiDAR turns clockwise as seen from above, and the azimuth of the first points in degrees; None if
        the points are in another order.
    """
    azimuths = np.arctan2(points[:, 1], points[:, 0], dtype=np.float64)
    if len(azimuths) < NUM_PARTS:
        return None
    parts = np.array([np.mean(part) for part in np.array_split(np.exp(1j * azimuths), NUM_PARTS)])
    steps = np.angle(parts[1:] / parts[:-1])
    turn_deg = float(np.degrees(np.abs(steps.sum())))
    is_clockwise = bool(steps.sum() < 0.0)
    share_onward = np.mean((steps < 0.0) == is_clockwise)
    is_coherent = np.median(np.abs(parts)) >= MIN_COHERENCE and share_onward >= MIN_SHARE_ONWARD
    if not is_coherent or not TURN_DEG[0] <= turn_deg <= TURN_DEG[1]:
        return None
    return is_clockwise, float(np.degrees(np.angle(parts[0]) - 0.5 * np.median(steps)))
