"""The points of a level, from which each step draws a mini-batch, and the labels or features under them (Alg. 1).

Sampling is differentiable in the pose: the Rust core samples labels, torch samples feature vectors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.refine.statistics_network import SeparableNetwork, StatisticsNetwork
from semcal_cli.estimation.refine.torch_geometry import TorchProjection
from semcal_cli.geometry.arrays import Features, Pose
from semcal_cli.observations.observations import NO_CLASS, Observations


class _Shares(torch.autograd.Function):
    """Class shares under points, by the Rust core: differentiable in the pose."""

    @staticmethod
    def forward(ctx: Any, T_camera_lidar: Tensor, batch: core.MiniBatch) -> Tensor:
        """Return (R, num_y) float64; `T_camera_lidar` is the batch's, (4, 4) float64 on the CPU."""
        ctx.batch = batch
        return torch.from_numpy(batch.shares)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        """Chain the gradient back to the entries of `T_camera_lidar`, whose last row is constant."""
        pulled = torch.zeros(4, 4, dtype=torch.float64)
        pulled[:3] = torch.from_numpy(ctx.batch.pull_back(gradients[0].contiguous().numpy()))
        return pulled, None


def sample(
    points: core.AnchoredPoints, indices: Tensor, T_camera_lidar: Tensor
) -> tuple[core.MiniBatch, Tensor]:
    """Sample the label images under points, bilinearly between the centres of blocks.

    Args:
        points: The points of a level.
        indices: (N,) int64 into the points.
        T_camera_lidar: (4, 4) float64, on the CPU.

    Returns:
        The mini-batch, and its shares (R, num_y) float64 of each class, which add up to one and are differentiable in
        `T_camera_lidar`. Points on blocks of one class share a row.
    """
    batch = points.sample(indices.numpy(), T_camera_lidar.detach().numpy())
    shares: Tensor = _Shares.apply(T_camera_lidar, batch)
    return batch, shares


