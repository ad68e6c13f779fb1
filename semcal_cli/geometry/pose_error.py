"""The error of a calibration against a reference."""

from dataclasses import dataclass

import numpy as np

from semcal_cli.geometry.poses import Pose, Vector, camera_center, rotation_difference, rotation_error_deg


@dataclass(frozen=True)
class PoseError:
    """The difference of `T_camera_lidar` from `T_reference`."""

    rotation_deg: float
    """Geodesic angle between the rotations."""
    camera_center_cm: float
    """Distance between the camera centres in the LiDAR frame."""
    rotation_xyz_deg: tuple[float, float, float]
    """Rotation vector of R R_ref^T, along the axes of the camera."""
    camera_center_xyz_cm: tuple[float, float, float]
    """Camera centre minus reference centre, along the axes of the reference camera."""

    @property
    def offsets(self) -> Vector:
        """Both along and about the axes of the camera (6,), metres and degrees, as half widths of intervals are."""
        return np.array([*(0.01 * x for x in self.camera_center_xyz_cm), *self.rotation_xyz_deg])


def compare_poses(T_camera_lidar: Pose, T_reference: Pose) -> PoseError:
    """Measure a calibration against a reference; both map LiDAR to camera."""
    center_lidar_cm = 100.0 * (camera_center(T_camera_lidar) - camera_center(T_reference))
    return PoseError(
        rotation_deg=rotation_error_deg(T_camera_lidar, T_reference),
        camera_center_cm=float(np.linalg.norm(center_lidar_cm)),
        rotation_xyz_deg=_xyz(np.degrees(rotation_difference(T_camera_lidar, T_reference))),
        camera_center_xyz_cm=_xyz(T_reference[:3, :3] @ center_lidar_cm),
    )


def _xyz(vector: Vector) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
