"""Why a pose is not trusted, in how it was found: sentences, each with its figure."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.config import MIN_OVERLAP
from semcal_cli.geometry.poses import Pose, rotation_error_deg
from semcal_cli.initialization.search import Hypothesis
from semcal_cli.refinement.polish import Polish
from semcal_cli.refinement.pyramid import Refinement
from semcal_cli.result.calibration import Repeatability, UncertaintyRecord

MIN_RUNNER_UP_MARGIN = 2.0
"""An answer is trusted only if other mounting directions are so many standard errors of mutual information behind."""
MAX_MOTION_PX = 3.0
"""Half of the points may be displaced so far by a motion that is not compensated."""
AT_LIMIT = 0.999
"""A camera that is so near to the limit of its distance is held by it."""
ROUNDING = 1e-9
"""Metres or degrees: axes that are fixed have intervals without a width."""


def convergence(refinement: Refinement) -> list[str]:
    """Say why a refinement's pose cannot be trusted, if so."""
    if refinement.converged:
        return []
    return [
        f"the refinement had not settled: the pose still moved points by {refinement.levels[-1].drift:.1f} pixels "
        f"over the last quarters of the finest level"
    ]


def polish(polished: Polish) -> list[str]:
    """Say what speaks against a pose in how it was polished."""
    if not polished.is_accepted:
        lost, sigma = -polished.gain_nats, polished.sigma_nats
        if not math.isfinite(sigma):
            return ["the polish was rejected: held-out data say nothing of it"]
        return [
            f"the polish was rejected: held-out data agree less after it, by {lost:.4f} +- {sigma:.4f} nats"
        ]
    if polished.is_settled:
        return []
    if not math.isfinite(polished.moved_px):
        return ["the polish found no direction in which the pose changes the labels' agreement"]
    return [
        f"the polish had not settled: its last round still moved points by {polished.moved_px:.2f} pixels"
    ]


def repeatability(
    found: Repeatability, differences: npt.NDArray[np.float64], uncertainty: UncertaintyRecord | None
) -> list[str]:
    """Say what speaks against a pose in where other seeds lead: (seeds, 6) metres and degrees from it."""
    reasons = []
    if found.num_failed:
        reasons.append(f"{found.num_failed} of {found.num_seeds} seeds gave no answer")
    if uncertainty is not None:
        half_widths = [
            *uncertainty.half_width_95_camera_center_m,
            *uncertainty.half_width_95_rotation_deg,
        ]
        num_beyond = int((np.abs(differences) > np.array(half_widths) + ROUNDING).any(axis=1).sum())
        if num_beyond:
            reasons.append(
                f"{num_beyond} of {found.num_seeds} seeds lead beyond the 95 % interval, up to "
                f"{100.0 * found.farthest_camera_center_m:.2g} cm and {found.farthest_rotation_deg:.2g} degrees away"
            )
    return reasons


def motion(error_px: float | None) -> list[str]:
    """Say how far points are off that a motion displaced."""
    if error_px is None or error_px <= MAX_MOTION_PX:
        return []
    return [
        f"the LiDAR's motion is not compensated: half of the points are {error_px:.1f} pixels off or more, needed at "
        f"most {MAX_MOTION_PX:.0f}"
    ]


def distance(T_camera_lidar: Pose, max_baseline_m: float) -> list[str]:
    """Say whether a camera that nothing holds is farther from the LiDAR than it may be."""
    distance_m = float(np.linalg.norm(T_camera_lidar[:3, 3]))
    if distance_m <= max_baseline_m:
        return []
    return [f"the camera is {distance_m:.3g} m from the LiDAR, --max-baseline-m allows {max_baseline_m:g} m"]


def baseline(T_camera_lidar: Pose, max_baseline_m: float) -> list[str]:
    """Say whether the limit of the camera's distance holds it."""
    distance_m = float(np.linalg.norm(T_camera_lidar[:3, 3]))
    if distance_m < AT_LIMIT * max_baseline_m:
        return []
    return [
        f"the camera is held at {distance_m:.3g} m from the LiDAR, the limit of --max-baseline-m: it may be farther "
        f"away"
    ]


def overlap(agreement: _core.Agreement) -> list[str]:
    """Say whether points cover too little of the picture."""
    if agreement.overlap >= MIN_OVERLAP:
        return []
    return [
        f"visible labelled points cover {agreement.overlap:.1%} of the picture, needed are {MIN_OVERLAP:.0%}"
    ]


def information(agreement: _core.Agreement) -> list[str]:
    """Say whether labels share no more than chance."""
    if agreement.mutual_information > agreement.bias:
        return []
    return [
        f"labels share {agreement.mutual_information:.4f} nats, no more than unrelated labels do by chance"
    ]


def runner_up(best: Hypothesis, other: Hypothesis, margin: float) -> list[str]:
    """Say whether another mounting is as good."""
    if margin >= MIN_RUNNER_UP_MARGIN:
        return []
    angle_deg = rotation_error_deg(best.T_camera_lidar, other.T_camera_lidar)
    return [
        f"a mounting {angle_deg:.0f} degrees away explains the labels almost as well: "
        f"{other.corrected_nats:.4f} against {best.corrected_nats:.4f} nats, "
        f"{margin:.2f} standard errors apart, needed {MIN_RUNNER_UP_MARGIN:.2f}; add frames"
    ]