class LabelledPoints:
    """The labelled points of a level, which a network compares with the class shares of the blocks under them.

    The labels remain in the Rust core, as ids and compact shares.
    """

    def __init__(self, points: core.AnchoredPoints, network: StatisticsNetwork, device: torch.device) -> None:
        """Take the points of a level.

        Args:
            points: The points that land on labelled pixels at the anchor pose.
            network: The statistics F(x, y) of a point's class and the shares under it.
            device: Device that runs the network.
        """
        self.network, self.points, self.device = network, points, device
        self.num_points = len(points.classes)

    def __len__(self) -> int:
        """Number of points."""
        return self.num_points

    def expectations(self, chosen: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        """Compute both expectations of the bound over a mini-batch, differentiably in the pose and in theta.

        Args:
            chosen: (N,) int64, the points of the mini-batch.
            T_camera_lidar: (4, 4) float64, on the CPU.

        Returns:
            E_p(x,y)[F] and E_p(x)p(y)[exp F], float32 scalars on the network's device.

        Raises:
            CalibrationError: none of the chosen points is still on a labelled pixel.
        """
        batch, shares = sample(self.points, chosen, T_camera_lidar)
        # Each row holds, for a vector of shares, the weights of the classes of the points that land there. A point that
        # has left the labelled pixels has no weight.
        y, weights = shares.float().to(self.device), torch.from_numpy(batch.weights).float().to(self.device)
        if not weights.sum() > 0.0:
            raise CalibrationError(
                "no overlap: the refinement left no point on a pixel that can be compared with it"
            )
        weights = weights / weights.sum()
        statistics = self.network(y)
        # The marginal of x is a sum over all classes, weighted by their frequency.
        independent = weights.sum(1) @ (statistics.exp() @ weights.sum(0))
        return (weights * statistics).sum(), independent


class FeaturePoints:
    """The points of a level, whose vectors a network compares with those of the blocks of pixels under them.

    The vector of a block is the mean of its pixels' vectors; it is interpolated bilinearly between block centres.
    """

    def __init__(
        self,
        observations: Observations,
        network: SeparableNetwork,
        device: torch.device,
        *,
        factor: int,
        anchor: Pose,
        visible_only: bool,
    ) -> None:
        """Choose the points that land on pixels with a class at a pose, and average the images' vectors over blocks.

        Args:
            observations: Points and images of all frames, with vectors on both sides.
            network: The statistics F(x, y) of a point's vector and the vector under it.
            device: Device that runs the network.
            factor: Side of a block in pixels, at least that of the blocks of the given vectors.
            anchor: (4, 4) T_camera_lidar at which points are chosen.
            visible_only: Whether points that the camera cannot see are dropped.
        """
        self.network, self.device = network, device
        self.projection = TorchProjection(observations.camera)
        vectors = feature_vectors(observations)
        vector_px = observations.camera.width // vectors[0][1].shape[1]
        pooled = max(1, factor // vector_px)
        self.block_px = vector_px * pooled
        maps = [block_means(pixel_vectors, pooled) for _, pixel_vectors in vectors]
        self.rows, self.columns, channels = maps[0].shape
        self.y = torch.from_numpy(np.concatenate([pixels.reshape(-1, channels) for pixels in maps]))
        points, x, frames = [], [], []
        sides = zip(observations.clouds, observations.images, vectors, strict=True)
        for frame, (cloud, image, (point_vectors, _)) in enumerate(sides):
            projected = core.project_points(
                core_camera(observations.camera), cloud.points, anchor, observations.origin_m
            )
            is_visible = np.isfinite(projected.ranges) & ~(projected.is_hidden & visible_only)
            last = np.subtract(image.classes.shape[::-1], 1)
            u, v = np.rint(projected.pixels[is_visible]).astype(int).clip(0, last).T
            is_visible[is_visible] = image.classes[v, u] != NO_CLASS
            points.append(cloud.points[is_visible])
            x.append(point_vectors[is_visible])
            frames.append(np.full(is_visible.sum(), frame))
        self.points = torch.from_numpy(np.concatenate(points)).double()
        self.x, self.frames = torch.from_numpy(np.concatenate(x)), torch.from_numpy(np.concatenate(frames))

    def __len__(self) -> int:
        """Number of points."""
        return len(self.points)

    def expectations(self, chosen: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        """Compute both expectations of the bound, as `LabelledPoints.expectations` does."""
        pixels, _ = self.projection(self.points[chosen] @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3])
        y = self.sample(self.frames[chosen], pixels).to(self.device)
        statistics = self.network(self.x[chosen].float().to(self.device), y)
        own, all_pairs, count = statistics.diagonal(), statistics.exp(), len(chosen)
        others = all_pairs.sum() - all_pairs.diagonal().sum()
        return own.mean(), others / (count * (count - 1))

    def sample(self, frames: Tensor, pixels: Tensor) -> Tensor:
        """Sample the blocks' vectors.

        Args:
            frames: (N,) int64.
            pixels: (N, 2) float64, (u, v); an integer pixel is a pixel centre.

        Returns:
            (N, C) float32, differentiable in `pixels`. Beyond the border, the nearest border vector.
        """
        # `grid_sample` needs positions and all vectors in float32: twice the memory, no faster, and 0.047 instead of
        # 0.032 degrees over six seeds of a drive of 20 frames, which may be chance.
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


def feature_vectors(observations: Observations) -> list[tuple[Features, Features]]:
    """List the features of points (N, C_x) and of blocks of pixels (H / s, W / s, C_y) of each frame that has them."""
    pairs = ((frame.cloud.vectors, frame.image.vectors) for frame in observations.frame_observations)
    return [(points, pixels) for points, pixels in pairs if points is not None and pixels is not None]


def block_means(vectors: Features, factor: int) -> Features:
    """Average vectors (H, W, C) over whole blocks of `factor` x `factor`; a map smaller than a block is unchanged.

    Returns:
        (H // factor, W // factor, C) float16; sums are taken in float32.
    """
    if factor == 1 or factor > min(vectors.shape[:2]):
        return vectors
    averaged = functional.avg_pool2d(torch.from_numpy(vectors).permute(2, 0, 1), factor)
    means: Features = averaged.permute(1, 2, 0).numpy()
    return means
