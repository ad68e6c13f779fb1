"""The baseline: the distance of the camera from the LiDAR."""

from semcal_cli.errors import InputError
from semcal_cli.geometry.poses import Pose


def baseline_m(T_camera_lidar: Pose) -> float:
    """Distance between the camera's centre and the LiDAR's, metres."""
    x, y, z = T_camera_lidar[:3, 3].tolist()
    distance_m: float = (x * x + y * y + z * z) ** 0.5
    return distance_m


def within_baseline(T_camera_lidar: Pose, max_baseline_m: float) -> Pose:
    """Move the camera towards the LiDAR until it is within the largest allowed distance."""
    distance_m = baseline_m(T_camera_lidar)
    if distance_m <= max_baseline_m:
        return T_camera_lidar
    held = T_camera_lidar.copy()
    held[:3, 3] *= max_baseline_m / distance_m
    return held


def check_baseline(name: str, T_camera_lidar: Pose, max_baseline_m: float) -> None:
    """Check that the camera of a transform is within the largest allowed distance from the LiDAR.

    Raises:
        InputError: the camera is farther away; the message begins with `name`.
    """
    distance_m = baseline_m(T_camera_lidar)
    if distance_m > max_baseline_m:
        raise InputError(
            f"{name}: found the camera {distance_m:g} m from the LiDAR, needed at most {max_baseline_m:g} m; "
            f"--max-baseline-m sets the limit"
        )
