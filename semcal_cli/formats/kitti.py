"""KITTI's `Tr` (odometry, calib.txt) and `Tr_velo_to_cam` with `R0_rect` (object): p_camera0 = [R0_rect] T p_velo.

Camera 0 is the rectified one; the others are moved along its x axis, as `P1` to `P3` say (Geiger et al., *Vision meets
robotics: The KITTI dataset*, 2013, eqs. 3 to 8).
"""

from __future__ import annotations

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.keyed import keyed, row
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import from_line, rotation, transform
from semcal_cli.formats.values import rigid
from semcal_cli.geometry.poses import Pose

CAMERAS = ("P0", "P1", "P2", "P3")
ODOMETRY_KEY, OBJECT_KEY, RECTIFICATION = "Tr", "Tr_velo_to_cam", "R0_rect"


def beside_camera0(projection: Node) -> Pose:
    """Derive T_camera_camera0 (4, 4) of a rectified camera from its projection matrix.

    Raises:
        InputError: the matrix is wrong, K is singular, or the camera is too far away.
    """
    P = projection.matrix(3, 4)
    try:
        with np.errstate(all="ignore"):
            return rigid(projection.where, transform(np.eye(3), np.linalg.solve(P[:, :3], P[:, 3])))
    except np.linalg.LinAlgError:
        raise InputError(f"{projection.where}: found no K to invert, needed one") from None


def camera0_pose(lines: Node, key: str, options: FormatOptions | None = None) -> Pose:
    """Read T_camera0_lidar (4, 4) of the rectified camera 0 from the lines of a file, under one of the two keys.

    Raises:
        InputError: a number is missing or wrong, or a transform is not rigid.
    """
    T = from_line(lines.at(key), options)
    return T if key == ODOMETRY_KEY else rotation(lines.at(RECTIFICATION), options) @ T


def _format(name: str, equation: str, key: str, first_line: str = "") -> Format:
    def read(source: Source, options: FormatOptions) -> Pose:
        lines = keyed(source.path, source.text)
        T = camera0_pose(lines, key, options)
        if options.camera is None:
            return T
        if options.camera not in CAMERAS:
            raise InputError(f"--camera: found {options.camera!r}, needed one of: {', '.join(CAMERAS)}")
        return beside_camera0(lines.at(options.camera)) @ T

    def make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
        if options.camera is not None:
            needed = "needed nothing: a new file has camera 0 alone"
            raise InputError(f"--to-camera: found {options.camera!r}, {needed}")
        return f"{first_line}{key}: {row(T_camera_lidar)}\n".encode()

    equation = f"p_camera0 = {equation} p_velo; --camera P2 for another camera"
    return Format(name, equation, lambda source: key in source.lines.mapping, read, make, asks=("camera",))


ODOMETRY = _format("kitti-odometry", "Tr", ODOMETRY_KEY)
OBJECT = _format(
    "kitti-object",
    "R0_rect Tr_velo_to_cam",
    OBJECT_KEY,
    f"{RECTIFICATION}: {' '.join(map(repr, np.eye(3).ravel().tolist()))}\n",
)
