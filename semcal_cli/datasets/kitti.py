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

from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.formats.values import camera_block, numbers, read_keyed, rigid, transform
from semcal_cli.geometry.poses import Pose

LIDAR = {"channels": 64, "columns": 2048, "fov_up_deg": 3.0, "fov_down_deg": -25.0}
"""Velodyne HDL-64E, 10 turns a second."""


def calibration(path: Path, camera: int, width: int, height: int) -> tuple[dict[str, Any], Pose]:
    """Read a calib.txt of KITTI odometry (`Tr`), or of KITTI object (`R0_rect` and `Tr_velo_to_cam`).

    Returns:
        The block of camera k, whose pictures have a size, and its T_camera_lidar.
    """
    keyed = read_keyed(path)
    if "Tr" in keyed:
        T_camera0_lidar = transform(path, keyed, "Tr")  # rectified already
    elif "Tr_velo_to_cam" in keyed:
        T_camera0_lidar = rotation(path, keyed, "R0_rect") @ transform(path, keyed, "Tr_velo_to_cam")
    else:
        raise InputError(f"{path}: found keys {listed(keyed)}, needed Tr, or R0_rect and Tr_velo_to_cam")
    P = projection(path, keyed, f"P{camera}")
    block = pinhole(path, f"P{camera}", P, width, height)
    return block, beside_camera0(path, f"P{camera}", P) @ T_camera0_lidar


def projection(path: Path, keyed: dict[str, str], key: str) -> npt.NDArray[np.float64]:
    """Read a projection (3, 4)."""
    return numbers(path, keyed, key, 12).reshape(3, 4)


def rotation(path: Path, keyed: dict[str, str], key: str) -> Pose:
    """Read a transform that turns only, of nine numbers.

    Raises:
        InputError: it is not there, or no rotation.
    """
    T = np.eye(4)
    T[:3, :3] = numbers(path, keyed, key, 9).reshape(3, 3)
    return rigid(f"{path}: {key}", T)


def translated(path: Path, key: str, translation: npt.ArrayLike) -> Pose:
    """Make a transform that moves only.

    Raises:
        InputError: it is too far.
    """
    T = np.eye(4)
    T[:3, 3] = translation
    return rigid(f"{path}: {key}", T)


def beside_camera0(path: Path, key: str, P: npt.NDArray[np.float64]) -> Pose:
    """T_camera_camera0 of a rectified camera from its projection (3, 4).

    Raises:
        InputError: K cannot be inverted, or the camera is too far.
    """
    try:
        with np.errstate(all="ignore"):
            return translated(path, key, np.linalg.solve(P[:, :3], P[:, 3]))
    except np.linalg.LinAlgError:
        raise InputError(f"{path}: {key}: found {P.tolist()}, needed a left 3 x 3 to invert") from None


def pinhole(path: Path, key: str, P: npt.NDArray[np.float64], width: int, height: int) -> dict[str, Any]:
    """The camera block of a rectified camera, from its projection (3, 4).

    Raises:
        InputError: the projection has no such K.
    """
    block = {"model": "plumb_bob", "width": width, "height": height, "K": P[:, :3].tolist()}
    return camera_block(path, block, {"K": key})
