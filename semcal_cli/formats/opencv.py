"""OpenCV FileStorage with `CameraExtrinsicMat` (4 x 4). Users store both directions, so --direction is needed."""

from __future__ import annotations

from contextlib import suppress

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source, from_rows, turned
from semcal_cli.formats.storage import Storage, is_storage
from semcal_cli.geometry.poses import Pose

KEY = "CameraExtrinsicMat"


def _read(source: Source, options: FormatOptions) -> Pose:
    values = Storage(source.path, source.text).numbers(KEY)
    if len(values) not in (12, 16):
        raise InputError(f"{source.path}: {KEY}: found {len(values)} numbers, needed 16 by rows, or 12")
    where = f"{source.path}: {KEY}"
    return turned(where, from_rows(where, values, options), options)


def _write(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    values = ", ".join(map(repr, turned("--to opencv", T_camera_lidar, options).ravel().tolist()))
    matrix = f"!!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [ {values} ]"
    return f"%YAML:1.0\n---\n{KEY}: {matrix}\n".encode()


def _recognises(source: Source) -> bool:
    with suppress(InputError):
        return is_storage(source.text) and KEY in source.text
    return False


FORMAT = Format(
    "opencv",
    f"p = T p of --direction: {KEY} of a FileStorage",
    _recognises,
    _read,
    _write,
    asks=("direction",),
)
