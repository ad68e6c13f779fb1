"""KITTI-360's calib_cam_to_velo.txt: p_velo = T p_camera0, twelve numbers (camera 0 before rectification)."""

from __future__ import annotations

from pathlib import Path

from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.keyed import row
from semcal_cli.formats.pose import from_rows
from semcal_cli.formats.values import parse_numbers
from semcal_cli.geometry.poses import Pose, inverse

FILE, KEY = "calib_cam_to_velo.txt", "camera 0 to LiDAR"


def camera0_pose(path: Path, text: str, options: FormatOptions | None = None) -> Pose:
    """Read T_camera0_lidar (4, 4) from the text of the file.

    Raises:
        InputError: the text is not a rigid transform of twelve numbers.
    """
    return inverse(from_rows(f"{path}: {KEY}", parse_numbers(path, KEY, text, 12), options))


def _read(source: Source, options: FormatOptions) -> Pose:
    return camera0_pose(source.path, source.text, options)


def _make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    return f"{row(inverse(T_camera_lidar))}\n".encode()


FORMAT = Format(
    "kitti-360",
    "p_velo = T p_camera0: calib_cam_to_velo.txt, known by its name; camera 0 before rectification",
    lambda source: source.path.name == FILE,
    _read,
    _make,
)
