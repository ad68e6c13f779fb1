"""Refinement of a pose by gradient ascent on the mutual information of labels (Alg. 1).

The statistics network's weights theta and the twist v of the pose climb the Donsker-Varadhan bound together, each at
its own learning rate, over mini-batches drawn from all frames. Levels of the label pyramid are taken coarse to fine; a
level starts at the pose of the one before, which also chooses the points it uses.

Overlap: the points of a level are those that lie inside the picture at the level's start, and they keep counting when
they leave it, with the class at the nearest border. So within a level, pushing points out of the picture cannot raise
the objective.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from semcal_cli import _core
from semcal_cli.camera import core_camera
from semcal_cli.classes import NO_CLASS
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.mine import DonskerVaradhan, StatisticsNetwork
from semcal_cli.observations import Observations
from semcal_cli.poses import Pose, nearest_rigid
from semcal_cli.projection import Projection
from semcal_cli.sampling import ShareMaps
from semcal_cli.se3 import exp_se3

TORCH_THREADS = 1
"""Fixed, because sums over threads round differently: results must not depend on the machine's cores. One, because
on mini-batches of this size a second thread gains little, and waits ten times over where other work shares the cores.
"""


MIN_SHARE = 0.02
"""Below this a pair's labelled share is too small to divide by; its weight is as small."""


@dataclass(frozen=True)
class RefinementConfig:
    """Defaults of Alg. 1.

    Steps of the pose are in units of the level's blocks (a rotation that moves a point by one block, and the
    translation that moves a point at the median range as far), so that they fit any lens, picture and scene.
    """

    coarsest_block_deg: float = 3.0
    """The pyramid starts at the largest power-of-two block below this angle ..."""
    min_blocks: int = 16
    """... of which this many fit along either side of the picture."""
    steps_per_level: int = 150
    warm_up_steps: int = 50
    """Steps in which only theta learns: at the first level; later levels take a third of it."""
    batch_size: int = 4096
    num_hidden: int = 48
    learning_rate_theta: float = 5e-3
    learning_rate_pose: float = 0.1
    final_rate: float = 0.05
    """The scheduler lowers the pose's rate along a cosine to this share at each level's end."""
    mean_decay: float = 0.9
    """Of the running mean in the bias-corrected gradient."""
    hidden_below_block_deg: float = 0.45
    """Points that the camera cannot see are dropped at levels finer than this; while the pose is coarse, who is
    hidden is not known well enough."""
    min_points: int = 100
    max_final_drift: float = 0.5
    """Converged means that the mean pose of the last quarter of the finest level lies within so many blocks of that
    of the quarter before. A pose that runs straight on covers 0.75 of them."""


@dataclass(frozen=True)
class Level:
    """Where a level of the pyramid ended."""

    factor: int
    """Side of a block in pixels."""
    T_camera_lidar: Pose
    bound_nats: float
    """The Donsker-Varadhan bound at the level's end."""
    drift: float
    """Blocks between the mean poses of the last two quarters."""
    num_points: int


@dataclass(frozen=True)
class Refinement:
    """The refined pose and the way to it."""

    T_camera_lidar: Pose
    levels: tuple[Level, ...]
    converged: bool


@dataclass(frozen=True)
class _Points:
    """The labelled points of a level, over all frames."""

    positions: Tensor
    """(N, 3) float64, metres, LiDAR frame."""
    classes: Tensor
    """(N,) int64."""
    frames: Tensor
    """(N,) int64."""


def refine(
    observations: Observations,
    T_init: Pose,
    config: RefinementConfig,
    seed: int,
    device: str = "cpu",
    on_level: Callable[[Level, int], None] = lambda level, num_levels: None,
) -> Refinement:
    """Refine a pose by maximising mutual information.

    Args:
        observations: Labelled points and label images of all frames.
        T_init: (4, 4) T_camera_lidar to start at.
        config: Learning rates, steps and pyramid.
        seed: Of the network's first weights and of the mini-batches.
        device: `cpu` or `cuda`.
        on_level: Called with each level when it ends, and with the number of levels.

    Raises:
        CalibrationError: too few labelled points land on labelled pixels.
    """
    torch.set_num_threads(TORCH_THREADS)
    climb = _Climb(observations, config, seed, torch.device(device))
    factors = pyramid_factors(observations, config)
    levels: list[Level] = []
    pose = T_init
    for factor in factors:
        levels.append(climb.level(factor, pose))
        pose = levels[-1].T_camera_lidar
        on_level(levels[-1], len(factors))
    return Refinement(pose, tuple(levels), levels[-1].drift <= config.max_final_drift)


