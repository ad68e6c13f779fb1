"""OpenCV FileStorage with `CameraExtrinsicMat` (4 x 4). Users store both directions, so --direction is needed.

The intrinsics beside it have the names of OpenCV's calibration sample (samples/cpp/.../camera_calibration.cpp).
"""

from __future__ import annotations

from contextlib import suppress

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source, from_rows, turned
from semcal_cli.formats.lenses import LEAST_COUNTS, check_lens, coefficients_of, numbers_of
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
    values: list[float] = turned("--to opencv", T_camera_lidar, options).ravel().tolist()
    lines = ["%YAML:1.0", "---", _matrix(KEY, 4, values)]
    if (camera := options.intrinsics) is not None:
        check_lens("--to opencv", camera, LEAST_COUNTS)
        coefficients = coefficients_of(camera)
        lines += [
            f"image_width: {camera.width}",
            f"image_height: {camera.height}",
            f"fisheye_model: {int(camera.model == 'fisheye')}",
            _matrix("camera_matrix", 3, numbers_of(camera)),
            _matrix("distortion_coefficients", len(coefficients), coefficients),
        ]
    return "".join(f"{line}\n" for line in lines).encode()


def _matrix(key: str, rows: int, values: list[float]) -> str:
    """Write a matrix of doubles as FileStorage does."""
    numbers = ", ".join(repr(value + 0.0) for value in values)
    cols = len(values) // rows
    return f"{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {numbers} ]"


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
