"""MINE: a network's lower bound on mutual information, maximised over the network and the pose together (Alg. 1).

The code names the steps of Alg. 1 where it takes them. The bound is in `refine.statistics_network` (eq. 5), the
matrix exponential in `refine.torch_geometry` (eq. 3).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor

from semcal_cli import core
from semcal_cli.config.mine_config import MineConfig
from semcal_cli.errors import InputError
from semcal_cli.estimation.refine.level_points import FeaturePoints, LabelledPoints, feature_vectors
from semcal_cli.estimation.refine.pyramid import Level
from semcal_cli.estimation.refine.statistics_network import (
    Adam,
    DonskerVaradhan,
    SeparableNetwork,
    StatisticsNetwork,
)
from semcal_cli.estimation.refine.torch_geometry import exp_se3
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import nearest_rigid, within_baseline
from semcal_cli.observations.observations import Observations

TORCH_THREADS = 1
"""Fixed, because sums over threads round differently and results must not depend on the number of cores. One, because
a second thread gains little on mini-batches of this size, and makes them ten times slower where the cores are busy.
"""


class MineEstimator:
    """Maximises the Donsker-Varadhan bound over theta and the twist v of the pose, each with its own learning rate.

    A step draws one mini-batch from all frames, so its cost does not depend on their number. Observations are compared
    by their features if they have some, and otherwise by their labels. Theta is kept from level to level.
    """

    def __init__(
        self, observations: Observations, config: MineConfig, seed: int, device: str = "cpu"
    ) -> None:
        """Set up the network, its optimiser and random numbers.

        Args:
            observations: Points and images of all frames.
            config: Network, learning rates, scheduler and mini-batches.
            seed: Seed of the network's weights and of the mini-batches.
            device: Device that runs the network: `cpu` or `cuda`.

        Raises:
            InputError: the device is `cuda` and there is none.
        """
        check_device(device)
        self.observations, self.config, self.device = observations, config, torch.device(device)
        self.generator = torch.Generator().manual_seed(seed)
        # Alg. 1: initialise theta; learning rates and optimisers are MineConfig's and Adam.
        self.network = self._make_network().to(self.device)
        self.bound = DonskerVaradhan(config.mean_decay)
        self.theta = Adam(self.network.parameters(), config.learning_rate_theta)
        self.num_warm_up = config.warm_up_steps

    def ascend(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Optimise the pose at one level of the pyramid, as `LevelOptimizer.ascend` describes.

        Raises:
            CalibrationError: no labelled point of a mini-batch is still on a labelled pixel.
        """
        with _fixed_threads():
            # The core also computes how points with features move: their labels are the codes of the features.
            anchored = core.AnchoredPoints(
                self.observations.core,
                T_start,
                factor=factor,
                visible_only=visible_only,
                max_points=self.config.max_points,
                constant_radius=self.config.constant_radius,
            )
            points: LabelledPoints | FeaturePoints
            if isinstance(self.network, StatisticsNetwork):
                points = LabelledPoints(anchored, self.network, self.device)
            else:
                points = FeaturePoints(
                    self.observations,
                    self.network,
                    self.device,
                    factor=factor,
                    anchor=T_start,
                    visible_only=visible_only,
                )
            if len(points) < self.config.min_points:
                return Level(factor, T_start, math.inf, len(points))
            preconditioner = torch.from_numpy(anchored.preconditioner)
            return self._optimize(points, factor, torch.from_numpy(T_start), preconditioner)

    def _make_network(self) -> StatisticsNetwork | SeparableNetwork:
        observations, config = self.observations, self.config
        if observations.has_vectors:
            point_vectors, pixel_vectors = feature_vectors(observations)[0]
            return SeparableNetwork(point_vectors.shape[-1], pixel_vectors.shape[-1], config, self.generator)
        num_classes = len(observations.point_class_names), len(observations.image_class_names)
        return StatisticsNetwork(*num_classes, config.num_hidden, self.generator)

    def _optimize(
        self, points: LabelledPoints | FeaturePoints, factor: int, anchor: Tensor, preconditioner: Tensor
    ) -> Level:
        """Take the steps of a level from its anchor pose (4, 4) float64.

        `preconditioner` is (6, 6) float64: its columns are twists that each move the points by one block, independently
        of one another. The pose is `exp(preconditioner @ v) @ anchor` (eq. 3).
        """
        config = self.config
        # Alg. 1: initialise the twist. Each level's v starts at zero, from the pose of the previous level.
        v = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        pose = Adam([v], config.learning_rate_pose, betas=(0.9, 0.99))
        bounds, path = [], []
        for rate in _learning_rates(config, self.num_warm_up):
            pose.rate = config.learning_rate_pose * rate
            # Alg. 1: draw a mini-batch, sample the labels that its points land on, and estimate the bound.
            chosen = torch.randint(len(points), (config.batch_size,), generator=self.generator)
            # While theta warms up, the pose is fixed and needs no gradient.
            with torch.set_grad_enabled(rate > 0.0):
                T_camera_lidar = exp_se3(preconditioner @ v) @ anchor
            expectations = points.expectations(chosen, T_camera_lidar)
            bound, objective = self.bound(*expectations)
            bounds.append(bound.cpu())
            # Alg. 1: update theta and the twist along the gradient of the bound.
            (-objective).backward()
            self.theta.step()
            if rate > 0.0:
                pose.step()
                path.append(v.detach().clone())
            pose.zero_grad()
            self.theta.zero_grad()
        self.num_warm_up = config.warm_up_steps // 3
        quarter = max(len(path) // 4, 1)
        before, last = torch.stack(path[-2 * quarter :]).view(2, quarter, 6).mean(1)
        # Products of matrix exponentials are rigid up to rounding.
        T_end = nearest_rigid((exp_se3(preconditioner @ path[-1]) @ anchor).numpy())
        T_end[3] = 0.0, 0.0, 0.0, 1.0
        return Level(
            factor=factor,
            T_camera_lidar=within_baseline(T_end, self.observations.max_baseline_m),
            drift=float((last - before).norm()),
            num_points=len(points),
            bound_nats=float(torch.stack(bounds[-quarter:]).mean()),
        )


def check_device(device: str) -> None:
    """Check that this machine has a device: `cpu` or `cuda`.

    Raises:
        InputError: the device is `cuda` and there is none.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: PyTorch finds no CUDA device here")


@contextmanager
def _fixed_threads() -> Iterator[None]:
    """Let torch compute on `TORCH_THREADS` threads inside the `with` statement."""
    before = torch.get_num_threads()
    torch.set_num_threads(TORCH_THREADS)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _learning_rates(config: MineConfig, num_warm_up: int) -> Iterator[float]:
    """Make Alg. 1's scheduler of the pose's learning rate: zero while theta warms up, then a falling cosine."""
    yield from [0.0] * num_warm_up
    for step in range(config.steps_per_level):
        cosine = 0.5 * (1.0 + math.cos(math.pi * step / config.steps_per_level))
        yield config.final_rate + (1.0 - config.final_rate) * cosine
