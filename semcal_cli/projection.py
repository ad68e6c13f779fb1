"""Camera models for torch: differentiable, and equal to those of the Rust core."""

from __future__ import annotations

import torch
from torch import Tensor

from semcal_cli.camera import core_camera
from semcal_cli.drive import Camera

TINY = 1e-24
"""Keeps the gradient of a radius finite on the optical axis."""


class Projection(torch.nn.Module):
    """Projects points of the camera frame to pixels (u, v); an integer pixel is a pixel centre."""

    coefficients: Tensor
    focal: Tensor
    center: Tensor

    def __init__(self, camera: Camera) -> None:
        super().__init__()
        self.limit = core_camera(camera).limit
        self._project = _fisheye if camera.model == "fisheye" else _polynomial
        coefficients = torch.zeros(8, dtype=torch.float64)
        coefficients[: len(camera.distortion)] = torch.tensor(camera.distortion, dtype=torch.float64)
        K = torch.tensor(camera.K, dtype=torch.float64)
        self.register_buffer("coefficients", coefficients)
        self.register_buffer("focal", K.diagonal()[:2])
        self.register_buffer("center", K[:2, 2])

    def forward(self, points_camera: Tensor) -> tuple[Tensor, Tensor]:
        """Project points (N, 3), float64, metres.

        Returns:
            Pixels (N, 2), and (N,) whether the model holds there. Beyond the radius (or angle) to which it holds,
            a point has the pixel of the last one in its direction. A pixel may lie outside the picture.
        """
        distorted, holds = self._project(points_camera, self.coefficients, self.limit)
        return self.focal * distorted + self.center, holds


def _polynomial(points: Tensor, coefficients: Tensor, limit: float) -> tuple[Tensor, Tensor]:
    """OpenCV's rational polynomial with tangential terms; plumb_bob is the case k4 = k5 = k6 = 0."""
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    in_front = points[:, 2] > 0.0
    depth = torch.where(in_front, points[:, 2], 1.0)
    xy = points[:, :2] / depth[:, None]
    radius = torch.sqrt((xy * xy).sum(-1).clamp_min(TINY))
    holds = in_front & (radius <= limit)
    xy = xy * (limit / radius).clamp(max=1.0)[:, None]
    x, y, r2 = xy[:, 0], xy[:, 1], (xy * xy).sum(-1)
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return torch.stack([u, v], -1), holds


def _fisheye(points: Tensor, coefficients: Tensor, limit: float) -> tuple[Tensor, Tensor]:
    """Kannala and Brandt's model: the radius is an odd polynomial of the incidence angle."""
    k1, k2, k3, k4 = coefficients[:4]
    radius = torch.sqrt((points[:, :2] ** 2).sum(-1).clamp_min(TINY))
    incidence = torch.atan2(radius, points[:, 2])
    angle = incidence.clamp(max=limit)
    a2 = angle * angle
    distorted = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
    return points[:, :2] * (distorted / radius)[:, None], incidence <= limit
