"""The table of formats: a format is a module, and a line here."""

from __future__ import annotations

from semcal_cli.errors import InputError, one_of
from semcal_cli.formats import (
    autoware,
    camera_entries,
    camera_info,
    colmap,
    direct_visual_lidar,
    fast_livo2,
    kalibr,
    kitti,
    kitti_360,
    matrix,
    nuscenes,
    opencalib,
    opencv,
    rellis3d,
    ros,
    semcal,
    tf2,
    urdf,
)
from semcal_cli.formats.format import Format

FORMATS: tuple[Format, ...] = (
    semcal.FORMAT,
    ros.COMMAND,
    ros.LAUNCH,
    tf2.TF2,
    tf2.APOLLO,
    autoware.FORMAT,
    urdf.FORMAT,
    kitti.ODOMETRY,
    kitti.OBJECT,
    kitti_360.FORMAT,
    rellis3d.FORMAT,
    nuscenes.FORMAT,
    kalibr.FORMAT,
    camera_entries.LIDAR2CAM,
    opencv.FORMAT,
    camera_info.FORMAT,
    direct_visual_lidar.FORMAT,
    opencalib.FORMAT,
    fast_livo2.FORMAT,
    colmap.FORMAT,
    matrix.TUM,
    matrix.TEXT,
    matrix.ARRAY,
)


def find_format(name: str) -> Format:
    """Find a format by its name.

    Raises:
        InputError: there is no such format.
    """
    for format in FORMATS:
        if format.name == name:
            return format
    raise InputError(f"found format {name!r}, needed {one_of(name, [format.name for format in FORMATS])}")
