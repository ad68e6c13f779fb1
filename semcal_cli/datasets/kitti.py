"""What KITTI's data sets have in common: rectified cameras, and how their calibration files chain up.

Geiger, Lenz, Stiller, Urtasun, *Vision meets Robotics: The KITTI Dataset*, 2013, eqs. 3 to 8: a LiDAR point lands at
`P_k R_rect T_camera0_lidar p`, with `P_k = K [I | inv(K) P_k[:, 3]]`, whose last column is the way from camera 0 to
camera k, along the baseline.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.datasets.files import numbers, read_keyed
from semcal_cli.datasets.trajectory import pose_from_rows
from semcal_cli.errors import InputError
from semcal_cli.poses import Pose

LIDAR = {"channels": 64, "columns": 2048, "fov_up_deg": 3.0, "fov_down_deg": -25.0}
"""Velodyne HDL-64E, 10 turns a second."""


def calibration(path: Path, camera: int) -> tuple[list[list[float]], Pose]:
    """Read a calib.txt of KITTI odometry (`Tr`), or of KITTI object (`R0_rect` and `Tr_velo_to_cam`).

    Returns:
        K of camera k, and its T_camera_lidar.
    """
    keyed = read_keyed(path)
    if "Tr" in keyed:
        T_camera0_lidar = pose_from_rows(numbers(path, keyed, "Tr", 12))  # rectified already
    elif "Tr_velo_to_cam" in keyed:
        R0_rect = rotation(numbers(path, keyed, "R0_rect", 9))
        T_camera0_lidar = R0_rect @ pose_from_rows(numbers(path, keyed, "Tr_velo_to_cam", 12))
    else:
        raise InputError(
            f"{path}: found keys {', '.join(keyed) or 'none'}, needed Tr, or R0_rect and Tr_velo_to_cam"
        )
    P = numbers(path, keyed, f"P{camera}", 12).reshape(3, 4)
    return P[:, :3].tolist(), beside_camera0(path, P) @ T_camera0_lidar


def beside_camera0(path: Path, P: npt.NDArray[np.float64]) -> Pose:
    """T_camera_camera0 of a rectified camera from its projection (3, 4).

    Raises:
        InputError: K cannot be inverted.
    """
    T = np.eye(4)
    try:
        T[:3, 3] = np.linalg.solve(P[:, :3], P[:, 3])
    except np.linalg.LinAlgError:
        raise InputError(
            f"{path}: found projection {P.tolist()}, needed one whose left 3 x 3 can be inverted"
        ) from None
    return T


def rotation(values: npt.NDArray[np.float64]) -> Pose:
    """Make a transform (4, 4) that turns only, of nine numbers."""
    T = np.eye(4)
    T[:3, :3] = values.reshape(3, 3)
    return T


def pinhole(K: list[list[float]], width: int, height: int) -> dict[str, Any]:
    """The camera block of a rectified camera."""
    return {"model": "plumb_bob", "width": width, "height": height, "K": K}
