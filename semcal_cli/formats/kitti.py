"""KITTI's `Tr` (odometry, calib.txt) and `Tr_velo_to_cam` with `R0_rect` (object): p_camera0 = [R0_rect] T p_velo.

Camera 0 is the rectified one; the others are moved along its x axis, as `P1` to `P3` say (Geiger et al., *Vision meets
robotics: The KITTI dataset*, 2013, eqs. 3 to 6).
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source, checked, from_rows
from semcal_cli.formats.values import keyed_lines, numbers, rigid
from semcal_cli.geometry.poses import Pose

CAMERAS = ("P0", "P1", "P2", "P3")
OBJECT_KEY, ODOMETRY_KEY = "Tr_velo_to_cam", "Tr"


def _shift(source: Source, keyed: dict[str, str], options: FormatOptions) -> Pose:
    """T_camera_camera0 of the requested camera, `P0` to `P3`; the identity if none is requested."""
    T = np.eye(4)
    if options.camera is not None:
        if options.camera not in CAMERAS:
            raise InputError(f"--camera: found {options.camera!r}, needed one of: {', '.join(CAMERAS)}")
        P = numbers(source.path, keyed, options.camera, 12).reshape(3, 4)
        try:
            T[:3, 3] = np.linalg.solve(P[:, :3], P[:, 3])
        except np.linalg.LinAlgError:
            raise InputError(f"{source.path}: {options.camera}: found no K to invert, needed one") from None
    return rigid(f"{source.path}: {options.camera}", T)


def _read_odometry(source: Source, options: FormatOptions) -> Pose:
    keyed = keyed_lines(source.text)
    T = from_rows(f"{source.path}: {ODOMETRY_KEY}", numbers(source.path, keyed, ODOMETRY_KEY, 12), options)
    return _shift(source, keyed, options) @ T


def _read_object(source: Source, options: FormatOptions) -> Pose:
    keyed = keyed_lines(source.text)
    T = from_rows(f"{source.path}: {OBJECT_KEY}", numbers(source.path, keyed, OBJECT_KEY, 12), options)
    R0 = np.eye(4)
    R0[:3, :3] = numbers(source.path, keyed, "R0_rect", 9).reshape(3, 3)
    return _shift(source, keyed, options) @ checked(f"{source.path}: R0_rect", R0, options) @ T


def row(T: Pose) -> str:
    """Format the first 12 numbers of a transform, by rows."""
    return " ".join(map(repr, T[:3].ravel().tolist()))


def _check_camera(options: FormatOptions) -> None:
    if options.camera is not None:
        raise InputError(
            f"--to-camera: found {options.camera!r}, needed nothing: a new file has camera 0 alone"
        )


def _write_odometry(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    _check_camera(options)
    return f"{ODOMETRY_KEY}: {row(T_camera_lidar)}\n".encode()


def _write_object(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    _check_camera(options)
    identity = " ".join(map(repr, np.eye(3).ravel().tolist()))
    return f"R0_rect: {identity}\n{OBJECT_KEY}: {row(T_camera_lidar)}\n".encode()


def _has(source: Source, key: str) -> bool:
    with suppress(InputError):
        return key in keyed_lines(source.text)
    return False


ODOMETRY = Format(
    "kitti-odometry",
    "p_camera0 = Tr p_velo; --camera P2 for another camera",
    lambda source: _has(source, ODOMETRY_KEY),
    _read_odometry,
    _write_odometry,
    asks=("camera",),
)
OBJECT = Format(
    "kitti-object",
    "p_camera0 = R0_rect Tr_velo_to_cam p_velo; --camera P2 for another camera",
    lambda source: _has(source, OBJECT_KEY),
    _read_object,
    _write_object,
    asks=("camera",),
)
