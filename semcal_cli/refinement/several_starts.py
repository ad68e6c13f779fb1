"""An ascent from several starts near the given one, for information that has many tops near the right one."""

from __future__ import annotations

import numpy as np

from semcal_cli import _core
from semcal_cli.config import ExactConfig
from semcal_cli.drive.frame_selection import few_frames
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import displaced
from semcal_cli.refinement.exact import ExactEstimator
from semcal_cli.refinement.pyramid import Level

NUM_STARTS = (10, 6, 4, 2)
"""Number of poses from which the first levels are ascended; the last number holds from then on. Of ten runs on a real
jam by segments and intensity, from 2 degrees and 0.2 m, 8 came back with six at first, and 6 from one start."""
FIRST_FRAMES = 6
"""Number of frames by which the first level is ascended by segments alone: it only has to tell where tops are."""
MEETING_DEG, MEETING_M = 0.4, 0.05
"""Ends of ascents that are nearer to a better one than this have met it, and do not go on."""
FARTHEST_DEG, FARTHEST_M = 6.0, 1.0
"""Poses farther from the given start are dropped: coarse blocks have tops there that beat the right one."""
SPREAD_DEG, SPREAD_M = 1.5, 0.15
"""Distance of the other starts from the given one."""
NUM_ROUNDS = 2
"""Ascents at each level while starts lead to different tops; the points are chosen anew for each."""


class SeveralStarts:
    """Ascends the exact mutual information from several poses, and takes the best at each level."""

    def __init__(self, observations: Observations, config: ExactConfig, seed: int) -> None:
        """Keep what the levels have in common; arguments are those of `ExactEstimator`."""
        single = ExactEstimator(observations, config, seed)
        self.observations, self.config, self.seed = observations, single.config, seed
        self._T_first: Pose | None = None
        self.others: list[Pose] = []
        """Poses besides the best one from which the next level is ascended, best first."""
        self._num_levels = 0

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Optimise the pose at one level of the pyramid, as `LevelOptimizer.ascend` describes."""
        observations = self.observations
        if self._T_first is None:
            self._T_first = T_start
            rng = np.random.default_rng(self.seed)
            self.others = [displaced(T_start, SPREAD_DEG, SPREAD_M, rng) for _ in range(NUM_STARTS[0] - 1)]
            if observations.num_cues == 1:
                observations = few_frames(observations, FIRST_FRAMES)
        poses = [T_start, *self.others][: NUM_STARTS[min(self._num_levels, len(NUM_STARTS) - 1)]]
        for _ in range(NUM_ROUNDS):
            ends = _core.align(
                observations.core,
                poses,
                self.config,
                factor=factor,
                visible_only=visible_only,
                seed=self.seed,
            )
            found = [end for end in ends if self._is_near(end.T_camera_lidar)]
            found.sort(key=lambda end: -end.mutual_information)
            poses = _apart([end.T_camera_lidar for end in found])
            if len(poses) < 2:
                break
        self._num_levels += 1
        if not found:
            # The level has no top within reach; finer ones may have.
            return Level(factor, T_start, 0.0, ends[0].num_points)
        self.others = poses[1:]
        return Level(factor, poses[0], found[0].drift, found[0].num_points)

    def _is_near(self, T_camera_lidar: Pose) -> bool:
        return self._T_first is None or _is_within(T_camera_lidar, self._T_first, FARTHEST_DEG, FARTHEST_M)


def _apart(poses: list[Pose]) -> list[Pose]:
    """Keep the poses that are not at a better one, best first."""
    kept: list[Pose] = []
    for pose in poses:
        if not any(_is_within(pose, better, MEETING_DEG, MEETING_M) for better in kept):
            kept.append(pose)
    return kept


def _is_within(T_camera_lidar: Pose, T_other: Pose, angle_deg: float, distance_m: float) -> bool:
    away = compare_poses(T_camera_lidar, T_other)
    return away.rotation_deg <= angle_deg and away.camera_center_cm <= 100.0 * distance_m
