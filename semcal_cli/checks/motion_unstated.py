"""Whether the motion of the rig is known, so that sweeps and a rolling shutter are compensated."""

from __future__ import annotations

from semcal_cli.drive.document import Drive
from semcal_cli.errors import format_against_limit
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.observations.motion import can_be_unrolled, shutter_error_px
from semcal_cli.observations.observations import Observations

GIVE_MOTION = (
    "run `semcal odometry DRIVE`, give motion.poses or motion.twist, or write `motion: {speed_m_s: 0}` if the rig "
    "stood still"
)
MOTION = Check(
    topic="motion",
    advice=GIVE_MOTION,
    entry=Entry(
        title="Motion is not compensated",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the LiDAR's motion is not compensated, so half of the points are off by 5.2 pixels or more "
                f"(limit 3): {GIVE_MOTION}"
            ),
            (
                "the sweeps have point times, but the drive has no `motion:`, so skew cannot be corrected: "
                f"{GIVE_MOTION}"
            ),
        ),
        meaning=(
            "At the stated speed, the sweep is smeared by more pixels than a calibration tolerates. "
            "Without a motion, a sweep may be smeared by any amount; at a steady speed all frames "
            "share the error, so that nothing in them shows it."
        ),
        cause="The drive has only `speed_m_s:`, which does not deskew points, or no `motion:` at all.",
        remedy=(
            "Give poses or a twist ([drive.md](drive.md#a-lidar-that-moves-while-it-turns)), or "
            "record while stationary or at walking speed. `semcal odometry DRIVE` and `semcal import "
            "bag --odometry` find the poses from the sweeps. If the rig was stationary, or the sweeps "
            "are deskewed in spite of their times, `motion: {speed_m_s: 0}` says so."
        ),
        figure=(
            "Median displacement of the points by motion that is not compensated. The check needs a "
            "drive that gives its speed, or whose points have times. Several frames of one scene show "
            "a stationary rig, which is not doubted."
        ),
    ),
)
SHUTTER = Check(
    topic="shutter",
    advice=GIVE_MOTION,
    entry=Entry(
        title="The rolling shutter is not compensated",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the rolling shutter is not compensated, because the drive gives no direction of motion, so half of "
                f"the points are off by 3.8 pixels or more (limit 3): {GIVE_MOTION}"
            ),
            (
                "the shutter rolls, but the drive has no `motion:`, so skew cannot be corrected: "
                f"{GIVE_MOTION}"
            ),
        ),
        meaning=(
            "The rows of an image are exposed one after another, and at the stated speed, or an "
            "unknown one, points miss their pixels."
        ),
        cause=(
            "The camera has a `readout_s:`, but the drive has only `speed_m_s:`, which does not "
            "deskew points, or no `motion:` at all."
        ),
        remedy=(
            "Give poses or a twist ([drive.md](drive.md#a-lidar-that-moves-while-it-turns)), or "
            "record while stationary or at walking speed. For a rig that was stationary, state "
            "`motion: {speed_m_s: 0}`."
        ),
        figure=(
            "Median displacement of the points by the rolling shutter. The check needs a camera with "
            "`readout_s:`, and a drive that gives its speed, or no motion."
        ),
    ),
)
UNSTATED = "but the drive has no `motion:`, so skew cannot be corrected"


def check_motion(motion_error_px: float | None) -> tuple[Finding, ...]:
    """Check the median displacement of the points by uncompensated motion, in pixels; None if it is unknown."""
    if motion_error_px is None:
        return ()
    off_px, most = format_against_limit(motion_error_px, MOTION.limit(), 1)
    sentence = (
        "the LiDAR's motion is not compensated, so half of the points are off by "
        f"{off_px} pixels or more (limit {most})"
    )
    return MOTION.measured(motion_error_px, sentence).findings


def check_unstated(
    drive: Drive, num_scenes: int, num_frames: int, *, have_times: bool
) -> tuple[Finding, ...]:
    """Check that a drive whose points have times gives the motion that smears its sweeps.

    At a steady speed all frames are off alike, so that their labels do not tell it.

    Args:
        drive: The drive.
        num_scenes: Number of scenes that its frames show.
        num_frames: Number of its frames.
        have_times: Whether points have the times at which they were measured.
    """
    if not have_times or not _is_unknown(drive, num_scenes, num_frames):
        return ()
    return (MOTION.finding(f"the sweeps have point times, {UNSTATED}"),)


def _is_unknown(drive: Drive, num_scenes: int, num_frames: int) -> bool:
    """Whether the drive gives no motion, and its frames do not show a rig that stands: several of one scene."""
    return drive.motion is None and not num_scenes == 1 < num_frames


def check_shutter(
    drive: Drive, observations: Observations, *, is_compensated: bool = True
) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """Check that a rolling shutter is compensated, or say that it is not.

    Args:
        drive: The drive.
        observations: Observations of it.
        is_compensated: Whether the method compensates it where the motion is known.

    Returns:
        A finding if the shutter costs too many pixels, or unknown ones, else a note; nothing if it is compensated or
        does not roll.
    """
    if drive.camera.readout_s == 0.0:
        return (), ()
    if can_be_unrolled(observations):
        note = "this method does not compensate for the rolling shutter: all rows count as the middle one"
        return (), () if is_compensated else (note,)
    if _is_unknown(drive, len(set(observations.scenes)), observations.num_frames):
        return (SHUTTER.finding(f"the shutter rolls, {UNSTATED}"),), ()
    open_shutter = "the rolling shutter is not compensated, because the drive gives no direction of motion"
    error_px = shutter_error_px(drive, [cloud.points for cloud in observations.clouds])
    if error_px is None:
        return (), (f"{open_shutter}: {SHUTTER.advice}",)
    off_px, most = format_against_limit(error_px, SHUTTER.limit(), 1)
    cost = f"so half of the points are off by {off_px} pixels or more"
    measured = SHUTTER.measured(error_px, f"{open_shutter}, {cost} (limit {most})")
    return measured.findings, () if measured.findings else (f"{open_shutter}, {cost}: {SHUTTER.advice}",)
