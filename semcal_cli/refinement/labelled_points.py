"""The labelled points of a level, and the labels of the pixels under them, sampled differentiably (Alg. 1)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from semcal_cli import _core
from semcal_cli.errors import CalibrationError
from semcal_cli.refinement.network import StatisticsNetwork


class _Shares(torch.autograd.Function):
    """Class shares under points, by the Rust core: differentiable in the pose."""

    @staticmethod
    def forward(ctx: Any, T_camera_lidar: Tensor, batch: _core.MiniBatch) -> Tensor:
        """Give (R, num_y) float64; `T_camera_lidar` is the batch's, (4, 4) float64 on the CPU."""
        ctx.batch = batch
        return torch.from_numpy(batch.shares)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        """Chain the gradient back to the entries of `T_camera_lidar`, whose last row is constant."""
        pulled = torch.zeros(4, 4, dtype=torch.float64)
        pulled[:3] = torch.from_numpy(ctx.batch.pull_back(gradients[0].contiguous().numpy()))
        return pulled, None


def sample(
    points: _core.AnchoredPoints, indices: Tensor, T_camera_lidar: Tensor
) -> tuple[_core.MiniBatch, Tensor]:
    """Sample the label images under points, bilinearly between the centres of blocks.

    Args:
        points: The points of a level.
        indices: (N,) int64, which of them.
        T_camera_lidar: (4, 4) float64, on the CPU.

    Returns:
        The mini-batch, and its shares (R, num_y) float64 of each class, adding up to one, differentiable in
        `T_camera_lidar`. Points on blocks of one class share a row.
    """
    batch = points.sample(indices.numpy(), T_camera_lidar.detach().numpy())
    shares: Tensor = _Shares.apply(T_camera_lidar, batch)
    return batch, shares


class LabelledPoints:
    """The labelled points of a level, compared by a network with the class shares of the blocks that they land on.

    Labels stay in the Rust core as ids and compact shares.
    """

    def __init__(
        self,
        points: _core.AnchoredPoints,
        network: StatisticsNetwork,
        device: torch.device,
    ) -> None:
        """Take the points of a level.

        Args:
            points: The points that land on labelled pixels at the anchor pose.
            network: The statistics F(x, y) of a point's class and the shares under it.
            device: Where the network computes.
        """
        self.network, self.points, self.device = network, points, device
        self.num_points = len(points.classes)

    def __len__(self) -> int:
        """Number of points."""
        return self.num_points

    def expectations(self, chosen: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        """Compute both expectations of the bound, as `LevelPoints.expectations` describes.

        Raises:
            CalibrationError: none of the chosen points is on a labelled pixel any more.
        """
        batch, shares = sample(self.points, chosen, T_camera_lidar)
        # A row for each vector of shares, and in it the weights of the classes of the points that land there. A point
        # that is on no labelled pixel any more counts for nothing.
        y, weights = shares.float().to(self.device), torch.from_numpy(batch.weights).float().to(self.device)
        if not weights.sum() > 0.0:
            raise CalibrationError("no overlap: the refinement left no labelled point on a labelled pixel")
        weights = weights / weights.sum()
        statistics = self.network(y)
        # All classes stand for the marginal of x, weighed by how often they are seen.
        independent = weights.sum(1) @ (statistics.exp() @ weights.sum(0))
        return (weights * statistics).sum(), independent
