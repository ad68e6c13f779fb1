"""The exact mutual information of labels, maximised over SE(3) in Rust: no network and no torch.

`refine_exactly` is the way in for what is assessed: other focal lengths and clocks, parts of a drive, single frames.
"""

from __future__ import annotations

from dataclasses import replace

from semcal_cli import _core
from semcal_cli.config import ExactConfig, PyramidConfig
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import SemcalError
from semcal_cli.geometry.poses import Pose
from semcal_cli.refinement.pyramid import Level, Refinement, refine_pose

SEGMENT_SHARE = 2
"""Segments are compared by this part of the points, since only those near the picture are looked at."""


class ExactEstimator:
    """Ascends the exact mutual information of discrete labels, level by level.

    For discrete labels the Donsker-Varadhan bound is reached by a table of pointwise mutual information, so that there
    is no statistics network to learn.
    """

    def __init__(self, observations: Observations, config: ExactConfig, seed: int) -> None:
        """Keep what the levels have in common.

        Args:
            observations: Labelled points and label images of all frames.
            config: Steps, mini-batches and limits.
            seed: Seed of the mini-batches.
        """
        self.config = exact_config(observations, config)
        self.observations, self.seed = observations, seed

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Optimise the pose at one level of the pyramid, as `LevelOptimizer.ascend` describes."""
        end = _core.ascend(
            self.observations.core,
            T_start,
            self.config,
            factor=factor,
            visible_only=visible_only,
            seed=self.seed,
        )
        return Level(factor, end.T_camera_lidar, end.drift, end.num_points)


def exact_config(observations: Observations, config: ExactConfig) -> ExactConfig:
    """Adapt settings to the cue: a segment has few points of a mini-batch, so that each step takes all points."""
    if not observations.has_segments:
        return config
    num_points = config.max_points // SEGMENT_SHARE
    return replace(config, batch_size=num_points, max_points=num_points)


def refine_exactly(
    observations: Observations, T_init: Pose, exact: ExactConfig, pyramid: PyramidConfig
) -> Refinement | None:
    """Refine a pose (4, 4); None if the lens does not reach the points, or no point is left in the image."""
    try:
        return refine_pose(observations, T_init, ExactEstimator(observations, exact, seed=0), pyramid)
    except SemcalError:
        return None
