"""An ascent from several starts near the given one, for information that has many tops near the right one."""

from __future__ import annotations

import numpy as np

from semcal_cli import _core
from semcal_cli.config import ExactConfig
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import displaced
from semcal_cli.refinement.exact import ExactEstimator
from semcal_cli.refinement.pyramid import Level

NUM_STARTS = (10, 6, 4, 2)
"""Number of poses from which the first levels are ascended; the last number holds from then on. Of ten runs on a real
jam by segments and intensity, from 2 degrees and 0.2 m, 8 came back with six at first, and 6 from one start."""
FARTHEST_DEG, FARTHEST_M = 6.0, 1.0
"""Poses farther from the given start are dropped: coarse blocks have tops there that beat the right one."""
SPREAD_DEG, SPREAD_M = 1.5, 0.15
"""Distance of the other starts from the given one."""
NUM_ROUNDS = 2
"""Ascents at each level; the points are chosen anew for each."""


class SeveralStarts:
    """Ascends the exact mutual information from several poses, and takes the best at each level."""

    gives_bound = False

    def __init__(self, observations: Observations, config: ExactConfig, seed: int) -> None:
        """Keep what the levels have in common; arguments are those of `ExactEstimator`."""
        single = ExactEstimator(observations, config, seed)
        self.observations, self.config, self.seed = observations, single.config, seed
        self._T_first: Pose | None = None
        self._others: list[Pose] = []
        self._num_levels = 0

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Optimise the pose at one level of the pyramid, as `LevelOptimizer.ascend` describes."""
        if self._T_first is None:
            self._T_first = T_start
            rng = np.random.default_rng(self.seed)
            self._others = [displaced(T_start, SPREAD_DEG, SPREAD_M, rng) for _ in range(NUM_STARTS[0] - 1)]
        num_starts = NUM_STARTS[min(self._num_levels, len(NUM_STARTS) - 1)]
        poses = [T_start, *self._others][:num_starts]
        for _ in range(NUM_ROUNDS):
            ends = _core.align(
                self.observations.core,
                poses,
                self.config,
                factor=factor,
                visible_only=visible_only,
                seed=self.seed,
            )
            poses = [end.T_camera_lidar for end in ends]
        near = [end for end in ends if self._is_near(end.T_camera_lidar)] or ends
        best, *others = sorted(near, key=lambda end: -end.mutual_information)
        self._others = [end.T_camera_lidar for end in others]
        self._num_levels += 1
        return Level(factor, best.T_camera_lidar, best.mutual_information, best.drift, best.num_points)

    def _is_near(self, T_camera_lidar: Pose) -> bool:
        if self._T_first is None:
            return True
        moved = compare_poses(T_camera_lidar, self._T_first)
        return moved.rotation_deg <= FARTHEST_DEG and moved.camera_center_cm <= 100.0 * FARTHEST_M
