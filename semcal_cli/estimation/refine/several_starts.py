"""An ascent from several starts around the given pose, for objectives with many maxima near the right one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from semcal_cli import core
from semcal_cli.config import ExactConfig, PolishConfig, PyramidConfig, StartsConfig
from semcal_cli.estimation.refine.higher_maxima import climb, has_other_maxima
from semcal_cli.estimation.refine.polish import newton_from_each
from semcal_cli.estimation.refine.pyramid import Level, exact_config, pyramid_factors
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.observations import Observations

MEETING_DEG, MEETING_M = 0.4, 0.05
"""An end within this distance of a better one is at the same maximum, and is dropped."""
JOINING = 4
"""Side of the blocks, pixels, from which the given poses join at each level; coarser blocks may lead away."""
TIED_SIGMAS = 2.0
"""Standard errors by which a farther maximum must be better than a nearer one. With one frame, maxima differ by
chance."""
NUM_POLISHED = 3
"""Number of the best ends that are polished."""
NEAR_A_MAXIMUM = 0.5
"""A pose is polished if its mutual information is at least this fraction of the best end's. Others are not on the slope
of a comparable maximum."""


class SeveralStarts:
    """Maximises the exact mutual information from several poses, and takes the best at each level.

    The given poses that are near the first remain candidates: they join again from blocks of `JOINING` pixels on. At
    the finest level the best poses and the given ones are polished, so that no given pose is better than the result.

    If the starts have a contrast, it chooses them among many more poses, and coarse levels ascend it. At the finest
    level, the information of a class of points counts negatively where its pixels have lower levels than plain points.
    """

    def __init__(
        self,
        observations: Observations,
        config: ExactConfig,
        seed: int,
        starts: StartsConfig,
        candidates: Sequence[Pose] = (),
    ) -> None:
        """Set up what all levels share.

        Args:
            observations: Points and pixels of all frames.
            config: Steps, mini-batches and limits.
            seed: Seed of the mini-batches and of the starts.
            starts: How many starts there are, and where.
            candidates: (4, 4) poses that stay in the comparison besides the start.
        """
        self.config = exact_config(observations, config)
        self.observations, self.seed, self.starts = observations, seed, starts
        self.given: list[Pose] = list(candidates)
        self.poses: list[Pose] = []
        """Starts of the next level, best first; none before the first level."""
        self._num_levels = 0

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Optimise the pose at one level of the pyramid, as `LevelOptimizer.ascend` describes."""
        observations, starts = self.observations, self.starts
        if self.poses:
            self.poses[0] = T_start  # The best pose, moved to where priors allow it.
        else:
            self._spread_around(T_start, factor)
            if starts.first_frames is not None and observations.num_cues == 1:
                observations = few_frames(observations, starts.first_frames)
        self.poses = self.poses[: starts.num_starts[min(self._num_levels, len(starts.num_starts) - 1)]]
        if factor <= JOINING:
            self.poses += self.given
        self._num_levels += 1
        for _ in range(starts.num_rounds):
            ends = self._align(observations, self.poses, factor, visible_only=visible_only)
            near = [end for end in ends if self._is_near(end.T_camera_lidar)]
            if not near:
                # The level has no maximum within reach; finer levels may have one.
                return Level(factor, T_start, 0.0, ends[0].num_points)
            self.poses = [end.T_camera_lidar for end in _distinct(near)]
            if len(self.poses) < 2:
                break
        best, *_ = self._polished(visible_only=visible_only) if factor == 1 else near
        rng = np.random.default_rng(self.seed)
        has_others = factor == 1 and has_other_maxima(self.observations, starts, best.T_camera_lidar, rng)
        if has_others:
            best = self._higher(best, rng, visible_only)
        return Level(factor, best.T_camera_lidar, near[0].drift, best.num_points, has_other_maxima=has_others)

    def _spread_around(self, T_start: Pose, factor: int) -> None:
        """Choose the starts of the first level around a pose (4, 4), and keep the given poses near it."""
        starts, rng = self.starts, np.random.default_rng(self.seed)
        self.given = [T_start, *self.given]
        self.given = [pose for pose in self.given if self._is_near(pose)]
        num_others = starts.num_starts[0] - 1
        num_drawn = num_others if starts.contrast is None else starts.contrast.num_draws
        distances = zip(
            np.linspace(*starts.spread_deg, num_drawn), np.linspace(*starts.spread_m, num_drawn), strict=True
        )
        drawn = [displace(T_start, *distance, rng) for distance in distances]
        if starts.contrast is not None:
            config = replace(self.config, steps=0, max_points=starts.contrast.max_points)
            compared = self._align(self.observations, drawn, factor, visible_only=False, config=config)
            drawn = [end.T_camera_lidar for end in compared]
        self.poses = [T_start, *drawn[:num_others]]

    def coarse_maximum(self, T_start: Pose) -> Pose:
        """Ascend from several starts around a pose (4, 4) on coarse blocks only, which is fast."""
        for factor in pyramid_factors(self.observations.camera, pyramid_of(self.starts)):
            if factor >= JOINING:
                T_start = self.ascend(factor, T_start, visible_only=False).T_camera_lidar
        return T_start

    def _align(
        self,
        observations: Observations,
        poses: Sequence[Pose],
        factor: int,
        *,
        visible_only: bool,
        config: ExactConfig | None = None,
    ) -> list[core.Aligned]:
        """Ascend from poses (4, 4) and sort the ends, best first; with zero steps the poses are only compared.

        Coarse blocks are ascended by contrast if the starts have one, and far ends then lose some of it.
        """
        if config is None:
            config = self.config if factor == 1 else self.starts.coarse or self.config
        contrast, weights, distance_weight = self.starts.contrast, None, 0.0
        if contrast is not None and factor > 1:
            weights = [contrast.class_weights.get(name, 0.0) for name in observations.point_class_names]
            distance_weight = contrast.distance_weight
        ends = core.align(
            observations.core,
            poses,
            config,
            factor=factor,
            visible_only=visible_only,
            seed=self.seed,
            is_signed=contrast is not None,
            contrast_weights=weights,
        )

        def loss(end: core.Aligned) -> float:
            away, starts = compare_poses(end.T_camera_lidar, self.given[0]), self.starts
            turned = away.rotation_deg / starts.spread_deg[1]
            moved = away.camera_center_m / starts.spread_m[1]
            return distance_weight * (turned**2 + moved**2) - end.value

        return sorted(ends, key=loss)

    def _polished(self, *, visible_only: bool) -> list[core.Aligned]:
        """Polish the best ends and the given poses near a maximum, and sort the result, the chosen pose first.

        The chosen pose is the nearest to the start among those that are not significantly worse than the best, and no
        worse than any given pose. Where information has a sign, it also needs half of that of the best.
        """
        compared = partial(self._compared, visible_only=visible_only)

        def polished(ends: Sequence[core.Aligned]) -> list[core.Aligned]:
            poses = [end.T_camera_lidar for end in ends]
            tops = newton_from_each(self.observations, poses, PolishConfig())
            # A polish may lead too far away.
            near = [top if self._is_near(top) else pose for pose, top in zip(poses, tops, strict=True)]
            return compared(near) if near else []

        def near_a_maximum(ends: Sequence[core.Aligned]) -> list[core.Aligned]:
            return [end for end in ends if end.value >= _near(highest)]

        ends, candidates = compared(self.poses), compared(self.given)
        highest = ends[0].value
        ends = near_a_maximum(ends)[:NUM_POLISHED]
        candidate_ends = [*candidates, *polished(near_a_maximum(candidates))]
        needed = max(end.value for end in candidate_ends)
        ranked = sorted([*polished(ends), *candidate_ends], key=lambda end: -end.value)
        best, *others = [maximum for maximum in _distinct(ranked) if maximum.value >= needed]
        gains = core.information_gains(
            self.observations.core,
            best.T_camera_lidar,
            [other.T_camera_lidar for other in others],
        )
        lowest = -np.inf if self.starts.contrast is None else _near(best.value)
        as_good = [
            other
            for other, gain in zip(others, gains, strict=True)
            if -gain.gain < TIED_SIGMAS * gain.sigma and other.value >= lowest
        ]
        return sorted([best, *as_good], key=lambda maximum: self._distance(maximum.T_camera_lidar))

    def _higher(self, best: core.Aligned, rng: np.random.Generator, visible_only: bool) -> core.Aligned:
        """Search around the best maximum, which is not alone, for a higher one.

        Where information has a sign, the end also needs half of that of the best maximum.
        """
        T_best = best.T_camera_lidar
        T = climb(self.observations, T_best, rng, is_allowed=self._is_near)
        if self.observations.information(T) <= self.observations.information(T_best):
            return best
        (end,) = self._compared([T], visible_only)
        return end if end.value >= _near(best.value) else best

    def _compared(self, poses: Sequence[Pose], visible_only: bool) -> list[core.Aligned]:
        config = replace(self.config, steps=0)
        return self._align(self.observations, poses, 1, visible_only=visible_only, config=config)

    def _distance(self, T_camera_lidar: Pose) -> float:
        """Compute the distance from the start, relative to the farthest starts."""
        away, starts = compare_poses(T_camera_lidar, self.given[0]), self.starts
        return max(away.rotation_deg / starts.spread_deg[1], away.camera_center_m / starts.spread_m[1])

    def _is_near(self, T_camera_lidar: Pose) -> bool:
        return compare_poses(T_camera_lidar, self.given[0]).is_within(
            self.starts.farthest_deg, self.starts.farthest_m
        )


def pyramid_of(starts: StartsConfig) -> PyramidConfig:
    """Return the pyramid of the several starts."""
    return PyramidConfig(coarsest_block_deg=starts.coarsest_block_deg, min_blocks=starts.min_blocks)


def _near(highest: float) -> float:
    """Compute the least information of a pose near a maximum; that with a sign may be negative."""
    return min(NEAR_A_MAXIMUM * highest, highest)


def _distinct(ends: Sequence[core.Aligned]) -> list[core.Aligned]:
    """Drop the ends that are at the same maximum as a better one, best first."""
    kept: list[core.Aligned] = []
    for end in ends:
        poses = [better.T_camera_lidar for better in kept]
        if not any(compare_poses(end.T_camera_lidar, T).is_within(MEETING_DEG, MEETING_M) for T in poses):
            kept.append(end)
    return kept
