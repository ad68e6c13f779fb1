"""Rivals of a pose: other poses near it that the data explain nearly as well.

What edges, segments and intensities tell has many tops, and so has what labels of few frames tell. Around a wrong pose
they are about as high as its own; around the right one they are not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from semcal_cli import _core
from semcal_cli.assessment.uncertainty import MAX_HALF_WIDTH_DEG, MAX_HALF_WIDTH_M
from semcal_cli.config import EDGE_BAND_PX, ExactConfig, PolishConfig, PyramidConfig
from semcal_cli.drive.frame_selection import few_frames
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import displaced
from semcal_cli.refinement.exact import exact_config
from semcal_cli.refinement.polish import newton
from semcal_cli.refinement.pyramid import pyramid_factors
from semcal_cli.result.checks.check import Measured
from semcal_cli.result.checks.table import CUES_DISAGREE, OTHER_POSE
from semcal_cli.result.uncertainty import Uncertainty

NUM_RIVALS, NUM_FRAMES = 16, 5
"""Number of ascents that look for rivals, and of the frames by which they do."""
NUM_COMPARED = 6
"""Number of the highest tops that are compared with the pose, by all frames."""
SPREAD_DEG, SPREAD_M = 3.0, 0.3
"""Mean distance of their starts from the pose; the nearest have half of it, and the farthest one and a half."""
BLOCKS_DEG, FINER = 0.9, 4
"""Blocks of the first level of an ascent; those of the second are finer by this factor."""
CONFIG = ExactConfig(steps=40, max_points=30_000)
NUM_OTHERS = 8
OTHERS_DEG, OTHERS_M = 3.0, 0.3
"""Number of poses around the found one that it is compared with, and their distance: segments end up to 4 degrees
off."""


def check_rivals(
    observations: Observations, T_camera_lidar: Pose, uncertainty: Uncertainty | None
) -> tuple[Measured, ...]:
    """Check that no other pose within reach explains the observations nearly as well.

    A rival lies farther away than a trusted pose may be uncertain; by labels, outside the interval of the pose. Its
    information and that of the pose are compared by the points that are visible at the pose, square by square of the
    pictures.

    Args:
        observations: Points and pixels of all cues.
        T_camera_lidar: (4, 4) pose, metres.
        uncertainty: Uncertainty of the pose; None if it is not determined, and only what is far is a rival.
    """
    tops, near = _tops(observations, T_camera_lidar)
    if observations.starts is None and uncertainty is not None:
        finished = [newton(observations, top, PolishConfig()).T_camera_lidar for top in near]
        tops += [top for top in finished if _is_outside(top, T_camera_lidar, uncertainty)]
    if not tops:
        return ()
    behind, T_rival = min(
        zip(sigmas_behind(observations, T_camera_lidar, tops), tops, strict=True),
        key=lambda each: each[0],
    )
    away = compare_poses(T_rival, T_camera_lidar)
    how = (
        f"almost as well, {behind:.1f} standard errors behind"
        if behind > 0.0
        else f"better, {-behind:.1f} standard errors ahead"
    )
    found = (
        f"a pose {away.rotation_deg:.1f} degrees and {away.camera_center_cm:.0f} cm away explains the data {how}, "
        f"needed {OTHER_POSE.limit():g} behind"
    )
    return (OTHER_POSE.measured(behind, found),)


def check_guide(guide: Observations, T_camera_lidar: Pose, T_initial: Pose) -> Measured:
    """Check that segments and labels of the pictures do not prefer another pose to the one that edges found.

    Args:
        guide: Points and pixels by segments.
        T_camera_lidar: (4, 4) pose by edges, metres.
        T_initial: (4, 4) pose from which edges started.
    """
    rng = np.random.default_rng(0)
    others = [
        T_initial,
        *(displaced(T_camera_lidar, OTHERS_DEG, OTHERS_M, rng) for _ in range(NUM_OTHERS)),
    ]
    behind = sigmas_behind(guide, T_camera_lidar, others)
    best = int(np.argmin(behind))
    away = compare_poses(others[best], T_camera_lidar)
    found = (
        f"segments and labels of the pictures prefer a pose {away.rotation_deg:.1f} degrees and "
        f"{away.camera_center_cm:.0f} cm away from that of edges, by {-behind[best]:.1f} standard errors, needed at "
        f"most {CUES_DISAGREE.limit():g}"
    )
    return CUES_DISAGREE.measured(-behind[best], found)


def _tops(observations: Observations, T_camera_lidar: Pose) -> tuple[list[Pose], list[Pose]]:
    """Ascend from poses around the given one, at two levels of the pyramid, to the highest far and near tops."""
    rng = np.random.default_rng(0)
    shares = np.linspace(0.5, 1.5, NUM_RIVALS)
    poses = [displaced(T_camera_lidar, share * SPREAD_DEG, share * SPREAD_M, rng) for share in shares]
    few = few_frames(observations, NUM_FRAMES)
    coarsest, *_ = pyramid_factors(observations.camera, PyramidConfig(coarsest_block_deg=BLOCKS_DEG))
    config = exact_config(few, CONFIG)
    for factor in (coarsest, max(coarsest // FINER, 1)):
        ends = _core.align(few.core, poses, config, factor=factor, visible_only=True, seed=0)
        far, near = list[Pose](), list[Pose]()
        for end in sorted(ends, key=lambda end: -end.mutual_information):
            (far if _is_far(end.T_camera_lidar, T_camera_lidar) else near).append(end.T_camera_lidar)
        far, near = far[:NUM_COMPARED], near[:NUM_COMPARED]
        poses = far + near if observations.starts is None else far
    return far, near


def _is_far(T_rival: Pose, T_camera_lidar: Pose) -> bool:
    """Whether a rival is farther away than a trusted pose may be uncertain."""
    away = compare_poses(T_rival, T_camera_lidar)
    return away.rotation_deg > MAX_HALF_WIDTH_DEG or away.camera_center_cm > 100.0 * MAX_HALF_WIDTH_M


def _is_outside(T_rival: Pose, T_camera_lidar: Pose, uncertainty: Uncertainty) -> bool:
    offsets = compare_poses(T_rival, T_camera_lidar).offsets
    return bool((np.abs(offsets) > uncertainty.half_widths).any())


def sigmas_behind(observations: Observations, T_camera_lidar: Pose, rivals: Sequence[Pose]) -> list[float]:
    """Standard errors by which each rival (4, 4) is behind a pose (4, 4); 0 if too few squares are seen to tell."""
    gains = _core.information_gains(observations.core, T_camera_lidar, rivals, EDGE_BAND_PX)
    return [-gain.gain / max(gain.sigma, 1e-12) if math.isfinite(gain.sigma) else 0.0 for gain in gains]
