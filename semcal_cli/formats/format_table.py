"""The table of formats."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import wraps
from types import UnionType
from typing import ParamSpec, TypeVar

import numpy as np

from semcal_cli.errors import InputError, describe, one_of
from semcal_cli.formats import (
    bases,
    camera_info,
    colmap,
    document_formats as documents,
    kalibr,
    kitti_files as kitti,
    mappers,
    matrix,
    opencalib_json,
    opencv,
    pose_covariances,
    ros,
    semcal,
    sensor_rigs,
    urdf,
)
from semcal_cli.formats.format import Format
from semcal_cli.plugins import Plugins

Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")
FORMATS: tuple[Format, ...] = (
    semcal.FORMAT,
    ros.COMMAND,
    ros.LAUNCH,
    ros.LAUNCH_PY,
    ros.TF2,
    ros.APOLLO,
    pose_covariances.POSE_WITH_COVARIANCE,
    pose_covariances.POSE3,
    bases.AUTOWARE,
    urdf.FORMAT,
    kitti.ODOMETRY,
    kitti.OBJECT,
    kitti.RAW,
    kitti.KITTI_360,
    documents.RELLIS_3D,
    bases.NUSCENES,
    sensor_rigs.ANYWHERE,
    sensor_rigs.DRIVEWORKS,
    kalibr.FORMAT,
    documents.LIDAR2CAM,
    opencv.FORMAT,
    camera_info.FORMAT,
    documents.DIRECT_VISUAL_LIDAR,
    kitti.OPENCALIB,
    opencalib_json.FORMAT,
    documents.FAST_LIVO2,
    mappers.R3LIVE,
    mappers.ODIN,
    colmap.FORMAT,
    mappers.EXTRINSIC_MATRIX,
    matrix.TUM,
    matrix.TEXT,
    matrix.ARRAY,
)
PLUGINS = Plugins("semcal.formats", (format.name for format in FORMATS))
"""Formats of other installed packages. They are asked for files that no format of semcal's recognises."""


def plugin_formats() -> list[Format]:
    """Load the formats of plugins, by the names of their entry points."""
    return [_guard(name, format) for name, format in PLUGINS.all(Format).items()]


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
        return _guard(name, plugin)
    names = [*(format.name for format in FORMATS), *PLUGINS.names]
    raise InputError(f"found format {name!r}, expected {one_of(name, names)}")


def _guard(name: str, format: Format) -> Format:
    """Name a plugin's format after its entry point, and name the plugin in the errors of its functions."""
    make, read_lens = format.make, format.read_lens
    return replace(
        format,
        name=name,
        equation=str(format.equation),
        recognises=PLUGINS.guard(name, format.recognises),
        read=PLUGINS.guard(name, _check_returned("read", np.ndarray, format.read)),
        make=None if make is None else PLUGINS.guard(name, _check_returned("make", bytes | dict, make)),
        read_lens=None
        if read_lens is None
        else PLUGINS.guard(name, _check_returned("read_lens", tuple | None, read_lens)),
    )


def _check_returned(
    field: str, kind: type | UnionType, function: Callable[Arguments, Returned]
) -> Callable[Arguments, Returned]:
    """Check what a function of a plugin returns."""

    @wraps(function)
    def call(*arguments: Arguments.args, **keywords: Arguments.kwargs) -> Returned:
        if not isinstance(result := function(*arguments, **keywords), kind):
            needed = getattr(kind, "__name__", kind)
            raise TypeError(f"{field}: found {describe(result)}, expected {needed}")
        return result

    return call
