"""Higher maxima beside the one that was found, for objectives with many maxima a few pixels apart.

The slope at single pixels does not lead from one maximum to the next. On blocks of a few pixels most of them merge, so
that ascents there, from poses all around, and polishes at full resolution from their ends lead to higher ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.config import ExactConfig, PolishConfig, PyramidConfig, StartsConfig
from semcal_cli.estimation.refine.polish import newton, newton_from_each
from semcal_cli.estimation.refine.pyramid import exact_config, pyramid_factors
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.observations import Observations

BESIDE, FIRST_ROUNDS = ((0.12, 0.032), (0.19, 0.051), (0.26, 0.07)), 2
"""Distances, degrees and metres, of poses beside a maximum, and rounds of the first polishes that start there. Their
ends tell whether the maximum is alone. On three KITTI sets it is, so that nothing is searched there."""
SAME_DEG, SAME_M = 0.05, 0.015
"""Poses within this distance are at the same maximum, or on the way to it. With twice the distance, an earlier climb by
polishes stayed 22 cm off on a street of KITTI-360."""
NUM_POLISHED, MAX_VAIN = 3, 2
"""Number of the best ends of a search that are polished, and of searches in a row that end no higher."""


class _Around(NamedTuple):
    """Poses from which a search ascends: the maximum, and others around it."""

    number: int
    """Number of poses. After a search in vain, the next one has twice as many."""
    spread_deg: tuple[float, float]
    spread_m: tuple[float, float]
    """Distances of the nearest and of the farthest from the maximum."""


MANY_SCENES = 4
"""Number of scenes that are many: that from which poses by edges are trusted."""
CLOSE, WIDE = _Around(12, (0.15, 0.5), (0.06, 0.2)), _Around(24, (0.2, 1.5), (0.05, 0.4))
"""Poses around a maximum of many scenes, and of few, whose maxima lie farther apart (docs/benchmarks_cues.md)."""


@dataclass(frozen=True)
class ClimbConfig:
    """How many searches follow one another, and how far their ends are polished.

    On a street of KITTI-360, from 16 poses 0.25 degrees and 15 cm off, two searches lead 13 to the highest maximum, and
    searches until two are in vain all 16. One search with polishes to their end takes as long as two, and leads 7 there
    (`tests/benchmarks/higher_maxima.py`).
    """

    max_searches: int = 8
    """Largest number of searches, each around the highest maximum so far."""
    rounds: int = 1
    """Rounds of the polishes from the best ends of a search."""


CLIMB = ClimbConfig()


def has_other_maxima(
    observations: Observations, starts: StartsConfig | None, T_camera_lidar: Pose, rng: np.random.Generator
) -> bool:
    """Whether polishes from poses beside a maximum lead to others, so that higher ones are to be searched for.

    The polish prefers a pose that may be a little beside the maximum of the information. Polishes that do not lead back
    at once, but end where the polish of the maximum itself ends, also count as having returned.

    Args:
        observations: Points and pixels of all frames.
        starts: Starts of the search for the maximum, which state whether others are searched for; None for one start.
        T_camera_lidar: (4, 4) maximum, metres.
        rng: Source of the poses beside it.
    """
    if starts is None or not starts.searches_beside:
        return False
    beside = [displace(T_camera_lidar, *distance, rng) for distance in BESIDE]

    def is_back(T_end: Pose) -> bool:
        return compare_poses(T_end, T_camera_lidar).is_within(SAME_DEG, SAME_M)

    ends = ends_elsewhere(observations, beside, is_back)
    if not ends:
        return False
    T_polished = _polish(observations, T_camera_lidar)
    if not compare_poses(T_polished, T_camera_lidar).is_within(2.0 * SAME_DEG, 2.0 * SAME_M):
        return True
    return any(not compare_poses(T, T_polished).is_within(SAME_DEG, SAME_M) for T in ends)


def ends_elsewhere(
    observations: Observations, poses: Sequence[Pose], is_back: Callable[[Pose], bool]
) -> list[Pose]:
    """Polish poses beside a maximum, and return the ends (4, 4) of those that do not lead back to it at once.

    Args:
        observations: Points and pixels of all frames.
        poses: (4, 4) poses beside the maximum, metres.
        is_back: Function that tells whether a pose (4, 4) is at the maximum.
    """
    ends = newton_from_each(observations, poses, PolishConfig(max_rounds=FIRST_ROUNDS))
    return newton_from_each(observations, [T for T in ends if not is_back(T)], PolishConfig())


def climb(
    observations: Observations,
    T_camera_lidar: Pose,
    rng: np.random.Generator,
    config: ClimbConfig = CLIMB,
    is_allowed: Callable[[Pose], bool] = lambda pose: True,
) -> Pose:
    """Search around a maximum for a higher one, then around that, until two searches in a row find none.

    Args:
        observations: Points and pixels of all frames. Where they are few scenes, it is searched farther around.
        T_camera_lidar: (4, 4) maximum, metres.
        rng: Source of the poses and mini-batches.
        config: Number of searches, and how their ends are polished.
        is_allowed: Function that tells whether a pose (4, 4) is near enough.

    Returns:
        The highest maximum (4, 4) found; the given pose if none is higher.
    """
    around = CLOSE if len(set(observations.scenes)) >= MANY_SCENES else WIDE
    T_highest, num_vain = T_camera_lidar, 0
    for _ in range(config.max_searches):
        more = around._replace(number=around.number << num_vain)
        T = _search(observations, T_highest, more, rng, config.rounds, is_allowed)
        num_vain = num_vain + 1 if compare_poses(T, T_highest).is_within(SAME_DEG, SAME_M) else 0
        T_highest = T
        if num_vain == MAX_VAIN:
            break
    T_polished = _polish(observations, T_highest)
    ends = [T_highest, *filter(is_allowed, [T_polished])]
    return max(ends, key=observations.information)


def _search(
    observations: Observations,
    T_camera_lidar: Pose,
    around: _Around,
    rng: np.random.Generator,
    rounds: int,
    is_allowed: Callable[[Pose], bool],
) -> Pose:
    """Ascend from a maximum (4, 4) and poses around it, and return the highest end, or the maximum itself."""
    angles_deg, distances_m = (
        np.linspace(*spread, around.number - 1) for spread in (around.spread_deg, around.spread_m)
    )
    beside = [displace(T_camera_lidar, *away, rng) for away in zip(angles_deg, distances_m, strict=True)]
    coarse = None if observations.starts is None else observations.starts.coarse
    config = exact_config(observations, coarse or ExactConfig())
    # On single pixels, ascents would end at the maxima that polishes end at.
    factor = max(pyramid_factors(observations.camera, PyramidConfig())[0], 2)
    ends = core.align(
        observations.core,
        [T_camera_lidar, *beside],
        config,
        factor=factor,
        visible_only=True,
        seed=int(rng.integers(2**31)),
    )
    ends = sorted(ends, key=lambda end: end.value, reverse=True)
    best = [end.T_camera_lidar for end in ends if is_allowed(end.T_camera_lidar)][:NUM_POLISHED]
    polished = newton_from_each(observations, best, PolishConfig(max_rounds=rounds))
    return max([T_camera_lidar, *filter(is_allowed, polished)], key=observations.information)


def _polish(
    observations: Observations, T_camera_lidar: Pose, max_rounds: int = PolishConfig.max_rounds
) -> Pose:
    return newton(observations, T_camera_lidar, PolishConfig(max_rounds=max_rounds)).T_camera_lidar
