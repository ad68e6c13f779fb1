"""Priors: measurements of a camera's pose that are known beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli.geometry.poses import Pose, camera_center, rotation_difference
from semcal_cli.geometry.twists import inverse_left_jacobian, pose_at

CLAMP_SIGMAS = 3.0
"""Standard deviations to which the refinement clamps a pose at the start of each level. A normal error exceeds them
once in 400 times."""
EXACT = 1e-6
"""Standard deviation, metres or radians, below which an axis counts as known exactly, so that sums do not round."""


@dataclass(frozen=True)
class Prior:
    """Known pose of a camera, with a standard deviation for each axis."""

    name: str
    """Name of the prior in messages and results."""
    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres; arbitrary along unknown axes."""
    sigmas: tuple[float, ...]
    """(6,) standard deviations of the camera's position along its axes, metres, and of its rotation about them,
    radians: 0 for an exact axis, infinite for an unknown one."""

    def residual(self, T_camera_lidar: Pose) -> npt.NDArray[np.float64]:
        """Compute the offset (6,) of a pose along the axes of this camera: position, metres, and rotation, radians."""
        moved = camera_center(T_camera_lidar) - camera_center(self.T_camera_lidar)
        turned = rotation_difference(T_camera_lidar, self.T_camera_lidar)
        return np.concatenate([self.T_camera_lidar[:3, :3] @ moved, turned])

    def jacobian(self, T_camera_lidar: Pose) -> npt.NDArray[np.float64]:
        """Compute the derivatives (6, 6) of the residual with respect to a twist on the left of the pose."""
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = -self.T_camera_lidar[:3, :3] @ T_camera_lidar[:3, :3].T
        jacobian[3:, 3:] = inverse_left_jacobian(rotation_difference(T_camera_lidar, self.T_camera_lidar))
        return jacobian

    def describe(self) -> dict[str, object]:
        """Describe the prior for a result file, with null for unknown axes."""
        sigmas = [sigma if math.isfinite(sigma) else None for sigma in self.sigmas]
        return {
            "name": self.name,
            "T_camera_lidar": self.T_camera_lidar.tolist(),
            "sigma_camera_center_m": sigmas[:3],
            "sigma_rotation_deg": [None if sigma is None else math.degrees(sigma) for sigma in sigmas[3:]],
        }

    @property
    def exact(self) -> Prior:
        """The same prior with only its exact axes known."""
        return replace(self, sigmas=tuple(0.0 if sigma <= EXACT else math.inf for sigma in self.sigmas))

    def allows(self, T_camera_lidar: Pose, center_m: float, rotation_rad: float) -> bool:
        """Whether a pose is possible under this prior, within `CLAMP_SIGMAS`.

        Args:
            T_camera_lidar: (4, 4), metres.
            center_m: Possible error of the pose's position along each axis.
            rotation_rad: Possible error of its rotation about each axis.
        """
        slack = np.repeat([center_m, rotation_rad], 3)
        most = CLAMP_SIGMAS * np.array(self.sigmas) + slack
        return bool((np.abs(self.residual(T_camera_lidar)) <= most).all())

    def clamp(self, T_camera_lidar: Pose) -> Pose:
        """Clamp a pose (4, 4) to within `CLAMP_SIGMAS` of the prior, axis by axis."""
        residual = self.residual(T_camera_lidar)
        most = CLAMP_SIGMAS * np.array(self.sigmas)
        if (np.abs(residual) <= most).all():
            return T_camera_lidar
        clamped = np.clip(residual, -most, most)
        # The translation of a twist moves the camera's centre in the opposite direction.
        return pose_at(self.T_camera_lidar, np.concatenate([-clamped[:3], clamped[3:]]))


def clamp(T_camera_lidar: Pose, priors: Sequence[Prior]) -> Pose:
    """Clamp a pose (4, 4) to each prior in turn; only the last one is met exactly."""
    for prior in priors:
        T_camera_lidar = prior.clamp(T_camera_lidar)
    return T_camera_lidar
