"""OpenCalib's calib.txt (K, D, T): p_camera = T p_lidar, T as 3 x 4 by rows."""

from __future__ import annotations

from semcal_cli.formats.format import Format
from semcal_cli.formats.keyed import Keyed, keyed_in, keyed_line

FORMAT = Format(
    "opencalib",
    "p_camera = T p_lidar: T of calib.txt",
    lambda source: {"T"} <= keyed_in(source).values.keys() <= {"K", "D", "T"},
    lambda source, options: Keyed(source.path, source.text).transform("T", options),
    lambda T_camera_lidar, options: keyed_line("T", T_camera_lidar),
)
