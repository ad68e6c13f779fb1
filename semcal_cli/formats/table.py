"""The table of formats."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from semcal_cli.errors import InputError, one_of
from semcal_cli.formats import bases, camera_info, documents, kalibr, kitti, matrix, opencv, ros, semcal, urdf
from semcal_cli.formats.format import Format
from semcal_cli.plugins import Plugins

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
PLUGINS = Plugins("semcal.formats", (format.name for format in FORMATS))
"""Formats of other installed packages. They are asked for files that no format of semcal's recognises."""


def plugin_formats() -> list[Format]:
    """Load the formats of plugins, by the names of their entry points."""
    return [replace(format, name=name) for name, format in PLUGINS.all(Format).items()]


def all_formats() -> Iterator[Format]:
    """Go through all formats; those of plugins are loaded after semcal's own."""
    yield from FORMATS
    yield from plugin_formats()


def find_format(name: str) -> Format:
    """Find a format of semcal's or of a plugin's by its name.

    Raises:
        InputError: there is no such format.
    """
    for format in FORMATS:
        if format.name == name:
            return format
    if (plugin := PLUGINS.get(name, Format)) is not None:
        return replace(plugin, name=name)
    known = [*(format.name for format in FORMATS), *PLUGINS.names]
    raise InputError(f"found format {name!r}, needed {one_of(name, known)}")
