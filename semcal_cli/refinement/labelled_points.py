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
    def forward(ctx: Any, T_camera_lidar: Tensor, points: _core.AnchoredPoints, indices: Tensor) -> Tensor:
        """Sample (N, num_image_classes) float64; `T_camera_lidar` is (4, 4) float64 on the CPU."""
        ctx.save_for_backward(T_camera_lidar)
        ctx.points, ctx.indices = points, indices
        return torch.from_numpy(points.shares(indices.numpy(), T_camera_lidar.detach().numpy()))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        """Chain the gradient back to the entries of `T_camera_lidar`, whose last row is constant."""
        (T_camera_lidar,) = ctx.saved_tensors
        pulled = torch.zeros_like(T_camera_lidar)
        pulled[:3] = torch.from_numpy(
            ctx.points.pull_back(
                ctx.indices.numpy(), T_camera_lidar.detach().numpy(), gradients[0].contiguous().numpy()
            )
        )
        return pulled, None, None


def sample_shares(points: _core.AnchoredPoints, indices: Tensor, T_camera_lidar: Tensor) -> Tensor:
    """Sample the label images under points, bilinearly between the centres of blocks.

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


class LabelledPoints:
    """The labelled points of a level, compared by a network with the class shares of the blocks that they land on.

    Labels stay in the Rust core as ids and compact shares.
    """

    def __init__(
        self,
        points: _core.AnchoredPoints,
        network: StatisticsNetwork,
        num_classes: int,
        device: torch.device,
    ) -> None:
        """Take the points of a level.

        Args:
            points: The points that land on labelled pixels at the anchor pose.
            network: The statistics F(x, y) of a point's class and the shares under it.
            num_classes: Number of classes of points.
            device: Where the network computes.
        """
        self.network, self.points, self.device = network, points, device
        self.classes = torch.from_numpy(points.classes).long()
        self.weights = torch.from_numpy(points.weights)
        self.num_classes = num_classes

    def __len__(self) -> int:
        """Number of points."""
        return len(self.classes)

    def expectations(self, chosen: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        """Compute both expectations of the bound, as `LevelPoints.expectations` describes.

        Raises:
            CalibrationError: none of the chosen points is on a labelled pixel any more.
        """
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
