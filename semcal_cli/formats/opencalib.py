"""OpenCalib's calib.txt (K, D, T): p_camera = T p_lidar, T as 3 x 4 by rows."""

from __future__ import annotations

from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.keyed import keyed, row
from semcal_cli.formats.pose import from_line
from semcal_cli.geometry.poses import Pose


def _read(source: Source, options: FormatOptions) -> Pose:
    return from_line(keyed(source.path, source.text).at("T"), options)


FORMAT = Format(
    "opencalib",
    "p_camera = T p_lidar: T of calib.txt",
    lambda source: {"T"} <= source.lines.mapping.keys() <= {"K", "D", "T"},
    _read,
    lambda T_camera_lidar, options: f"T: {row(T_camera_lidar)}\n".encode(),
)
