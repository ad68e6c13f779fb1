"""An ascent from several starts near the given one, for information that has many tops near the right one."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from semcal_cli import _core
from semcal_cli.config import ExactConfig
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose, camera_center
from semcal_cli.refinement.exact import ExactEstimator
from semcal_cli.refinement.pyramid import Level

NUM_STARTS = (6, 4, 2)
"""Number of poses from which the first levels are ascended, and one from then on. On a real jam, 10 of 10 runs by
segments and intensity from 2 degrees and 0.2 m come back with them, and 6 of 10 from one start."""
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
        self._others: list[Pose] = []
        self._num_levels = 0

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Optimise the pose at one level of the pyramid, as `LevelOptimizer.ascend` describes."""
        if self._num_levels == 0:
            rng = np.random.default_rng(self.seed)
            self._others = [_nearby(T_start, rng) for _ in range(NUM_STARTS[0] - 1)]
        num_starts = [*NUM_STARTS, 1][min(self._num_levels, len(NUM_STARTS))]
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
        best, *others = sorted(ends, key=lambda end: -end.mutual_information)
        self._others = [end.T_camera_lidar for end in others]
        self._num_levels += 1
        return Level(factor, best.T_camera_lidar, best.mutual_information, best.drift, best.num_points)


def _nearby(T_camera_lidar: Pose, rng: np.random.Generator) -> Pose:
    """Turn a camera about a random axis, and move its centre in a random direction."""
    axis, direction = (each / np.linalg.norm(each) for each in rng.standard_normal((2, 3)))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(SPREAD_DEG) * axis).as_matrix() @ T_camera_lidar[:3, :3]
    T[:3, 3] = -T[:3, :3] @ (camera_center(T_camera_lidar) + SPREAD_M * direction)
    return T
