"""Rivals of a pose: other poses near it that the data explain nearly as well, and mountings that look alike.

The information of edges, segments and intensities has many tops, and so has that of labels of few frames. Around a
wrong pose they are about as high as its own; around the right one they are lower.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from semcal_cli import core
from semcal_cli.config import EDGE_BAND_PX, ExactConfig, PolishConfig, PyramidConfig
from semcal_cli.errors import told_apart
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import exact_config, pyramid_factors
from semcal_cli.estimation.uncertainty.covariance import MAX_HALF_WIDTH_DEG, MAX_HALF_WIDTH_M
from semcal_cli.findings.check import CUES_DISAGREE, OTHER_POSE, Measured, fit_of_rival
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displaced
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.observations import Observations
from semcal_cli.result.uncertainty import Uncertainty

NUM_RIVALS, NUM_FRAMES = 16, 5
"""Number of ascents that look for rivals, and of the frames that they use."""
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
    images.

    Args:
        observations: Points and pixels of all cues.
        T_camera_lidar: (4, 4) pose, metres.
        uncertainty: Uncertainty of the pose; None if it is not determined, and only what is far is a rival.
    """
    tops, near = _tops(observations, T_camera_lidar)
    if not observations.is_multimodal and uncertainty is not None:
        for top in near:
            T_top = newton(observations, top, PolishConfig()).T_camera_lidar
            if (np.abs(compare_poses(T_top, T_camera_lidar).offsets) > uncertainty.half_widths).any():
                tops.append(T_top)
    if not tops:
        return ()
    behind, T_rival = min(
        zip(sigmas_behind(observations, T_camera_lidar, tops), tops, strict=True), key=lambda each: each[0]
    )
    away = compare_poses(T_rival, T_camera_lidar)
    found = (
        f"a pose {away.rotation_deg:.1f} degrees and {away.camera_center_cm:.0f} cm away explains the data "
        f"{fit_of_rival(behind, OTHER_POSE.limit(), 1)}"
    )
    return (OTHER_POSE.measured(behind, found),)


def check_guide(guide: Observations, T_camera_lidar: Pose, T_initial: Pose) -> Measured:
    """Check that segments and image labels do not prefer another pose to the one that edges found.

    Args:
        guide: Points and pixels by segments.
        T_camera_lidar: (4, 4) pose by edges, metres.
        T_initial: (4, 4) pose from which edges started.
    """
    rng = np.random.default_rng(0)
    others = [T_initial, *(displaced(T_camera_lidar, OTHERS_DEG, OTHERS_M, rng) for _ in range(NUM_OTHERS))]
    behind = sigmas_behind(guide, T_camera_lidar, others)
    best = int(np.argmin(behind))
    away = compare_poses(others[best], T_camera_lidar)
    ahead, most = told_apart(-behind[best], CUES_DISAGREE.limit(), 1)
    found = (
        f"segments and image labels prefer a pose {away.rotation_deg:.1f} degrees and "
        f"{away.camera_center_cm:.0f} cm from the one that edges found, by {ahead} standard errors, needed at "
        f"most {most}"
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
        ends = core.align(few.core, poses, config, factor=factor, visible_only=True, seed=0)
        far, near = list[Pose](), list[Pose]()
        for end in sorted(ends, key=lambda end: -end.mutual_information):
            away = compare_poses(end.T_camera_lidar, T_camera_lidar)
            # A rival is farther away than a trusted pose may be uncertain.
            is_far = (
                away.rotation_deg > MAX_HALF_WIDTH_DEG or away.camera_center_cm > 100.0 * MAX_HALF_WIDTH_M
            )
            (far if is_far else near).append(end.T_camera_lidar)
        far, near = far[:NUM_COMPARED], near[:NUM_COMPARED]
        poses = far if observations.is_multimodal else far + near
    return far, near


def sigmas_behind(observations: Observations, T_camera_lidar: Pose, rivals: Sequence[Pose]) -> list[float]:
    """Standard errors by which each rival (4, 4) is behind a pose (4, 4); 0 if too few squares are seen to tell."""
    gains = core.information_gains(observations.core, T_camera_lidar, rivals, EDGE_BAND_PX)
    return [-gain.gain / max(gain.sigma, 1e-12) if math.isfinite(gain.sigma) else 0.0 for gain in gains]
