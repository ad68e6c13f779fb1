"""Rigid motions (eq. 3) and camera models for torch: differentiable, and equal to those of the Rust core.

The core documents the camera models.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import torch
from torch import Tensor

from semcal_cli.drive.camera import Camera, CameraModel, core_camera

TINY = 1e-24
"""Keeps the gradient of a radius finite on the optical axis."""
POLE = 1e-6
"""Angle from straight up or down, in radians, within which all columns of an equirectangular image are one point."""


def exp_se3(twist: Tensor) -> Tensor:
    """Map a twist to a rigid motion, differentiably (eq. 3).

    Args:
        twist: (6,) floats (rho, phi): translation in metres, then rotation in radians.

    Returns:
        (4, 4) of the twist's dtype, the matrix exponential of `sum_i twist_i B_i` with the generators `B_i` of SE(3).
    """
    motion: Tensor = torch.linalg.matrix_exp((twist[:, None, None] * generators(twist)).sum(0))
    return motion


def generators(like: Tensor) -> Tensor:
    """Make the six generators of SE(3): three translations, then rotations about x, y and z.

    Args:
        like: A tensor with the dtype and device of the result.

    Returns:
        (6, 4, 4).
    """
    basis = torch.zeros(6, 4, 4, dtype=like.dtype, device=like.device)
    for axis in range(3):
        basis[axis, axis, 3] = 1.0
        j, k = (axis + 1) % 3, (axis + 2) % 3
        basis[3 + axis, k, j], basis[3 + axis, j, k] = 1.0, -1.0
    return basis


class TorchProjection(torch.nn.Module):
    """The projection of points in the camera frame to pixels (u, v); an integer pixel is a pixel centre."""

    coefficients: Tensor
    scale: Tensor
    center: Tensor

    def __init__(self, camera: Camera) -> None:
        super().__init__()
        self.limit = core_camera(camera).limit
        self._lens = LENSES[camera.model]
        K = torch.tensor(camera.K, dtype=torch.float64)
        self.register_buffer("coefficients", torch.tensor(_coefficients(camera), dtype=torch.float64))
        self.register_buffer("scale", K[:2, :2].T)
        self.register_buffer("center", K[:2, 2])

    def forward(self, points_camera: Tensor) -> tuple[Tensor, Tensor]:
        """Project points, differentiably.

        Args:
            points_camera: (N, 3) float64, metres, camera frame.

        Returns:
            Pixels (N, 2) float64, and (N,) bool, whether the model is valid there. A point beyond the maximum incidence
            angle of the model gets the pixel at that angle. A pixel may be outside the image.
        """
        points, holds = _within(points_camera, self.limit)
        distorted = self._lens(points, self.coefficients)
        if self._lens is _equirectangular:
            holds = _is_off_poles(points)
        return distorted @ self.scale + self.center, holds


def _coefficients(camera: Camera) -> list[float]:
    """List distortion and parameters in the order of the lens function, with zeros for what is absent."""
    distortion = list(camera.distortion)
    match camera.model:
        case "plumb_bob" | "rational_polynomial":
            return distortion + [0.0] * (8 - len(distortion))
        case "thin_prism":
            return distortion + [0.0] * (14 - len(distortion))
        case "fisheye":
            return distortion or [0.0] * 4
        case "omnidirectional":
            return [camera.parameters["xi"], *(distortion or [0.0] * 4)]
        case "double_sphere":
            return [camera.parameters["xi"], camera.parameters["alpha"]]
        case "equirectangular":
            return [(-0.5 - camera.K[0][2]) / camera.K[0][0]]
        case "fov":
            return distortion


def _within(points: Tensor, limit: float) -> tuple[Tensor, Tensor]:
    """Move points beyond an incidence angle onto it, and return which were within."""
    radius = _norm(points[:, :2])
    holds = torch.atan2(radius, points[:, 2]) <= limit
    unit = points[:, :2] / radius[:, None]
    last = torch.cat([math.sin(limit) * unit, torch.full_like(radius, math.cos(limit))[:, None]], 1)
    return torch.where(holds[:, None], points, last), holds


def _norm(vectors: Tensor) -> Tensor:
    return torch.sqrt((vectors * vectors).sum(-1).clamp_min(TINY))


def _polynomial(points: Tensor, coefficients: Tensor) -> Tensor:
    """Apply OpenCV's rational polynomial with tangential terms; plumb_bob is the case k4 = k5 = k6 = 0."""
    return _distort(points[:, :2] / points[:, 2:], coefficients)


