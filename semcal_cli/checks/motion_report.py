"""Report on the motion of a drive: it shows whether the clock can be checked with this recording."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import InputError, counted
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.observations.motion import read_trajectory

NO_MOTION = Check(
    topic="no-motion",
    advice=(
        "give motion.poses, or get them from the sweeps with `semcal odometry`, or from a recording with `semcal "
        "import bag --odometry`"
    ),
    entry=Entry(
        title="The drive gives no motion",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "the drive gives no motion, so sweeps are not deskewed and the clock is not checked: give "
                "motion.poses, or get them from the sweeps with `semcal odometry`, or from a recording with "
                "`semcal import bag --odometry`"
            ),
        ),
        meaning="The frames have stamps, but `motion:` does not say how the rig moved.",
        cause="The recording has no poses, or the import left them out.",
        remedy="Find the poses as the advice says, or state `motion: {speed_m_s: 0}` for a rig that stood.",
    ),
)
SAME_MOTION = Check(
    topic="same-motion",
    advice="record at different speeds, with turns, so that the clock can be checked",
    entry=Entry(
        title="All frames have the same motion",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "all frames have the same motion, at 8.0 to 8.3 m/s with turns of up to 0.4 degrees per second: "
                "record at different speeds, with turns, so that the clock can be checked"
            ),
        ),
        meaning="At a steady speed, a clock that is off moves all frames alike, and nothing shows it.",
        cause="The rig drove straight ahead at a steady speed.",
        remedy="Record at different speeds, with turns.",
        figure="Difference of speeds, and fastest turn. Both must be below their limits.",
    ),
    settings={
        "the difference of speeds": Limit(
            at_least=2.0,
            unit="m/s",
            source="a clock that is 20 ms off shifts frames whose speeds differ by so much by 4 cm against each other",
        ),
        "the fastest turn": Limit(
            at_least=5.0,
            unit="degrees per second",
            source="a clock that is 20 ms off turns a frame in such a turn by 0.1 degrees",
        ),
    },
)
UNCOVERED_IMAGES = Check(
    topic="uncovered-images",
    entry=Entry(
        title="Poses do not cover all images",
        section=PageSection.INSPECTION,
        quotes=(
            "the poses do not cover the images of 1 frame 000000.pcd",
            "the poses do not cover the images of 3 frames, first 000000.pcd",
        ),
        meaning="Images are earlier than the first pose, later than the last one, or in a gap of the poses.",
        cause="The poses are of another part of the recording, or their stamps are those of another clock.",
        remedy="Compare the stamps of poses and images, or leave these frames out.",
    ),
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
    report = MotionReport(span_s=max(stamps) - min(stamps) if stamps else None)
    if drive.motion is None:
        is_open = has_stamps and len(stamps) > 1
        sentence = "the drive gives no motion, so sweeps are not deskewed and the clock is not checked"
        return report._replace(advice=(NO_MOTION.finding(sentence).sentence,) if is_open else ())
    if drive.motion.speed_m_s is not None:
        return report
    try:
        twists, missed = _twists(drive, drive.motion)
    except InputError as error:
        return report._replace(suspicions=(str(error),))
    suspicions: tuple[str, ...] = ()
    if missed:
        frames = f"{counted(len(missed), 'frame')}{', first' * (len(missed) > 1)} {missed[0]}"
        uncovered = UNCOVERED_IMAGES.finding(f"the poses do not cover the images of {frames}")
        suspicions = (uncovered.sentence,)
    if not len(twists):
        return report._replace(suspicions=suspicions)
    speeds = np.linalg.norm(twists[:, :3], axis=1)
    low, high = float(speeds.min()), float(speeds.max())
    turn_deg_s = math.degrees(np.linalg.norm(twists[:, 3:], axis=1).max())
    is_same = high - low < SAME_MOTION.limit("the difference of speeds")
    advice: tuple[str, ...] = ()
    if is_same and turn_deg_s < SAME_MOTION.limit("the fastest turn"):
        sentence = (
            f"all frames have the same motion, at {low:.1f} to {high:.1f} m/s with turns of up to {turn_deg_s:.1f} "
            "degrees per second"
        )
        advice = (SAME_MOTION.finding(sentence).sentence,)
    return report._replace(
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
