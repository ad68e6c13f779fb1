"""The table of formats."""

from __future__ import annotations

from semcal_cli.errors import InputError, one_of
from semcal_cli.formats import bases, camera_info, documents, kalibr, kitti, matrix, opencv, ros, semcal, urdf
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
    kitti.RAW,
    kitti.KITTI_360,
    documents.RELLIS_3D,
    bases.NUSCENES,
    kalibr.FORMAT,
    documents.LIDAR2CAM,
    opencv.FORMAT,
    camera_info.FORMAT,
    documents.DIRECT_VISUAL_LIDAR,
    kitti.OPENCALIB,
    documents.FAST_LIVO2,
    documents.COLMAP,
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
