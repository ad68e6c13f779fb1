"""MINE: mutual information as a neural network's lower bound, climbed together with the pose (Alg. 1, eqs. 1-5).

Source: Belghazi et al., *Mutual Information Neural Estimation* (arXiv 1801.04062), with its bias-corrected gradient.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from semcal_cli import _core
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.observations import Observations
from semcal_cli.poses import Pose, nearest_rigid
from semcal_cli.refinement import EDGE_BAND_PX, MAX_BASELINE_M, Level
from semcal_cli.se3 import exp_se3

TORCH_THREADS = 1
"""Fixed, because sums over threads round differently: results must not depend on the machine's cores. One, because
on mini-batches of this size a second thread gains little, and waits ten times over where other work shares the cores.
"""


@dataclass(frozen=True)
class MineConfig:
    """Network, learning rates, scheduler and batches.

    Steps of the pose are in motions that each move the points by one block, independently of one another, so that they
    fit any lens, picture and scene.
    """

    steps_per_level: int = 80
    warm_up_steps: int = 60
    """Steps in which only theta learns: at the first level; later levels take a third of it."""
    batch_size: int = 2048
    num_hidden: int = 32
    learning_rate_theta: float = 1e-2
    learning_rate_pose: float = 0.15
    final_rate: float = 0.05
    """The scheduler lowers the pose's rate along a cosine to this share at each level's end."""
    mean_decay: float = 0.9
    """Of the running mean in the bias-corrected gradient."""
    max_baseline_m: float = MAX_BASELINE_M
    edge_band_px: int = EDGE_BAND_PX
    min_points: int = 50
    """A level with fewer tells nothing; the pose stays as it is."""


class StatisticsNetwork(torch.nn.Module):
    """F(x, y) for discrete x and a vector y of class shares: one output for each x.

    With an output for each x, the expectation over x in the second term of the bound is a sum over all classes
    instead of over shuffled pairs, which takes most of the noise out of the estimate at half the cost.
    """

    def __init__(self, num_x: int, num_y: int, num_hidden: int, generator: torch.Generator) -> None:
        super().__init__()
        widths = [num_y, num_hidden, num_hidden, num_x]
        layers: list[torch.nn.Module] = []
        for wide_in, wide_out in pairwise(widths):
            # Built without weights: torch would draw them from its global generator.
            linear = torch.nn.Linear(wide_in, wide_out, device="meta").to_empty(device="cpu")
            bound = wide_in**-0.5
            torch.nn.init.uniform_(linear.weight, -bound, bound, generator=generator)
            torch.nn.init.zeros_(linear.bias)
            layers += [linear, torch.nn.ELU()]
        self.layers = torch.nn.Sequential(*layers[:-1])

    def forward(self, y: Tensor) -> Tensor:
        """F(x, y_i) for all x: (N, num_y) -> (N, num_x)."""
        output: Tensor = self.layers(y)
        return output


class DonskerVaradhan(torch.nn.Module):
    """The bound I(X; Y) >= E_p(x,y)[F] - log E_p(x)p(y)[exp F] (eq. 2) over mini-batches.

    The gradient of the logarithm of a mini-batch mean is biased; as in MINE, its denominator is a running mean.
    """

    def __init__(self, decay: float) -> None:
        super().__init__()
        self.decay = decay
        self._mean_exp: Tensor | None = None

    def forward(self, statistics: Tensor, x: Tensor, p_x: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Estimate the bound.

        Args:
            statistics: (N, num_x), F(x, y_i) for all x.
            x: (N,) int64, the x that was seen with each y.
            p_x: (num_x,), the distribution of x.
            weights: (N,), how much each pair counts.

        Returns:
            The bound in nats, and a scalar whose gradient is the bias-corrected gradient of the bound.
        """
        weights = weights / weights.sum()
        joint = weights @ statistics.gather(1, x[:, None])[:, 0]
        mean_exp = weights @ (statistics.exp() @ p_x)
        detached = mean_exp.detach()
        previous = detached if self._mean_exp is None else self._mean_exp
        self._mean_exp = self.decay * previous + (1 - self.decay) * detached
        bound = joint - mean_exp.log()
        return bound.detach(), joint - mean_exp / self._mean_exp


class _Shares(torch.autograd.Function):
    """Class shares under points, by the Rust core: differentiable in the pose."""

    @staticmethod
    def forward(ctx: Any, T_camera_lidar: Tensor, points: _core.AnchoredPoints, indices: Tensor) -> Tensor:
        """Sample (N, num_classes) float64; `T_camera_lidar` (4, 4) float64 on the CPU."""
        ctx.save_for_backward(T_camera_lidar)
        ctx.points, ctx.indices = points, indices
        return torch.from_numpy(points.shares(indices.numpy(), T_camera_lidar.detach().numpy()))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        """Chain the gradient back to the entries of `T_camera_lidar`."""
        (T_camera_lidar,) = ctx.saved_tensors
        pulled = torch.zeros_like(T_camera_lidar)
        pulled[:3] = torch.from_numpy(
            ctx.points.pull_back(
                ctx.indices.numpy(), T_camera_lidar.detach().numpy(), gradients[0].contiguous().numpy()
            )
        )
        return pulled, None, None


