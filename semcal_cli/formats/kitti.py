"""KITTI's `Tr` (odometry, calib.txt) and `Tr_velo_to_cam` with `R0_rect` (object): p_camera0 = [R0_rect] T p_velo.

Camera 0 is the rectified one; the others are moved along its x axis, as `P1` to `P3` say:
`P_k = K [I | inv(K) P_k[:, 3]]`
(Geiger et al., *Vision meets robotics: The KITTI dataset*, 2013, eqs. 3 to 8).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.keyed import Keyed, keyed_in, keyed_line
from semcal_cli.formats.pose import transform
from semcal_cli.formats.values import rigid
from semcal_cli.geometry.poses import Pose

CAMERAS = ("P0", "P1", "P2", "P3")
OBJECT_KEY, ODOMETRY_KEY, RECTIFICATION = "Tr_velo_to_cam", "Tr", "R0_rect"


def odometry_pose(keyed: Keyed, options: FormatOptions | None = None) -> Pose:
    """Read T_camera0_lidar (4, 4) of the rectified camera 0 from a file of KITTI odometry.

    Raises:
        InputError: the key is missing or wrong.
    """
    return keyed.transform(ODOMETRY_KEY, options)


def object_pose(keyed: Keyed, options: FormatOptions | None = None) -> Pose:
    """Read T_camera0_lidar (4, 4) of the rectified camera 0 from a file of KITTI object.

    Raises:
        InputError: a key is missing or wrong.
    """
    T_unrectified = keyed.transform(OBJECT_KEY, options)
    return keyed.rotation(RECTIFICATION, options) @ T_unrectified


def beside_camera0(keyed: Keyed, key: str) -> Pose:
    """Derive T_camera_camera0 (4, 4) of a rectified camera from its projection matrix.

    Raises:
        InputError: the key is missing, K is singular, or the camera is too far away.
    """
    P = keyed.matrix(key, 3, 4)
    try:
        with np.errstate(all="ignore"):
            return rigid(keyed.where(key), transform(np.eye(3), np.linalg.solve(P[:, :3], P[:, 3])))
    except np.linalg.LinAlgError:
        raise InputError(f"{keyed.where(key)}: found no K to invert, needed one") from None


def _format(
    name: str, equation: str, key: str, pose: Callable[[Keyed, FormatOptions], Pose], first_lines: str = ""
) -> Format:
    def read(source: Source, options: FormatOptions) -> Pose:
        keyed = Keyed(source.path, source.text)
        T_camera0_lidar = pose(keyed, options)
        if options.camera is None:
            return T_camera0_lidar
        if options.camera not in CAMERAS:
            raise InputError(f"--camera: found {options.camera!r}, needed one of: {', '.join(CAMERAS)}")
        return beside_camera0(keyed, options.camera) @ T_camera0_lidar

    def make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
        if options.camera is not None:
            needed = "needed nothing: a new file has camera 0 alone"
            raise InputError(f"--to-camera: found {options.camera!r}, {needed}")
        return first_lines.encode() + keyed_line(key, T_camera_lidar)

    equation = f"{equation}; --camera P2 for another camera"
    return Format(name, equation, lambda source: key in keyed_in(source).values, read, make, asks=("camera",))


ODOMETRY = _format("kitti-odometry", "p_camera0 = Tr p_velo", ODOMETRY_KEY, odometry_pose)
OBJECT = _format(
    "kitti-object",
    "p_camera0 = R0_rect Tr_velo_to_cam p_velo",
    OBJECT_KEY,
    object_pose,
    f"{RECTIFICATION}: {' '.join(map(repr, np.eye(3).ravel().tolist()))}\n",
)
