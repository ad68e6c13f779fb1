"""Refinement of a pose by gradient ascent on the mutual information of labels (Alg. 1).

Levels of the label pyramid are taken coarse to fine, each from the pose of the one before. How a level is climbed is
the estimator's. With MINE, the weights of a statistics network climb the Donsker-Varadhan bound together with the
twist of the pose (`semcal_cli.refinement.mine`). With discrete labels the bound is reached by a table of pointwise
mutual information, so `ExactClimb` needs no network and no torch.

Every level has the same number of steps, whose lengths fall to a twentieth: on mini-batches, when to stop earlier would
be told by noise. Whether the pose has settled by then is measured, and said.

Overlap: the points of a level are those that lie inside the picture at the level's start, with the weights that they
have there, and while the lens still projects them they keep counting when they leave it, with the class at the nearest
border. So within a level, pushing points out of the picture cannot raise the objective. (A penalty on the share of
points that are left, or a class for "outside", would move the optimum.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Protocol

from semcal_cli import _core
from semcal_cli.config import ExactConfig, PyramidConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.document import Camera
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import CalibrationError
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.stage import Finding, StageResult


@dataclass(frozen=True)
class Level:
    """Where a level of the pyramid ended."""

    factor: int
    """Side of a block in pixels."""
    T_camera_lidar: Pose
    information_nats: float
    """The mutual information, or the Donsker-Varadhan bound, at the level's end."""
    drift: float
    """Blocks between the mean poses of the last two quarters."""
    num_points: int


class Climb(Protocol):
    """An estimator that climbs one level of the pyramid."""

    def __call__(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Climb on blocks of `factor` pixels from a pose; `visible_only` drops hidden points."""


@dataclass(frozen=True, kw_only=True)
class Refinement(StageResult):
    """The refined pose and the way to it. It finds against itself if the pose has not settled."""

    levels: tuple[Level, ...]
    converged: bool


class ExactClimb:
    """Climbs the exact mutual information, in Rust."""

    def __init__(self, observations: Observations, config: ExactConfig, seed: int) -> None:
        self.observations, self.config, self.seed = observations, config, seed

    def __call__(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Climb one level of the pyramid."""
        (end,) = _core.align(
            self.observations.core,
            [T_start],
            self.config,
            factor=factor,
            visible_only=visible_only,
            seed=self.seed,
        )
        return Level(factor, end.T_camera_lidar, end.mutual_information, end.drift, end.num_points)


def refine(
    observations: Observations,
    T_init: Pose,
    climb: Climb,
    config: PyramidConfig,
    on_level: Callable[[Level, int], None] = lambda level, num_levels: None,
    clamp: Callable[[Pose], Pose] = lambda pose: pose,
) -> Refinement:
    """Refine a pose by maximising mutual information.

    Args:
        observations: Labelled points and label images of all frames.
        T_init: (4, 4) T_camera_lidar to start at.
        climb: The estimator.
        config: The pyramid.
        on_level: Called with each level when it ends, and with the number of levels.
        clamp: Brings the pose between levels back to where it may be.

    Raises:
        CalibrationError: too few labelled points land on labelled pixels.
    """
    factors = pyramid_factors(observations.camera, config)
    block_deg = math.degrees(1.0 / core_camera(observations.camera).pixels_per_radian)
    levels: list[Level] = []
    pose = clamp(T_init)
    for factor in factors:
        level = climb(factor, pose, visible_only=factor * block_deg < config.hidden_below_block_deg)
        if level.num_points < config.min_points:
            total = sum(int((cloud.classes != NO_CLASS).sum()) for cloud in observations.clouds)
            raise CalibrationError(
                f"no overlap: {level.num_points} of {total} labelled points land on labelled pixels, "
                f"needed {config.min_points}"
            )
        levels.append(level)
        pose = clamp(level.T_camera_lidar)
        on_level(level, len(factors))
    converged = levels[-1].drift <= config.max_final_drift
    return Refinement(
        T_camera_lidar=pose,
        agreement=_core.agreement(observations.core, pose),
        findings=() if converged else (_not_settled(levels[-1]),),
        settings={"pyramid": asdict(config)},
        levels=tuple(levels),
        converged=converged,
    )


def _not_settled(finest: Level) -> Finding:
    return Finding(
        f"the refinement had not settled: the pose still moved points by {finest.drift:.1f} pixels over the last "
        f"quarters of the finest level"
    )


def pyramid_factors(camera: Camera, config: PyramidConfig) -> list[int]:
    """Block sides in pixels, coarse to fine, down to single pixels."""
    widest = core_camera(camera).pixels_per_radian * math.radians(config.coarsest_block_deg)
    largest = min(widest, camera.width / config.min_blocks, camera.height / config.min_blocks)
    return [2**level for level in range(int(math.log2(max(largest, 1.0))), -1, -1)]
