"""Report on the motion of a drive: it shows whether the clock can be checked with this recording."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from semcal_cli.drive.document import Drive, Motion
from semcal_cli.errors import InputError, counted
from semcal_cli.observations.motion import read_trajectory

LEAST_SPREAD_M_S, LEAST_TURN_DEG_S = 2.0, 5.0
"""Difference of speeds and fastest turn; below both, all frames move much alike. A clock that is 20 ms off shifts
frames whose speeds differ by 2 m/s by 4 cm against each other, and a turn of 5 degrees per second by 0.1 degrees."""
NO_MOTION = (
    "the drive gives no motion, so sweeps are not deskewed and the clock is not checked: give motion.poses, or get "
    "them from the sweeps with `semcal odometry`, or from a recording with `semcal import bag --odometry`"
)


class MotionReport(NamedTuple):
    """The motion of a drive at the moments of its images."""

    span_s: float | None = None
    """Time from the first sweep to the last, in seconds; None without stamps."""
    speeds_m_s: tuple[float, float] | None = None
    """Lowest and highest speed; None without poses or a twist."""
    fastest_turn_deg_s: float | None = None
    """Fastest turn, in degrees per second; None without poses or a twist."""
    suspicions: tuple[str, ...] = ()
    """Findings about the motion."""
    advice: tuple[str, ...] = ()
    """What the motion lacks, and what would help."""


def report_motion(drive: Drive) -> MotionReport:
    """Examine the stamps and the motion of a drive."""
    stamps = [frame.points_stamp for frame in drive.frames if frame.points_stamp is not None]
    has_stamps = bool(stamps) and all(frame.image_stamp is not None for frame in drive.frames)
    found = MotionReport(span_s=max(stamps) - min(stamps) if stamps else None)
    if drive.motion is None:
        return found._replace(advice=(NO_MOTION,) if has_stamps and len(stamps) > 1 else ())
    if drive.motion.speed_m_s is not None:
        return found
    try:
        twists, missed = _twists(drive, drive.motion)
    except InputError as error:
        return found._replace(suspicions=(str(error),))
    suspicions: tuple[str, ...] = ()
    if missed:
        frames = f"{counted(len(missed), 'frame')}{', first' * (len(missed) > 1)} {missed[0]}"
        suspicions = (f"the poses do not cover the images of {frames}",)
    if not len(twists):
        return found._replace(suspicions=suspicions)
    speeds = np.linalg.norm(twists[:, :3], axis=1)
    low, high = float(speeds.min()), float(speeds.max())
    turn_deg_s = math.degrees(np.linalg.norm(twists[:, 3:], axis=1).max())
    advice: tuple[str, ...] = ()
    if high - low < LEAST_SPREAD_M_S and turn_deg_s < LEAST_TURN_DEG_S:
        advice = (
            f"all frames have the same motion, at {low:.1f} to {high:.1f} m/s with turns of up to {turn_deg_s:.1f} "
            "degrees per second: record at different speeds, with turns, so that the clock can be checked",
        )
    return found._replace(
        speeds_m_s=(low, high), fastest_turn_deg_s=turn_deg_s, suspicions=suspicions, advice=advice
    )


def _twists(drive: Drive, motion: Motion) -> tuple[np.ndarray, list[str]]:
    """Read the twist (N, 6) at each image, metres and radians per second, and the sweeps that poses do not cover."""
    if motion.twist is not None:
        return np.array([[*motion.twist.linear_m_s, *motion.twist.angular_rad_s]]), []
    assert motion.poses is not None
    trajectory, twists, missed = read_trajectory(drive, motion.poses), [], []
    for frame in drive.frames:
        try:
            twists.append(trajectory.twist_at((frame.image_stamp or 0.0) + drive.time_offset_s))
        except ValueError:
            missed.append(frame.points)
    return np.array(twists).reshape(-1, 6), missed