def sample_shares(points: _core.AnchoredPoints, indices: Tensor, T_camera_lidar: Tensor) -> Tensor:
    """Sample the label images under points, bilinearly.

    Args:
        points: The points of a level.
        indices: (N,) int64, which of them.
        T_camera_lidar: (4, 4) float64, on the CPU.

    Returns:
        (N, num_image_classes) float64, shares of each class, adding up to one; zeros where nothing is labelled.
        Differentiable in `T_camera_lidar`.
    """
    shares: Tensor = _Shares.apply(T_camera_lidar, points, indices)
    return shares


class MineClimb:
    """Climbs the Donsker-Varadhan bound: theta and the twist v of the pose, each at its own learning rate.

    Labels stay in the Rust core as ids and compact shares. A step draws one mini-batch from all frames, so its cost
    does not depend on their number. `device` is where the network computes.
    """

    def __init__(
        self, observations: Observations, config: MineConfig, seed: int, device: str = "cpu"
    ) -> None:
        """Set up network and random numbers.

        Raises:
            InputError: the device is `cuda` and there is none.
        """
        if device == "cuda" and not torch.cuda.is_available():
            raise InputError("--device cuda: PyTorch finds no CUDA device here")
        self.observations, self.config, self.device = observations, config, torch.device(device)
        self.generator = torch.Generator().manual_seed(seed)
        self.num_classes = len(observations.point_class_names), len(observations.image_class_names)
        self.network = StatisticsNetwork(*self.num_classes, config.num_hidden, self.generator).to(self.device)
        self.bound = DonskerVaradhan(config.mean_decay)
        self.theta = torch.optim.Adam(self.network.parameters(), config.learning_rate_theta)
        self.warm_up_steps = config.warm_up_steps

    def __call__(self, factor: int, T_start: Pose, *, visible_only: bool) -> Level:
        """Climb one level of the pyramid."""
        before = torch.get_num_threads()
        torch.set_num_threads(TORCH_THREADS)
        try:
            return self._climb(factor, T_start, visible_only)
        finally:
            torch.set_num_threads(before)

    def _climb(self, factor: int, T_start: Pose, visible_only: bool) -> Level:
        config = self.config
        points = _core.AnchoredPoints(
            self.observations.core,
            T_start,
            factor=factor,
            edge_band=config.edge_band_px,
            visible_only=visible_only,
        )
        classes = torch.from_numpy(points.classes).long()
        weights = torch.from_numpy(points.weights)
        if len(classes) < config.min_points:
            return Level(factor, T_start, 0.0, math.inf, len(classes))
        anchor, unit = torch.from_numpy(T_start), torch.from_numpy(points.unit_motions)
        v = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        pose = torch.optim.Adam([v], config.learning_rate_pose, betas=(0.9, 0.99))
        bounds, path = [], []
        for rate in self._rates():
            pose.param_groups[0]["lr"] = config.learning_rate_pose * rate
            chosen = torch.randint(len(classes), (config.batch_size,), generator=self.generator)
            shares = sample_shares(points, chosen, exp_se3(unit @ v) @ anchor)
            bounds.append(self._step(shares, classes[chosen], weights[chosen]))
            self.theta.step()
            if rate > 0.0:
                pose.step()
                path.append(v.detach().clone())
            pose.zero_grad()
            self.theta.zero_grad()
        quarter = max(len(path) // 4, 1)
        before, last = torch.stack(path[-2 * quarter :]).view(2, quarter, 6).mean(1)
        return Level(
            factor=factor,
            T_camera_lidar=self._within_baseline(exp_se3(unit @ path[-1]) @ anchor),
            information_nats=float(torch.stack(bounds[-quarter:]).mean()),
            drift=float((last - before).norm()),
            num_points=len(classes),
        )

    def _rates(self) -> Iterator[float]:
        """The scheduler: zero while theta warms up, then a falling cosine."""
        config = self.config
        yield from [0.0] * self.warm_up_steps
        self.warm_up_steps = config.warm_up_steps // 3
        for step in range(config.steps_per_level):
            cosine = 0.5 * (1.0 + math.cos(math.pi * step / config.steps_per_level))
            yield config.final_rate + (1.0 - config.final_rate) * cosine

    def _step(self, shares: Tensor, x: Tensor, weights: Tensor) -> Tensor:
        """Accumulate the gradients of theta and v on a mini-batch, and return the bound."""
        y, x = shares.float().to(self.device), x.to(self.device)
        # A point that is on no labelled pixel any more counts for nothing.
        weights = (weights * (shares.detach().sum(1) > 0.0)).to(self.device)
        if not weights.sum() > 0.0:
            raise CalibrationError("no overlap: the refinement left no labelled point on a labelled pixel")
        p_x = torch.bincount(x, weights, minlength=self.num_classes[0]) / weights.sum()
        bound: Tensor
        bound, ascent = self.bound(self.network(y), x, p_x, weights)
        (-ascent).backward()
        return bound.cpu()

    def _within_baseline(self, T_camera_lidar: Tensor) -> Pose:
        """The rigid transform next to a product of matrix exponentials, with the camera no farther than it may be."""
        pose = nearest_rigid(T_camera_lidar.numpy())
        pose[3] = 0.0, 0.0, 0.0, 1.0
        pose[:3, 3] *= min(1.0, self.config.max_baseline_m / float((pose[:3, 3] ** 2).sum()) ** 0.5)
        return pose
