"""Repeatability: comparison of the poses that several seeds give on the same data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli.assessment.sensitivity import Matrix
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.checks.table import SEEDS
from semcal_cli.result.sections import Repeatability
from semcal_cli.result.stage import Finding
from semcal_cli.result.uncertainty import Uncertainty, normal_half_widths

ROUNDING = 1e-9
"""Allowance for rounding, in metres or degrees, because fixed axes have intervals of zero width."""


def compare_seeds(
    T_camera_lidar: Pose,
    others: Sequence[Pose | None],
    uncertainty: Uncertainty | None,
    of_clock: Matrix | None = None,
) -> tuple[Repeatability, tuple[Finding, ...]]:
    """Compare a pose with those that other seeds give.

    Args:
        T_camera_lidar: (4, 4) answer, metres.
        others: (4, 4) pose of each other seed; None for a seed that gave no answer.
        uncertainty: Uncertainty of the answer; None if it is unknown.
        of_clock: (6, 6) part of its covariance by a clock that is not checked; None if that costs nothing.

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
        sentence = f"{found.num_failed} of {found.num_seeds} seeds gave no answer"
        findings.append(SEEDS.finding(sentence))
    if uncertainty is not None:
        # Errors of K and of the clock move all of them alike.
        squared = np.square(uncertainty.half_widths) - np.square(uncertainty.half_widths_of_intrinsics)
        squared -= 0.0 if of_clock is None else np.square(normal_half_widths(of_clock))
        limits = np.sqrt(np.maximum(squared, 0.0)) + ROUNDING
        if num_beyond := int((np.abs(differences) > limits).any(axis=1).sum()):
            sentence = (
                f"{num_beyond} of {found.num_seeds} seeds lead beyond the 95 % interval, up to "
                f"{100.0 * found.farthest_camera_center_m:.2g} cm and {found.farthest_rotation_deg:.2g} degrees away"
            )
            findings.append(SEEDS.finding(sentence))
    return found, tuple(findings)
