"""The table of formats."""

from __future__ import annotations

from semcal_cli.errors import InputError, one_of
from semcal_cli.formats import bases, camera_info, entries, kalibr, kitti, matrix, opencv, ros, semcal, urdf
from semcal_cli.formats.format import Format

FORMATS: tuple[Format, ...] = (
    semcal.FORMAT,
    ros.COMMAND,
    ros.LAUNCH,
    ros.TF2,
    ros.APOLLO,
    bases.AUTOWARE,
    urdf.FORMAT,
    kitti.ODOMETRY,
    kitti.OBJECT,
    kitti.KITTI_360,
    entries.RELLIS_3D,
    bases.NUSCENES,
    kalibr.FORMAT,
    entries.LIDAR2CAM,
    opencv.FORMAT,
    camera_info.FORMAT,
    entries.DIRECT_VISUAL_LIDAR,
    kitti.OPENCALIB,
    entries.FAST_LIVO2,
    entries.COLMAP,
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
