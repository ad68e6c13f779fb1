"""MINE: mutual information as a neural network's lower bound, climbed together with the pose (Alg. 1, eqs. 1-5).

Source: Belghazi et al., *Mutual Information Neural Estimation* (arXiv 1801.04062), with its bias-corrected gradient.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from semcal_cli import _core
from semcal_cli.config import MineConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.geometry.baseline import within_baseline
from semcal_cli.geometry.poses import Pose, nearest_rigid
from semcal_cli.refinement.projection import Projection
from semcal_cli.refinement.pyramid import Level
from semcal_cli.refinement.se3 import exp_se3

TORCH_THREADS = 1
"""Fixed, because sums over threads round differently: results must not depend on the machine's cores. One, because
on mini-batches of this size a second thread gains little, and waits ten times over where other work shares the cores.
"""


LARGEST = 30.0
"""Statistics beyond this would overflow, and mean nothing."""


class StatisticsNetwork(torch.nn.Module):
    """F(x, y) for discrete x and a vector y of class shares: one output for each x.

    With an output for each x, the expectation over x in the second term of the bound is a sum over all classes
    instead of over shuffled pairs, which takes most of the noise out of the estimate at half the cost.
    """

    def __init__(self, num_x: int, num_y: int, num_hidden: int, generator: torch.Generator) -> None:
        super().__init__()
        self.layers = _perceptron([num_y, num_hidden, num_hidden, num_x], generator)

    def forward(self, y: Tensor) -> Tensor:
        """F(x, y_i) for all x: (N, num_y) -> (N, num_x)."""
        output: Tensor = self.layers(y)
        return output


class SeparableNetwork(torch.nn.Module):
    """F(x, y) = g(x) . h(y) for vectors x and y.

    The second term of the bound can then be taken over all pairs of a mini-batch, of which there are many.
    """

    def __init__(self, num_x: int, num_y: int, config: MineConfig, generator: torch.Generator) -> None:
        super().__init__()
        inner = [config.num_hidden, config.num_hidden, config.num_embedding]
        self.of_x, self.of_y = (_perceptron([width, *inner], generator) for width in (num_x, num_y))

    def forward(self, x: Tensor, y: Tensor) -> Tensor:
        """F(x_i, y_j): (N, num_x) and (N, num_y) -> (N, N)."""
        statistics: Tensor = self.of_x(x) @ self.of_y(y).T
        return statistics.clamp(max=LARGEST)


def _perceptron(widths: Sequence[int], generator: torch.Generator) -> torch.nn.Sequential:
    layers: list[torch.nn.Module] = []
    for wide_in, wide_out in pairwise(widths):
        # Built without weights: torch would draw them from its global generator.
        linear = torch.nn.Linear(wide_in, wide_out, device="meta").to_empty(device="cpu")
        bound = wide_in**-0.5
        torch.nn.init.uniform_(linear.weight, -bound, bound, generator=generator)
        torch.nn.init.zeros_(linear.bias)
        layers += [linear, torch.nn.ELU()]
    return torch.nn.Sequential(*layers[:-1])


class DonskerVaradhan(torch.nn.Module):
    """The bound I(X; Y) >= E_p(x,y)[F] - log E_p(x)p(y)[exp F] (eq. 2) over mini-batches.

    The gradient of the logarithm of a mini-batch mean is biased; as in MINE, its denominator is a running mean.
    """

    def __init__(self, decay: float) -> None:
        super().__init__()
        self.decay = decay
        self._mean_exp: Tensor | None = None

    def forward(self, joint: Tensor, mean_exp: Tensor) -> tuple[Tensor, Tensor]:
        """Estimate the bound from E_p(x,y)[F] and E_p(x)p(y)[exp F] of a mini-batch.

        Returns:
            The bound in nats, and a scalar whose gradient is the bias-corrected gradient of the bound.
        """
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


class _Anchored(Protocol):
    """The points of a level at its anchor pose, which a step draws from."""

    preconditioner: Tensor
    """(6, 6): columns are twists that each move the points by one block, independently of one another."""

    def __len__(self) -> int:
        """How many points there are."""

    def expectations(self, chosen: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        """E_p(x,y)[F] and E_p(x)p(y)[exp F] over the points (N,) chosen, at a pose (4, 4) float64."""


class _LabelledPoints:
    """Labels stay in the Rust core as ids and compact shares."""

    def __init__(
        self,
        observations: Observations,
        network: torch.nn.Module,
        points: _core.AnchoredPoints,
        device: torch.device,
    ) -> None:
        self.network, self.points, self.device = network, points, device
        self.classes = torch.from_numpy(points.classes).long()
        self.weights = torch.from_numpy(points.weights)
        self.preconditioner = torch.from_numpy(points.preconditioner)
        self.num_classes = len(observations.point_class_names)

    def __len__(self) -> int:
        return len(self.classes)

    def expectations(self, chosen: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        shares = sample_shares(self.points, chosen, T_camera_lidar)
        y, x = shares.float().to(self.device), self.classes[chosen].to(self.device)
        # A point that is on no labelled pixel any more counts for nothing.
        weights = (self.weights[chosen] * (shares.detach().sum(1) > 0.0)).to(self.device)
        if not weights.sum() > 0.0:
            raise CalibrationError("no overlap: the refinement left no labelled point on a labelled pixel")
        weights = weights / weights.sum()
        # All classes stand for the marginal of x, weighed by how often they are seen.
        p_x = torch.bincount(x, weights, minlength=self.num_classes)
        statistics = self.network(y)
        return weights @ statistics.gather(1, x[:, None])[:, 0], weights @ (statistics.exp() @ p_x)


class _PointsWithVectors:
    """Vectors of points and of blocks of pixels, bilinear between the centres of blocks."""

    def __init__(
        self,
        observations: Observations,
        network: torch.nn.Module,
        anchor: Pose,
        factor: int,
        preconditioner: npt.NDArray[np.float64],
        device: torch.device,
        *,
        visible_only: bool,
    ) -> None:
        self.network, self.device = network, device
        self.preconditioner = torch.from_numpy(preconditioner)
        self.projection = Projection(observations.camera)
        width = observations.camera.width
        vectors = _vectors(observations)
        own = width // vectors[0][1].shape[1]
        pooled = max(1, factor // own)
        self.block_px = own * pooled
        maps = [_averaged(of_pixels, pooled) for _, of_pixels in vectors]
        self.rows, self.columns, channels = maps[0].shape
        self.y = torch.from_numpy(np.concatenate([each.reshape(-1, channels) for each in maps]))
        points, x, frames = [], [], []
        for frame, (cloud, (of_points, _)) in enumerate(zip(observations.clouds, vectors, strict=True)):
            projected = _core.project_points(core_camera(observations.camera), cloud.points, anchor)
            seen = np.isfinite(projected.ranges) & ~(projected.is_hidden & visible_only)
            points.append(cloud.points[seen])
            x.append(of_points[seen])
            frames.append(np.full(seen.sum(), frame))
        self.points = torch.from_numpy(np.concatenate(points)).double()
        self.x, self.frames = torch.from_numpy(np.concatenate(x)), torch.from_numpy(np.concatenate(frames))

    def __len__(self) -> int:
        return len(self.points)

    def expectations(self, chosen: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        pixels, _ = self.projection(self.points[chosen] @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3])
        y = self._sample(self.frames[chosen], pixels).to(self.device)
        statistics = self.network(self.x[chosen].float().to(self.device), y)
        own, all_pairs, count = statistics.diagonal(), statistics.exp(), len(chosen)
        others = all_pairs.sum() - all_pairs.diagonal().sum()
        return own.mean(), others / (count * (count - 1))

    def _sample(self, frames: Tensor, pixels: Tensor) -> Tensor:
        """Vectors (N, C) at pixels (N, 2), those of the border beyond it."""
        place = (pixels + 0.5) / self.block_px - 0.5
        last = place.new_tensor([self.columns - 1, self.rows - 1])
        place = torch.minimum(place.clamp(min=0.0), last)
        corner = torch.minimum(place.detach().floor(), (last - 1.0).clamp(min=0.0))
        (right, down), (column, row) = (place - corner).float().T, corner.long().T
        next_column, next_row = int(self.columns > 1), self.columns * int(self.rows > 1)
        first = (frames * self.rows + row) * self.columns + column
        weights = (1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down
        indices = first, first + next_column, first + next_row, first + next_column + next_row
        return sum(
            (weight[:, None] * self.y[index].float() for weight, index in zip(weights, indices, strict=True)),
            start=torch.zeros(()),
        )


def _vectors(
    observations: Observations,
) -> list[tuple[npt.NDArray[np.float16], npt.NDArray[np.float16]]]:
    """Features of points (N, C) and of blocks of pixels (H / s, W / s, C) of each frame that has them."""
    pairs = ((frame.cloud.vectors, frame.image.vectors) for frame in observations.frames)
    return [(points, pixels) for points, pixels in pairs if points is not None and pixels is not None]


def _averaged(vectors: npt.NDArray[np.float16], factor: int) -> npt.NDArray[np.float16]:
    """Average (H, W, C) over blocks of `factor x factor`; only whole blocks count."""
    rows, columns, channels = vectors.shape[0] // factor, vectors.shape[1] // factor, vectors.shape[2]
    if factor == 1 or not rows or not columns:
        return vectors
    whole = vectors[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor, channels)
    averaged: npt.NDArray[np.float16] = whole.mean(axis=(1, 3), dtype=np.float32).astype(np.float16)
    return averaged


class MineClimb:
    """Climbs the Donsker-Varadhan bound: theta and the twist v of the pose, each at its own learning rate.

    A step draws one mini-batch from all frames, so its cost does not depend on their number. `device` is where the
    network computes. Observations with features are compared by these, others by their labels.
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
        self.network = self._make_network().to(self.device)
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

    def _make_network(self) -> torch.nn.Module:
        observations, config = self.observations, self.config
        if observations.has_vectors:
            of_points, of_pixels = _vectors(observations)[0]
            return SeparableNetwork(of_points.shape[-1], of_pixels.shape[-1], config, self.generator)
        num_classes = len(observations.point_class_names), len(observations.image_class_names)
        return StatisticsNetwork(*num_classes, config.num_hidden, self.generator)

    def _anchored(self, factor: int, anchor: Pose, visible_only: bool) -> _Anchored:
        observations = self.observations
        # Labels beside features are their codes: they tell how points move, and nothing else.
        points = _core.AnchoredPoints(
            observations.core,
            anchor,
            factor=factor,
            edge_band_px=self.config.edge_band_px,
            visible_only=visible_only,
        )
        if not observations.has_vectors:
            return _LabelledPoints(observations, self.network, points, self.device)
        return _PointsWithVectors(
            observations,
            self.network,
            anchor,
            factor,
            points.preconditioner,
            self.device,
            visible_only=visible_only,
        )

    def _climb(self, factor: int, T_start: Pose, visible_only: bool) -> Level:
        config = self.config
        points = self._anchored(factor, T_start, visible_only)
        if len(points) < config.min_points:
            return Level(factor, T_start, 0.0, math.inf, len(points))
        anchor, unit = torch.from_numpy(T_start), points.preconditioner
        v = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        pose = torch.optim.Adam([v], config.learning_rate_pose, betas=(0.9, 0.99))
        bounds, path = [], []
        for rate in self._rates():
            pose.param_groups[0]["lr"] = config.learning_rate_pose * rate
            chosen = torch.randint(len(points), (config.batch_size,), generator=self.generator)
            bound, ascent = self.bound(*points.expectations(chosen, exp_se3(unit @ v) @ anchor))
            (-ascent).backward()
            bounds.append(bound.cpu())
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
            T_camera_lidar=within_baseline(_rigid(exp_se3(unit @ path[-1]) @ anchor), config.max_baseline_m),
            information_nats=float(torch.stack(bounds[-quarter:]).mean()),
            drift=float((last - before).norm()),
            num_points=len(points),
        )

    def _rates(self) -> Iterator[float]:
        """The scheduler: zero while theta warms up, then a falling cosine."""
        config = self.config
        yield from [0.0] * self.warm_up_steps
        self.warm_up_steps = config.warm_up_steps // 3
        for step in range(config.steps_per_level):
            cosine = 0.5 * (1.0 + math.cos(math.pi * step / config.steps_per_level))
            yield config.final_rate + (1.0 - config.final_rate) * cosine


def _rigid(T_camera_lidar: Tensor) -> Pose:
    """Give the rigid transform next to a product of matrix exponentials."""
    pose = nearest_rigid(T_camera_lidar.numpy())
    pose[3] = 0.0, 0.0, 0.0, 1.0
    return pose
