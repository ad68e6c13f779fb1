"""Whether another pose near a pose explains the data nearly as well.

The information of edges, segments and intensities has many maxima, and so has that of labels of few frames. Around a
wrong pose they are about as high as its own; around the right one they are lower.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli import core
from semcal_cli.checks.few_scenes import FEW_SCENES
from semcal_cli.checks.wide_interval import MAX_HALF_WIDTH_DEG, MAX_HALF_WIDTH_M
from semcal_cli.config import ExactConfig, PyramidConfig
from semcal_cli.estimation.refine.higher_maxima import ends_elsewhere
from semcal_cli.estimation.refine.pyramid import exact_config, pyramid_factors
from semcal_cli.estimation.uncertainty.information import sigmas_behind
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import ELSEWHERE, describe_rival_fit
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.observations import Observations
from semcal_cli.result.uncertainty import Uncertainty

OTHER_POSE = Check(
    topic="other-pose",
    advice=ELSEWHERE,
    entry=Entry(
        title="Another pose nearby explains the data",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "a pose 2.1 degrees and 24 cm away explains the data only 1.4 standard errors worse; a "
                "trusted pose must beat every other by 3: add frames from other places"
            ),
        ),
        meaning=(
            "The objective has several maxima, and another one, outside the interval or far away, is "
            "about as high."
        ),
        cause=(
            "There are few frames. With a single real frame it nearly always comes up, even with "
            "labels on both sides."
        ),
        remedy="Add frames from other scenes, use edges if the frames name images, or label the points.",
        figure=(
            "How much less information the best other maximum has. The check applies to edges, "
            "segments and intensity, and to labels of fewer than four scenes."
        ),
    ),
)
NUM_RIVALS, NUM_FRAMES = 16, 5
"""Number of ascents that look for rivals, and of the frames that they use."""
NUM_COMPARED = 6
"""Number of the highest maxima that are compared with the pose, by all frames."""
SPREAD_DEG, SPREAD_M = 3.0, 0.3
"""Mean distance of their starts from the pose; the nearest have half of it, and the farthest one and a half."""
FIRST_BESIDE, MORE_BESIDE, BESIDE_DEG, BESIDE_M = 3, 9, 0.3, 0.15
"""Number of poses beside the pose from which edges are polished; of further ones, where one of those ends elsewhere;
and their distance. On three KITTI sets, all return. On a street of KITTI-360, the first end 3.4 to 4.3 standard errors
behind one result, and the best of the further ones 2.4."""
BLOCKS_DEG, FINER = 0.9, 4
"""Blocks of the first level of an ascent; those of the second are finer by this factor."""
CONFIG = ExactConfig(steps=40, max_points=10_000)


def check_rivals(
    observations: Observations,
    T_camera_lidar: Pose,
    uncertainty: Uncertainty | None,
    *,
    with_priors: bool = False,
    known: Sequence[Pose] = (),
) -> tuple[Measured, ...]:
    """Check that no other pose within reach explains the observations nearly as well.

    Labels of enough scenes have one maximum, and priors exclude others, so they are not searched for any.

    A rival lies farther away than a trusted pose may be uncertain, or outside the interval of the pose. Its information
    and that of the pose are compared by the points that are visible at the pose, square by square of the images.

    Args:
        observations: Points and pixels of all cues.
        T_camera_lidar: (4, 4) pose, metres.
        uncertainty: Uncertainty of the pose; None if it is not determined, and only what is far is a rival.
        with_priors: Whether the pose is fused with priors.
        known: (4, 4) rivals that are known beforehand; no others are then searched for.
    """
    rivals = [*known] or _rivals(observations, T_camera_lidar, uncertainty, with_priors=with_priors)
    if not rivals:
        return ()
    sigmas = sigmas_behind(observations, T_camera_lidar, rivals)
    best = int(np.argmin(sigmas))
    behind, away = sigmas[best], compare_poses(rivals[best], T_camera_lidar)
    sentence = (
        f"a pose {away.rotation_deg:.1f} degrees and {away.camera_center_cm:.0f} cm away explains the data "
        f"{describe_rival_fit(behind, OTHER_POSE.limit(), 1)}"
    )
    return (OTHER_POSE.measured(behind, sentence),)


def _rivals(
    observations: Observations, T_camera_lidar: Pose, uncertainty: Uncertainty | None, *, with_priors: bool
) -> list[Pose]:
    """Search for rivals of a pose (4, 4)."""
    has_one_maximum = with_priors or len(set(observations.scenes)) >= FEW_SCENES.limit()
    if not observations.is_multimodal and has_one_maximum:
        return []
    rivals, near = _maxima(observations, T_camera_lidar)
    if uncertainty is None:
        return rivals

    def is_inside(T_end: Pose) -> bool:
        offsets = np.abs(compare_poses(T_end, T_camera_lidar).offsets)
        return bool((offsets <= uncertainty.half_widths).all())

    parts: Sequence[Sequence[Pose]] = (near,)
    if observations.is_multimodal:
        beside = _beside(T_camera_lidar)
        parts = beside[:FIRST_BESIDE], beside[FIRST_BESIDE:]
    for starts in parts:
        ends = ends_elsewhere(observations, starts, is_inside)
        outside = [T_end for T_end in ends if not is_inside(T_end)]
        rivals += outside
        if not outside:
            break
    return rivals


def _beside(T_camera_lidar: Pose) -> list[Pose]:
    """Displace a pose (4, 4) a little, to find maxima beside its own."""
    rng = np.random.default_rng(0)
    return [displace(T_camera_lidar, BESIDE_DEG, BESIDE_M, rng) for _ in range(FIRST_BESIDE + MORE_BESIDE)]


def _maxima(observations: Observations, T_camera_lidar: Pose) -> tuple[list[Pose], list[Pose]]:
    """Ascend from poses around the given one, at two levels of the pyramid, to the highest far and near maxima."""
    rng = np.random.default_rng(0)
    shares = np.linspace(0.5, 1.5, NUM_RIVALS)
    poses = [displace(T_camera_lidar, share * SPREAD_DEG, share * SPREAD_M, rng) for share in shares]
    few = few_frames(observations, NUM_FRAMES)
    coarsest, *_ = pyramid_factors(observations.camera, PyramidConfig(coarsest_block_deg=BLOCKS_DEG))
    config = exact_config(few, CONFIG)
    for factor in (coarsest, max(coarsest // FINER, 1)):
        ends = core.align(few.core, poses, config, factor=factor, visible_only=True, seed=0)
        far, near = list[Pose](), list[Pose]()
        for end in sorted(ends, key=lambda end: -end.value):
            away = compare_poses(end.T_camera_lidar, T_camera_lidar)
            # A rival is farther away than a trusted pose may be uncertain.
            (near if away.is_within(MAX_HALF_WIDTH_DEG, MAX_HALF_WIDTH_M) else far).append(end.T_camera_lidar)
        far, near = far[:NUM_COMPARED], near[:NUM_COMPARED]
        poses = far if observations.is_multimodal else far + near
    return far, near
