"""Calibration files of KITTI's data sets: cameras, rectified and raw, and the chain of their transforms.

Geiger, Lenz, Stiller, Urtasun, *Vision meets Robotics: The KITTI Dataset*, 2013, eqs. 3 to 8: a LiDAR point projects to
`P_k R_rect T_camera0_lidar p` with `P_k = K [I | inv(K) P_k[:, 3]]`. The last column is the translation of
T_camera_k_camera_0, along the baseline.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.formats.values import camera_block, image_side, numbers, read_keyed, rigid, transform
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
    """Read a projection matrix (3, 4), pixels.

    Raises:
        InputError: the key is missing, or does not hold 12 numbers.
    """
    return numbers(path, keyed, key, 12).reshape(3, 4)


def rotation(path: Path, keyed: dict[str, str], key: str) -> Pose:
    """Read a pure rotation of nine numbers as a transform (4, 4).

    Raises:
        InputError: the key is missing, or its numbers are no rotation.
    """
    T = np.eye(4)
    T[:3, :3] = numbers(path, keyed, key, 9).reshape(3, 3)
    return rigid(f"{path}: {key}", T)


def translated(path: Path, key: str, translation: npt.ArrayLike) -> Pose:
    """Make a transform (4, 4) that is a pure translation, in metres.

    Raises:
        InputError: the translation is too long.
    """
    T = np.eye(4)
    T[:3, 3] = translation
    return rigid(f"{path}: {key}", T)


def beside_camera0(path: Path, key: str, P: npt.NDArray[np.float64]) -> Pose:
    """Derive T_camera_camera0 (4, 4) of a rectified camera from its projection matrix (3, 4).

    Raises:
        InputError: K is singular, or the camera is too far away.
    """
    try:
        with np.errstate(all="ignore"):
            return translated(path, key, np.linalg.solve(P[:, :3], P[:, 3]))
    except np.linalg.LinAlgError:
        raise InputError(f"{path}: {key}: found {P.tolist()}, needed an invertible left 3 x 3") from None


def pinhole(path: Path, key: str, P: npt.NDArray[np.float64], width: int, height: int) -> dict[str, Any]:
    """Make the camera block of a rectified camera from its projection matrix (3, 4).

    Raises:
        InputError: the left 3 x 3 of the matrix is no intrinsic matrix.
    """
    block = {"model": "plumb_bob", "width": width, "height": height, "K": P[:, :3].tolist()}
    return camera_block(path, block, {"K": key})


def raw_camera(path: Path, keyed: dict[str, str], camera: str) -> dict[str, Any]:
    """Read the camera block of a camera's raw images: K, D (k1 k2 p1 p2 k3) and S before rectification.

    Args:
        path: The file.
        keyed: Its lines.
        camera: Number of the camera, as 00.

    Raises:
        InputError: a key is missing or wrong.
    """
    key, distortion = f"K_{camera}", f"D_{camera}"
    K = numbers(path, keyed, key, 9).reshape(3, 3)
    if not K[2].any():
        # KITTI-360's own perspective.txt prints the last row as 0 0 0.
        K[2, 2] = 1.0
    width, height = image_size(path, keyed, f"S_{camera}")
    block = {
        "model": "plumb_bob",
        "width": width,
        "height": height,
        "K": K.tolist(),
        "distortion": numbers(path, keyed, distortion, 5).tolist(),
    }
    return camera_block(path, block, {"K": key, "distortion": distortion})


def image_size(path: Path, keyed: dict[str, str], key: str) -> tuple[int, int]:
    """Read the width and height of images, in pixels.

    Raises:
        InputError: the key is missing, or its values are no whole numbers of pixels.
    """
    width, height = (image_side(f"{path}: {key}", side) for side in numbers(path, keyed, key, 2).tolist())
    return width, height
