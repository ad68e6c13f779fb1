"""The label pyramid: a pose is optimised level by level, coarse to fine, each from the previous level's pose (Alg. 1).

The estimator defines the objective of a level: the exact mutual information of labels, in Rust, or the Donsker-Varadhan
bound of a statistics network (`refine.mine`). `refine_exactly` is the entry for assessments: other focal
lengths and time offsets, parts of a drive, single frames.

Every level has the same number of steps, whose lengths decrease to a twentieth, because on mini-batches noise would
decide when to stop earlier. Whether the pose has settled by then is measured.

Overlap: the points of a level are those inside the image at its start, with the weights that they have there. A point
that leaves the image keeps counting, with the class at the nearest border, as long as the lens projects it. Within a
level, pushing points out of the image therefore cannot raise the objective. (A penalty on the fraction of remaining
points, or a class for "outside", would move the optimum.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Protocol

from semcal_cli import core
from semcal_cli.config import ExactConfig, PyramidConfig
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.errors import CalibrationError, SemcalError
from semcal_cli.estimation.stage import StageResult
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import NO_CLASS, Observations


@dataclass(frozen=True)
class Level:
    """End of a level of the pyramid."""

    factor: int
    """Side of a block in pixels."""
    T_camera_lidar: Pose
    """(4, 4) float64, p_camera = T_camera_lidar @ p_lidar."""
    drift: float
    """Blocks between the mean poses of the last two quarters of the level's steps."""
    num_points: int
    """Number of points chosen at the level's start."""
    bound_nats: float | None = None
    """The Donsker-Varadhan bound at the level's end, where a network estimates it."""
    has_other_maxima: bool = False
    """Whether the best maximum had others beside it before higher ones were searched for; False if not known."""


class LevelOptimizer(Protocol):
    """An estimator of mutual information that optimises the pose at one level of the pyramid."""

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Maximise the estimate over the pose by gradient ascent.

        Args:
            factor: Side of the level's blocks in pixels.
            T_start: (4, 4) float64, T_camera_lidar at which the level starts and its points are chosen.
            visible_only: Whether points that the camera cannot see are dropped.

        Returns:
            The end of the level. With too few points, it ends at `T_start`.
        """


@dataclass(frozen=True, kw_only=True)
class Refinement(StageResult):
    """The refined pose and its levels."""

    levels: tuple[Level, ...]
    max_drift: float
    """Largest drift of the finest level, in blocks, at which the pose counts as settled."""
    converged: bool


def refine_pose(
    observations: Observations,
    T_init: Pose,
    optimizer: LevelOptimizer,
    config: PyramidConfig,
    on_level: Callable[[int, int], None] = lambda num_done, num_levels: None,
    clamp: Callable[[Pose], Pose] = lambda pose: pose,
) -> Refinement:
    """Refine a pose by maximising mutual information over the levels of the pyramid.

    Args:
        observations: Labelled points and label images of all frames.
        T_init: (4, 4) float64, T_camera_lidar at which the coarsest level starts.
        optimizer: The estimator of mutual information.
        config: The pyramid.
        on_level: Called with the number of levels that are done, and of all.
        clamp: A map from poses to the nearest allowed poses, applied before and after each level.

    Returns:
        The pose after the finest level, with all levels.

    Raises:
        CalibrationError: too few points land on pixels that they can be compared with.
    """
    factors = pyramid_factors(observations.camera, config)
    block_deg = math.degrees(1.0 / core_camera(observations.camera).pixels_per_radian)
    levels: list[Level] = []
    pose = clamp(T_init)
    for factor in factors:
        level = optimizer.ascend(
            factor, pose, visible_only=factor * block_deg < config.hidden_below_block_deg
        )
        if level.num_points < config.min_points:
            total = sum(int((cloud.classes != NO_CLASS).sum()) for cloud in observations.clouds)
            problem = "too few points" if total < config.min_points else "no overlap"
            raise CalibrationError(
                f"{problem}: {level.num_points} of {total} points land on pixels that can be compared with "
                f"them, needed {config.min_points}"
            )
        levels.append(level)
        pose = clamp(level.T_camera_lidar)
        on_level(len(levels), len(factors))
    converged = levels[-1].drift <= config.max_final_drift
    return Refinement(
        T_camera_lidar=pose,
        agreement=core.agreement(observations.core, pose),
        bound_nats=levels[-1].bound_nats,
        settings={"pyramid": asdict(config)},
        note="" if converged else "still moving at the end",
        details=f"{len(levels)} levels, {'settled' if converged else 'not settled'}",
        levels=tuple(levels),
        max_drift=config.max_final_drift,
        converged=converged,
    )


def pyramid_factors(camera: Camera, config: PyramidConfig) -> list[int]:
    """List the sides of the levels' blocks in pixels: powers of two, coarse to fine, down to 1."""
    widest = core_camera(camera).pixels_per_radian * math.radians(config.coarsest_block_deg)
    largest = min(widest, camera.width / config.min_blocks, camera.height / config.min_blocks)
    return [2**level for level in range(int(math.log2(max(largest, 1.0))), -1, -1)]


class ExactEstimator:
    """Maximises the exact mutual information of discrete labels, level by level.

    For discrete labels, a table of pointwise mutual information attains the Donsker-Varadhan bound, so that no
    statistics network is needed.
    """

    def __init__(self, observations: Observations, config: ExactConfig, seed: int) -> None:
        """Set up what all levels share.

        Args:
            observations: Labelled points and label images of all frames.
            config: Steps, mini-batches and limits.
            seed: Seed of the mini-batches.
        """
        self.config = exact_config(observations, config)
        self.observations, self.seed = observations, seed

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Optimise the pose at one level of the pyramid, as `LevelOptimizer.ascend` describes."""
        end = core.ascend(
            self.observations.core,
            T_start,
            self.config,
            factor=factor,
            visible_only=visible_only,
            seed=self.seed,
        )
        return Level(factor, end.T_camera_lidar, end.drift, end.num_points)


def exact_config(observations: Observations, config: ExactConfig) -> ExactConfig:
    """Adapt settings to the cue: a mini-batch has too few points of a segment, so each step takes all points."""
    if not observations.has_partitions:
        return config
    return replace(config, batch_size=config.max_points)


def refine_exactly(
    observations: Observations, T_init: Pose, exact: ExactConfig, pyramid: PyramidConfig
) -> Refinement | None:
    """Refine a pose (4, 4) by the exact estimator; None if the refinement fails, for instance without overlap."""
    try:
        return refine_pose(observations, T_init, ExactEstimator(observations, exact, seed=0), pyramid)
    except SemcalError:
        return None
