"""KITTI-360's calib_cam_to_velo.txt: p_velo = T p_camera0, twelve numbers (camera 0 before rectification)."""

from __future__ import annotations

from semcal_cli.formats.format import Format, FormatOptions, Source, from_rows
from semcal_cli.formats.kitti import row
from semcal_cli.formats.values import parse_numbers
from semcal_cli.geometry.poses import Pose, inverse

FILE = "calib_cam_to_velo.txt"


def _read(source: Source, options: FormatOptions) -> Pose:
    values = parse_numbers(source.path, "camera 0 to LiDAR", source.text, 12)
    return inverse(from_rows(str(source.path), values, options))


def _write(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    return f"{row(inverse(T_camera_lidar))}\n".encode()


FORMAT = Format(
    "kitti-360",
    "p_velo = T p_camera0: calib_cam_to_velo.txt, known by its name; camera 0 before rectification",
    lambda source: source.path.name == FILE,
    _read,
    _write,
)
