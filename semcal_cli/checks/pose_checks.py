"""Quick checks of a pose, independent of how it was found, and of the poses that several seeds give."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.errors import format_against_limit
from semcal_cli.findings.check import CHANCE, FAR_CAMERA, MOTION, OVERLAP, SEEDS, SHUTTER
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import baseline_m, compare_poses
from semcal_cli.observations.motion import can_be_unrolled, shutter_error_px
from semcal_cli.observations.observations import Observations
from semcal_cli.result.sections import Repeatability
from semcal_cli.result.uncertainty import Uncertainty, normal_half_widths

LEAST_BIAS = 1e-12
"""Lower bound of the information by chance as a divisor, nats."""
AT_LIMIT = 0.999
"""Fraction of the largest allowed distance from which a camera counts as clamped to it."""
UNKNOWN_COST = (
    "but the drive gives no motion, so the error from motion is unknown, needed motion.poses, motion.twist, or "
    "motion.speed_m_s (0 for a stationary rig)"
)
ROUNDING = 1e-9
"""Allowance for rounding, in metres or degrees, because fixed axes have intervals of zero width."""


def check_motion(motion_error_px: float | None) -> tuple[Finding, ...]:
    """Check the median displacement of the points by uncompensated motion, in pixels; None if it is unknown."""
    if motion_error_px is None:
        return ()
    off_px, most = format_against_limit(motion_error_px, MOTION.limit(), 1)
    found = (
        f"the LiDAR's motion is not compensated, so half of the points are off by {off_px} pixels or more, "
        f"needed at most {most}"
    )
    return MOTION.measured(motion_error_px, found).findings


def check_unstated(drive: Drive, observations: Observations) -> tuple[Finding, ...]:
    """Check that a drive whose points have times gives the motion that smears its sweeps.

    At a steady speed all frames are off alike, so that their labels do not tell it.
    """
    if not observations.have_times or not _is_unknown(drive, observations):
        return ()
    return (MOTION.finding(f"the points have times, {UNKNOWN_COST}"),)


def _is_unknown(drive: Drive, observations: Observations) -> bool:
    """Whether the drive gives no motion, and its frames do not show a rig that stands: several of one scene."""
    stands = len(set(observations.scenes)) == 1 < observations.num_frames
    return drive.motion is None and not stands


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
    found = "the rolling shutter is not compensated, because the drive gives no direction of motion"
    if _is_unknown(drive, observations):
        return (SHUTTER.finding(f"the shutter rolls, {UNKNOWN_COST}"),), ()
    error_px = shutter_error_px(drive, [cloud.points for cloud in observations.clouds])
    if error_px is None:
        return (), (f"{found}: {SHUTTER.advice}",)
    off_px, most = format_against_limit(error_px, SHUTTER.limit(), 1)
    cost = f"so half of the points are off by {off_px} pixels or more"
    measured = SHUTTER.measured(error_px, f"{found}, {cost}, needed at most {most}")
    return measured.findings, () if measured.findings else (f"{found}, {cost}: {SHUTTER.advice}",)


def check_pose(
    T_camera_lidar: Pose, agreement: core.Agreement, max_baseline_m: float = math.inf
) -> tuple[Finding, ...]:
    """Check that a pose is not at a limit, shows enough points, and explains more than chance.

    Args:
        T_camera_lidar: (4, 4), metres.
        agreement: Agreement of the labels at this pose.
        max_baseline_m: Limit of the distance between camera and LiDAR that the refinement respected.
    """
    findings = []
    distance_m = baseline_m(T_camera_lidar)
    if distance_m >= AT_LIMIT * max_baseline_m:
        found = f"the camera reached {distance_m:.3g} m from the LiDAR, the limit of --max-baseline-m"
        findings.append(FAR_CAMERA.finding(found))
    covered, least = format_against_limit(agreement.overlap, OVERLAP.limit(), 1, "%")
    found = f"visible points with classes cover {covered} of the image, needed at least {least}"
    findings += OVERLAP.measured(agreement.overlap, found).findings
    by_chance = agreement.mutual_information / max(agreement.bias, LEAST_BIAS)
    as_well, least = format_against_limit(by_chance, CHANCE.limit(), unit="%")
    found = f"points and images agree {as_well} as well as unrelated ones would by chance, needed at least {least}"
    return (*findings, *CHANCE.measured(by_chance, found).findings)


def compare_seeds(
    T_camera_lidar: Pose,
    others: Sequence[Pose | None],
    uncertainty: Uncertainty | None,
    of_motion: Matrix | None = None,
) -> tuple[Repeatability, tuple[Finding, ...]]:
    """Compare a pose with those that other seeds give.

    Args:
        T_camera_lidar: (4, 4) answer, metres.
        others: (4, 4) pose of each other seed; None for a seed that gave no answer.
        uncertainty: Uncertainty of the answer; None if it is unknown.
        of_motion: (6, 6) part of its covariance by the clock and the motion that the drive states; None without any.

    Returns:
        The spread of the poses, and findings against the answer.
    """
    reached = [T for T in others if T is not None]
    differences = np.array([np.zeros(6), *(compare_poses(T, T_camera_lidar).offsets for T in reached)])
    spread = differences.std(axis=0, ddof=1).tolist() if reached else None
    found = Repeatability(
        num_seeds=len(others) + 1,
        num_failed=len(others) - len(reached),
        spread_camera_center_m=spread and spread[:3],
        spread_rotation_deg=spread and spread[3:],
        farthest_camera_center_m=float(np.linalg.norm(differences[:, :3], axis=1).max()),
        farthest_rotation_deg=float(np.linalg.norm(differences[:, 3:], axis=1).max()),
    )
    findings = []
    if found.num_failed:
        findings.append(SEEDS.finding(f"{found.num_failed} of {found.num_seeds} seeds failed"))
    if uncertainty is not None:
        # Errors of K, of the clock and of the motion move all seeds alike.
        squared = np.square(uncertainty.half_widths) - np.square(uncertainty.half_widths_of_intrinsics)
        squared -= 0.0 if of_motion is None else np.square(normal_half_widths(of_motion))
        limits = np.sqrt(np.maximum(squared, 0.0)) + ROUNDING
        if num_beyond := int((np.abs(differences) > limits).any(axis=1).sum()):
            sentence = (
                f"{num_beyond} of {found.num_seeds} seeds ended outside the 95 % interval, up to "
                f"{100.0 * found.farthest_camera_center_m:.2g} cm and {found.farthest_rotation_deg:.2g} degrees away"
            )
            findings.append(SEEDS.finding(sentence))
    return found, tuple(findings)
