"""Quick checks of a pose, independent of how it was found."""

from __future__ import annotations

import math

from semcal_cli import _core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.motion import can_be_unrolled, shutter_error_px
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.baseline import baseline_m
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.checks.table import CHANCE, FAR_CAMERA, MOTION, OVERLAP, SHUTTER
from semcal_cli.result.stage import Finding

LEAST_BIAS = 1e-12
"""Smallest information by chance that another is divided by, nats."""
AT_LIMIT = 0.999
"""Share of the largest allowed distance from which on a camera counts as clamped to it."""


def check_motion(motion_error_px: float | None) -> tuple[Finding, ...]:
    """Check the median displacement of the points by uncompensated motion, in pixels; None if it is unknown."""
    if motion_error_px is None:
        return ()
    found = (
        f"the LiDAR's motion is not compensated, half of the points are {motion_error_px:.1f} pixels off or more, "
        f"needed at most {MOTION.limit():.0f}"
    )
    return MOTION.measured(motion_error_px, found).findings


def check_shutter(
    drive: Drive, observations: Observations, *, is_compensated: bool = True
) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """Check that a rolling shutter is compensated, or say that it is not.

    Args:
        drive: The drive.
        observations: Observations of it.
        is_compensated: Whether the method compensates it where the motion is known.

    Returns:
        A finding if the shutter costs too many pixels, else a note; nothing if it is compensated or does not roll.
    """
    if drive.camera.readout_s == 0.0:
        return (), ()
    if can_be_unrolled(observations):
        note = "the rolling shutter is not compensated by this method: all lines count as the middle one"
        return (), () if is_compensated else (note,)
    found = "the rolling shutter is not compensated, since the drive gives no direction of its motion"
    error_px = shutter_error_px(drive, [cloud.points for cloud in observations.clouds])
    if error_px is None:
        return (), (f"{found}: {SHUTTER.advice}",)
    cost = f"half of the points are {error_px:.1f} pixels off or more"
    measured = SHUTTER.measured(error_px, f"{found}, {cost}, needed at most {SHUTTER.limit():.0f}")
    return measured.findings, () if measured.findings else (f"{found}, {cost}: {SHUTTER.advice}",)


def check_distance(T_camera_lidar: Pose, max_baseline_m: float) -> tuple[Finding, ...]:
    """Check the distance between camera and LiDAR of a pose that was found without this limit."""
    distance_m = baseline_m(T_camera_lidar)
    if distance_m <= max_baseline_m:
        return ()
    found = f"the camera is {distance_m:.3g} m from the LiDAR, --max-baseline-m allows {max_baseline_m:g} m"
    return (FAR_CAMERA.finding(found),)


def check_pose(
    T_camera_lidar: Pose, agreement: _core.Agreement, max_baseline_m: float = math.inf
) -> tuple[Finding, ...]:
    """Check that a pose lies at no limit, shows enough points, and explains more than chance.

    Args:
        T_camera_lidar: (4, 4), metres.
        agreement: Agreement of the labels at this pose.
        max_baseline_m: Limit of the distance between camera and LiDAR that the refinement respected.
    """
    findings = []
    distance_m = baseline_m(T_camera_lidar)
    if distance_m >= AT_LIMIT * max_baseline_m:
        found = f"the camera is held at {distance_m:.3g} m from the LiDAR, the limit of --max-baseline-m"
        findings.append(FAR_CAMERA.finding(found))
    covered = f"visible points with classes cover {agreement.overlap:.1%} of the picture"
    found = f"{covered}, needed at least {OVERLAP.limit():.0%}"
    findings += OVERLAP.measured(agreement.overlap, found).findings
    by_chance = agreement.mutual_information / max(agreement.bias, LEAST_BIAS)
    how = f"{by_chance:.0%} as well as unrelated ones do by chance"
    found = f"points and pictures agree {how}, needed at least 100%"
    return (*findings, *CHANCE.measured(by_chance, found).findings)
