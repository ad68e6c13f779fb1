"""Cameras of KITTI's calibration files, rectified and raw, and the references of KITTI odometry.

Geiger, Lenz, Stiller, Urtasun, *Vision meets Robotics: The KITTI Dataset*, 2013, eqs. 3 to 8: a LiDAR point projects to
`P_k R_rect T_camera0_lidar p` with `P_k = K [I | inv(K) P_k[:, 3]]`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError, listed
from semcal_cli.formats.kitti import OBJECT_KEY, ODOMETRY_KEY, beside_camera0, camera0_pose, read_keyed
from semcal_cli.formats.node import Node, camera_block, image_side
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
    lines = read_keyed(path)
    key = next((key for key in (ODOMETRY_KEY, OBJECT_KEY) if key in lines.mapping), None)
    if key is None:
        found = f"found keys {listed(lines.mapping)}"
        raise InputError(f"{path}: {found}, needed Tr, or R0_rect and Tr_velo_to_cam")
    T_camera0_lidar, projection = camera0_pose(lines, key), lines.at(f"P{camera}")
    return pinhole(projection, width, height), beside_camera0(projection) @ T_camera0_lidar


def pinhole(projection: Node, width: int, height: int) -> dict[str, Any]:
    """Make the camera block of a rectified camera from its projection matrix.

    Raises:
        InputError: the left 3 x 3 of the matrix is no intrinsic matrix.
    """
    K = projection.matrix(3, 4)[:, :3]
    block = {"model": "plumb_bob", "width": width, "height": height, "K": K.tolist()}
    return camera_block(projection.file, block, {"K": projection.key})


def raw_camera(keyed: Node, camera: str) -> dict[str, Any]:
    """Read the camera block of a camera's raw images: K, D (k1 k2 p1 p2 k3) and S before rectification.

    Args:
        keyed: The file.
        camera: Number of the camera, as 00.

    Raises:
        InputError: a key is missing or wrong.
    """
    key, distortion = f"K_{camera}", f"D_{camera}"
    K = keyed.at(key).matrix(3, 3)
    if not K[2].any():
        # KITTI-360's own perspective.txt prints the last row as 0 0 0.
        K[2, 2] = 1.0
    width, height = image_size(keyed.at(f"S_{camera}"))
    block = {
        "model": "plumb_bob",
        "width": width,
        "height": height,
        "K": K.tolist(),
        "distortion": keyed.at(distortion).numbers(5),
    }
    return camera_block(keyed.file, block, {"K": key, "distortion": distortion})


def image_size(sides: Node) -> tuple[int, int]:
    """Read the width and height of images, in pixels.

    Raises:
        InputError: the values are no whole numbers of pixels.
    """
    width, height = (image_side(sides.where, side) for side in sides.numbers(2))
    return width, height
