"""What is known of a pose beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli.geometry.poses import Pose, camera_center, rotation_difference
from semcal_cli.geometry.twists import inverse_left_jacobian, pose_at

CLAMP_SIGMAS = 3.0
"""Farther than this from what is known, no level of the refinement begins: one in 400 is, if it is normal."""
EXACT = 1e-6
"""Metres or radians: what is known better than a micrometre is exact, and rounding stays out of the sums."""


@dataclass(frozen=True)
class Prior:
    """Known axes of a camera, and how well."""

    name: str
    """What to call it."""
    T_camera_lidar: Pose
    """Where the camera is, as far as it is known."""
    sigmas: tuple[float, ...]
    """Standard deviations of its place along its axes, metres, and of its rotation about them, radians: 0 for what is
    exact, infinite for what is not known."""

    def residual(self, T_camera_lidar: Pose) -> npt.NDArray[np.float64]:
        """How far a pose is off, along the axes of this camera: its place, metres, and its rotation, radians."""
        moved = camera_center(T_camera_lidar) - camera_center(self.T_camera_lidar)
        turned = rotation_difference(T_camera_lidar, self.T_camera_lidar)
        return np.concatenate([self.T_camera_lidar[:3, :3] @ moved, turned])

    def jacobian(self, T_camera_lidar: Pose) -> npt.NDArray[np.float64]:
        """(6, 6) derivatives of the residual with respect to a twist on the left of the pose."""
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = -self.T_camera_lidar[:3, :3] @ T_camera_lidar[:3, :3].T
        jacobian[3:, 3:] = inverse_left_jacobian(rotation_difference(T_camera_lidar, self.T_camera_lidar))
        return jacobian

    def describe(self) -> dict[str, object]:
        """Give what a result records; null where nothing is known."""
        sigmas = [sigma if math.isfinite(sigma) else None for sigma in self.sigmas]
        return {
            "name": self.name,
            "T_camera_lidar": self.T_camera_lidar.tolist(),
            "sigma_camera_center_m": sigmas[:3],
            "sigma_rotation_deg": [None if sigma is None else math.degrees(sigma) for sigma in sigmas[3:]],
        }

    @property
    def exact(self) -> Prior:
        """Only what is known exactly."""
        return replace(self, sigmas=tuple(0.0 if sigma <= EXACT else math.inf for sigma in self.sigmas))

    def allows(self, T_camera_lidar: Pose, center_m: float, rotation_rad: float) -> bool:
        """Whether a pose that may itself be off by so much can be the one that is known."""
        slack = np.repeat([center_m, rotation_rad], 3)
        most = CLAMP_SIGMAS * np.array(self.sigmas) + slack
        return bool((np.abs(self.residual(T_camera_lidar)) <= most).all())

    def clamp(self, T_camera_lidar: Pose) -> Pose:
        """Bring a pose to within `CLAMP_SIGMAS` of what is known, axis by axis."""
        residual = self.residual(T_camera_lidar)
        most = CLAMP_SIGMAS * np.array(self.sigmas)
        if (np.abs(residual) <= most).all():
            return T_camera_lidar
        clamped = np.clip(residual, -most, most)
        # A twist that moves the camera's centre one way has its translation the other way.
        return pose_at(self.T_camera_lidar, np.concatenate([-clamped[:3], clamped[3:]]))


def clamp(T_camera_lidar: Pose, priors: Sequence[Prior]) -> Pose:
    """Bring a pose near to what is known; the last one given is kept to the most."""
    for prior in priors:
        T_camera_lidar = prior.clamp(T_camera_lidar)
    return T_camera_lidar
