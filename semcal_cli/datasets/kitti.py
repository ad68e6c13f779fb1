"""Cameras of KITTI's calibration files, rectified and raw, and the references of KITTI odometry.

Geiger, Lenz, Stiller, Urtasun, *Vision meets Robotics: The KITTI Dataset*, 2013, eqs. 3 to 8: a LiDAR point projects to
`P_k R_rect T_camera0_lidar p` with `P_k = K [I | inv(K) P_k[:, 3]]`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.formats.keyed import Keyed
from semcal_cli.formats.kitti import OBJECT_KEY, ODOMETRY_KEY, beside_camera0, object_pose, odometry_pose
from semcal_cli.formats.values import camera_block
from semcal_cli.geometry.poses import Pose

LIDAR = {"channels": 64, "columns": 2048, "fov_up_deg": 3.0, "fov_down_deg": -25.0}
"""Scan pattern of the Velodyne HDL-64E at 10 turns a second."""


def calibration(path: Path, camera: int, width: int, height: int) -> tuple[dict[str, Any], Pose]:
    """Read a calib.txt of KITTI odometry (`Tr`), or of KITTI object (`R0_rect` and `Tr_velo_to_cam`).

    Args:
        path: The file.
        camera: Number k of the camera.
        width: Columns of its images.
        height: Rows of its images.

    Returns:
        The `camera:` block of camera k, and its T_camera_lidar (4, 4), metres.

    Raises:
        InputError: a key is missing or wrong.
    """
    keyed = Keyed.read(path)
    read = {ODOMETRY_KEY: odometry_pose, OBJECT_KEY: object_pose}
    found = next((key for key in read if key in keyed.values), None)
    if found is None:
        keys = listed(keyed.values)
        raise InputError(f"{path}: found keys {keys}, needed Tr, or R0_rect and Tr_velo_to_cam")
    T_camera0_lidar, key = read[found](keyed), f"P{camera}"
    return pinhole(keyed, key, width, height), beside_camera0(keyed, key) @ T_camera0_lidar


def pinhole(keyed: Keyed, key: str, width: int, height: int) -> dict[str, Any]:
    """Make the camera block of a rectified camera from its projection matrix.

    Raises:
        InputError: the key is missing, or the left 3 x 3 of the matrix is no intrinsic matrix.
    """
    K = keyed.matrix(key, 3, 4)[:, :3]
    block = {"model": "plumb_bob", "width": width, "height": height, "K": K.tolist()}
    return camera_block(keyed.path, block, {"K": key})


def raw_camera(keyed: Keyed, camera: str) -> dict[str, Any]:
    """Read the camera block of a camera's raw images: K, D (k1 k2 p1 p2 k3) and S before rectification.

    Args:
        keyed: The file.
        camera: Number of the camera, as 00.

    Raises:
        InputError: a key is missing or wrong.
    """
    key, distortion = f"K_{camera}", f"D_{camera}"
    K = keyed.matrix(key, 3, 3)
    if not K[2].any():
        # KITTI-360's own perspective.txt prints the last row as 0 0 0.
        K[2, 2] = 1.0
    width, height = keyed.image_size(f"S_{camera}")
    block = {
        "model": "plumb_bob",
        "width": width,
        "height": height,
        "K": K.tolist(),
        "distortion": keyed.numbers(distortion, 5).tolist(),
    }
    return camera_block(keyed.path, block, {"K": key, "distortion": distortion})
