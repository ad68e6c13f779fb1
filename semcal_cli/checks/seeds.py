"""Whether other seeds lead to the same pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.phrases import ELSEWHERE
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.result.sections import Repeatability
from semcal_cli.result.uncertainty import Uncertainty, normal_half_widths

SEEDS = Check(
    topic="seeds",
    advice=ELSEWHERE,
    entry=Entry(
        title="Seeds end in different places",
        section=PageSection.CONVERGENCE,
        quotes=(
            (
                "1 of 5 seeds ended outside the 95 % interval, up to 3.1 cm and 0.22 degrees away: "
                "add frames from other places"
            ),
            "1 of 5 seeds failed: add frames from other places",
        ),
        meaning="With `--repeat`, another seed ended elsewhere, or gave no answer.",
        cause="The data determine the pose less precisely than the interval says.",
        remedy="Add frames from other places.",
    ),
)
ROUNDING = 1e-9
"""Allowance for rounding, in metres or degrees, because fixed axes have intervals of zero width."""


def compare_seeds(
    T_camera_lidar: Pose,
    others: Sequence[Pose | None],
    uncertainty: Uncertainty | None,
    motion_covariance: Matrix | None = None,
) -> tuple[Repeatability, tuple[Finding, ...]]:
    """Compare a pose with those that other seeds give.

    Args:
        T_camera_lidar: (4, 4) answer, metres.
        others: (4, 4) pose of each other seed; None for a seed that gave no answer.
        uncertainty: Uncertainty of the answer; None if it is unknown.
        motion_covariance: (6, 6) part of its covariance by the clock and the motion that the drive states; None without
            any.

    Returns:
        The spread of the poses, and findings against the answer.
    """
    reached = [T for T in others if T is not None]
    differences = np.array([np.zeros(6), *(compare_poses(T, T_camera_lidar).offsets for T in reached)])
    spread = differences.std(axis=0, ddof=1).tolist() if reached else None
    repeatability = Repeatability(
        num_seeds=len(others) + 1,
        num_failed=len(others) - len(reached),
        spread_camera_center_m=spread and spread[:3],
        spread_rotation_deg=spread and spread[3:],
        farthest_camera_center_m=float(np.linalg.norm(differences[:, :3], axis=1).max()),
        farthest_rotation_deg=float(np.linalg.norm(differences[:, 3:], axis=1).max()),
    )
    findings = []
    if repeatability.num_failed:
        findings.append(
            SEEDS.finding(f"{repeatability.num_failed} of {repeatability.num_seeds} seeds failed")
        )
    if uncertainty is not None:
        # Errors of K, of the clock and of the motion move all seeds alike.
        squared = np.square(uncertainty.half_widths) - np.square(uncertainty.half_widths_of_intrinsics)
        squared -= 0.0 if motion_covariance is None else np.square(normal_half_widths(motion_covariance))
        limits = np.sqrt(np.maximum(squared, 0.0)) + ROUNDING
        if num_beyond := int((np.abs(differences) > limits).any(axis=1).sum()):
            sentence = (
                f"{num_beyond} of {repeatability.num_seeds} seeds ended outside the 95 % interval, up to "
                f"{100.0 * repeatability.farthest_camera_center_m:.2g} cm and "
                f"{repeatability.farthest_rotation_deg:.2g} degrees away"
            )
            findings.append(SEEDS.finding(sentence))
    return repeatability, tuple(findings)