def check_device(device: str) -> None:
    """Check that torch can compute on a device.

    Raises:
        InputError: it is `cuda` and there is none.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: PyTorch finds no CUDA device here")


def pyramid_factors(observations: Observations, config: RefinementConfig) -> list[int]:
    """Block sides in pixels, coarse to fine, down to single pixels."""
    camera = observations.camera
    widest = camera.K[0][0] * math.radians(config.coarsest_block_deg)
    largest = min(widest, camera.width / config.min_blocks, camera.height / config.min_blocks)
    return [2**level for level in range(int(math.log2(max(largest, 1.0))), -1, -1)]


def without_round_off(T_camera_lidar: Tensor) -> Pose:
    """The rigid transform next to a product of matrix exponentials."""
    pose = nearest_rigid(T_camera_lidar.cpu().numpy())
    pose[3] = 0.0, 0.0, 0.0, 1.0
    return pose


class _Climb:
    """What the levels share: network, bound, projection and random numbers."""

    def __init__(
        self, observations: Observations, config: RefinementConfig, seed: int, device: torch.device
    ) -> None:
        self.observations, self.config, self.device = observations, config, device
        self.generator = torch.Generator().manual_seed(seed)
        self.projection = Projection(observations.camera).to(device)
        self.num_classes = len(observations.point_class_names), len(observations.image_class_names)
        self.network = StatisticsNetwork(*self.num_classes, config.num_hidden, self.generator).to(device)
        self.bound = DonskerVaradhan(config.mean_decay)
        self.theta = torch.optim.Adam(self.network.parameters(), config.learning_rate_theta)
        self.focal = observations.camera.K[0][0]
        self.warm_up_steps = config.warm_up_steps

    def level(self, factor: int, T_start: Pose) -> Level:
        """Climb one level of the pyramid."""
        config = self.config
        points = self._points(factor, T_start)
        maps = ShareMaps(self.observations.image_classes, self.num_classes[1], factor).to(self.device)
        anchor = torch.from_numpy(T_start).to(self.device)
        ranges = (points.positions @ anchor[:3, :3].T + anchor[:3, 3]).norm(dim=1)
        unit = torch.ones(6, dtype=torch.float64, device=self.device)
        unit[:3] = ranges.median()
        unit *= factor / self.focal
        v = torch.zeros(6, dtype=torch.float64, device=self.device, requires_grad=True)
        pose = torch.optim.Adam([v], config.learning_rate_pose, betas=(0.9, 0.99))
        bounds, path = [], []
        for rate in self._rates():
            pose.param_groups[0]["lr"] = config.learning_rate_pose * rate
            T = exp_se3(v * unit) @ anchor
            bounds.append(self._step(points, maps, T))
            self.theta.step()
            if rate > 0.0:
                pose.step()
                path.append(v.detach().clone())
            pose.zero_grad()
            self.theta.zero_grad()
        quarter = len(path) // 4
        before, last = torch.stack(path[-2 * quarter :]).view(2, quarter, 6).mean(1)
        return Level(
            factor=factor,
            T_camera_lidar=without_round_off(exp_se3(path[-1] * unit) @ anchor),
            bound_nats=float(torch.stack(bounds[-quarter:]).mean()),
            drift=float((last - before).norm()),
            num_points=len(points.classes),
        )

    def _rates(self) -> Iterator[float]:
        """The scheduler: zero while theta warms up, then a falling cosine."""
        config = self.config
        yield from [0.0] * self.warm_up_steps
        self.warm_up_steps = config.warm_up_steps // 3
        for step in range(config.steps_per_level):
            cosine = 0.5 * (1.0 + math.cos(math.pi * step / config.steps_per_level))
            yield config.final_rate + (1.0 - config.final_rate) * cosine

    def _step(self, points: _Points, maps: ShareMaps, T_camera_lidar: Tensor) -> Tensor:
        """One mini-batch: accumulate the gradients of theta and v, return the bound."""
        chosen = torch.randint(len(points.classes), (self.config.batch_size,), generator=self.generator)
        chosen = chosen.to(self.device)
        positions, x = points.positions[chosen], points.classes[chosen]
        pixels, _ = self.projection(positions @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3])
        shares = maps.sample(points.frames[chosen], pixels)
        # Pixels without a class leave a share of less than one: it is the pair's weight, and no class of its own.
        weights = shares.detach().sum(1)
        y = shares / shares.sum(1, keepdim=True).clamp_min(MIN_SHARE)
        p_x = torch.bincount(x, weights, minlength=self.num_classes[0]) / weights.sum()
        bound: Tensor
        bound, ascent = self.bound(self.network(y), x, p_x, weights)
        (-ascent).backward()
        return bound

    def _points(self, factor: int, T_camera_lidar: Pose) -> _Points:
        """The labelled points on labelled pixels at the level's start; at fine levels only visible ones."""
        drop_hidden = math.degrees(factor / self.focal) < self.config.hidden_below_block_deg
        camera = core_camera(self.observations.camera)
        kept = [
            self._on_picture(camera, i, T_camera_lidar, drop_hidden)
            for i in range(self.observations.num_frames)
        ]
        positions = np.concatenate([p[k] for p, k in zip(self.observations.points, kept, strict=True)])
        classes = np.concatenate([c[k] for c, k in zip(self.observations.point_classes, kept, strict=True)])
        if len(classes) < self.config.min_points:
            total = sum(int((c != NO_CLASS).sum()) for c in self.observations.point_classes)
            raise CalibrationError(
                f"no overlap: {len(classes)} of {total} labelled points land on labelled pixels, "
                f"needed {self.config.min_points}"
            )
        frames = np.repeat(np.arange(len(kept)), [int(k.sum()) for k in kept])
        return _Points(
            torch.from_numpy(positions).double().to(self.device),
            torch.from_numpy(classes).long().to(self.device),
            torch.from_numpy(frames).to(self.device),
        )

    def _on_picture(
        self, camera: _core.Camera, frame: int, T_camera_lidar: Pose, drop_hidden: bool
    ) -> npt.NDArray[np.bool_]:
        pixels, _, hidden = _core.land(camera, self.observations.points[frame], T_camera_lidar)
        inside = ~np.isnan(pixels[:, 0])
        u, v = np.floor(pixels[inside].T + 0.5).astype(np.int64)
        keep: npt.NDArray[np.bool_] = inside & (self.observations.point_classes[frame] != NO_CLASS)
        keep[inside] &= self.observations.image_classes[frame][v, u] != NO_CLASS
        return keep & ~hidden if drop_hidden else keep