def _distort(xy: Tensor, coefficients: Tensor) -> Tensor:
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    x, y, r2 = xy[:, 0], xy[:, 1], (xy * xy).sum(-1)
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return torch.stack([u, v], -1)


def _thin_prism(points: Tensor, coefficients: Tensor) -> Tensor:
    """Apply OpenCV's rational polynomial with thin prism and tilted sensor."""
    xy = points[:, :2] / points[:, 2:]
    r2 = (xy * xy).sum(-1, keepdim=True)
    s1, s2, s3, s4 = coefficients[8:12]
    prism = r2 * torch.cat([s1 + s2 * r2, s3 + s4 * r2], 1)
    before_tilt = _distort(xy, coefficients[:8]) + prism
    tilted = torch.cat([before_tilt, torch.ones_like(r2)], 1) @ _tilt(coefficients[12:]).T
    return tilted[:, :2] / tilted[:, 2:]


def _tilt(tau: Tensor) -> Tensor:
    (sin_x, sin_y), (cos_x, cos_y) = torch.sin(tau).tolist(), torch.cos(tau).tolist()
    about_x = tau.new_tensor([[1.0, 0.0, 0.0], [0.0, cos_x, sin_x], [0.0, -sin_x, cos_x]])
    about_y = tau.new_tensor([[cos_y, 0.0, -sin_y], [0.0, 1.0, 0.0], [sin_y, 0.0, cos_y]])
    turn = about_y @ about_x
    onto_plane = torch.diag(torch.stack([turn[2, 2], turn[2, 2], turn.new_tensor(1.0)]))
    onto_plane[:2, 2] = -turn[:2, 2]
    return onto_plane @ turn


def _fisheye(points: Tensor, coefficients: Tensor) -> Tensor:
    """Apply Kannala and Brandt's model: the radius is an odd polynomial of the incidence angle."""
    k1, k2, k3, k4 = coefficients
    radius = _norm(points[:, :2])
    angle = torch.atan2(radius, points[:, 2])
    a2 = angle * angle
    distorted: Tensor = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
    return points[:, :2] * (distorted / radius)[:, None]


def _fov(points: Tensor, coefficients: Tensor) -> Tensor:
    """Apply Devernay and Faugeras's FOV model: r_d = atan(2 r tan(w / 2)) / w."""
    w = coefficients[0]
    radius = _norm(points[:, :2])
    distorted = torch.atan2(2 * torch.tan(w / 2) * radius, points[:, 2]) / w
    return points[:, :2] * (distorted / radius)[:, None]


def _omnidirectional(points: Tensor, coefficients: Tensor) -> Tensor:
    """Apply Mei and Rives's model: a unit sphere seen from xi behind its centre."""
    depth = points[:, 2] + coefficients[0] * _norm(points)
    return _distort(points[:, :2] / depth[:, None], torch.cat([coefficients[1:], coefficients.new_zeros(4)]))


def _double_sphere(points: Tensor, coefficients: Tensor) -> Tensor:
    """Apply Usenko, Demmel and Cremers's model: two unit spheres, one after the other."""
    xi, alpha = coefficients[0], coefficients[1]
    shifted = xi * _norm(points) + points[:, 2]
    second = _norm(torch.cat([points[:, :2], shifted[:, None]], 1))
    return points[:, :2] / (alpha * second + (1 - alpha) * shifted)[:, None]


def _equirectangular(points: Tensor, coefficients: Tensor) -> Tensor:
    """Compute azimuth, in the turn that begins at the image's left border, and elevation, positive downwards."""
    (left,) = coefficients
    x, y, z = points.unbind(1)
    level = _norm(points[:, [0, 2]])
    azimuth = left + torch.remainder(torch.atan2(x, z) - left, 2 * math.pi)
    return torch.stack([azimuth, torch.atan2(y, level)], -1)


def _is_off_poles(points: Tensor) -> Tensor:
    return _norm(points[:, [0, 2]]) > POLE * points[:, 1].abs()


Lens: TypeAlias = Callable[[Tensor, Tensor], Tensor]

LENSES: dict[CameraModel, Lens] = {
    "plumb_bob": _polynomial,
    "rational_polynomial": _polynomial,
    "thin_prism": _thin_prism,
    "fisheye": _fisheye,
    "omnidirectional": _omnidirectional,
    "equirectangular": _equirectangular,
    "fov": _fov,
    "double_sphere": _double_sphere,
}
"""Maps from points (N, 3) within the limit, camera frame, and coefficients to distorted coordinates (N, 2)."""
