"""References whose camera frame is probably that of the camera's body, instead of the optical one."""

from __future__ import annotations

from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose


def body_frame_doubts(name: str, T_camera_lidar: Pose, option: str) -> list[str]:
    """Describe why the frame of a camera may be a body frame: its z axis is the LiDAR's.

    Args:
        name: Name of the frame, or of the file that states it.
        T_camera_lidar: (4, 4), as it is stated.
        option: Option by which the user states the axes.

    Returns:
        One sentence, or none.
    """
    if not InitialPose(T_camera_lidar, name).looks_along_z:
        return []
    where = "up" if T_camera_lidar[2, 2] > 0.0 else "down"
    return [
        f"{name} is probably a body frame (x forward, y left, z up): as an optical one (x right, y down, z "
        f"forward), the camera looks {where} along the LiDAR's z axis. {option} body converts the reference, and "
        f"{option} optical keeps it"
    ]
