"""OpenCV FileStorage with `CameraExtrinsicMat` (4 x 4). Users store both directions, so --direction is needed.

The intrinsics beside it have the names of OpenCV's calibration sample (samples/cpp/.../camera_calibration.cpp), or
those of an omnidirectional camera (Mei and Rives) as camodocal and KITTI-360 write it.
"""

from __future__ import annotations

from dataclasses import replace

from semcal_cli.errors import InputError
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.formats.lenses import (
    LEAST_COUNTS,
    NAMES,
    OPENCV_MODELS,
    Intrinsics,
    LensReader,
    by_rows,
    check_lens,
    coefficients_of,
    intrinsic_matrix,
    names_in,
    numbers_of,
    refuse_camera,
)
from semcal_cli.formats.matrix import directed
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import from_rows
from semcal_cli.formats.storage import is_storage, numbers_in, parse_storage
from semcal_cli.formats.values import image_side
from semcal_cli.geometry.poses import Pose

KEY = "CameraExtrinsicMat"
MIRROR, PROJECTION, DISTORTION = "mirror_parameters", "projection_parameters", "distortion_parameters"
MEI_KEYS = {"K": PROJECTION, "distortion": DISTORTION, "parameters": MIRROR}


def _storage(source: Source) -> Node:
    return Node(str(source.path), parse_storage(source.text, source.path))


def _read(source: Source, options: FormatOptions) -> Pose:
    node = _storage(source).first(KEY)
    values = numbers_in(node)
    if len(values) not in (12, 16):
        raise InputError(f"{node.where}: found {len(values)} numbers, needed 16 by rows, or 12")
    return from_rows(node.where, values, options)


def _make(T: Pose, options: FormatOptions) -> bytes:
    lines = ["%YAML:1.0", "---", _matrix(KEY, 4, T.ravel().tolist())]
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


def _number(node: Node) -> float:
    values = numbers_in(node)
    if len(values) != 1:
        raise InputError(f"{node.where}: found {len(values)} numbers, needed one")
    return values[0]


def _side(storage: Node, side: str) -> int:
    node = storage.first(*NAMES[side])
    return image_side(node.where, _number(node))


def _mei(storage: Node) -> Intrinsics:
    fx, fy, cx, cy = (_number(storage.at(PROJECTION).first(key)) for key in ("gamma1", "gamma2", "u0", "v0"))
    block = {
        "model": "omnidirectional",
        "width": _side(storage, "width"),
        "height": _side(storage, "height"),
        "K": intrinsic_matrix(fx, fy, cx, cy),
        "distortion": [_number(storage.at(DISTORTION).first(key)) for key in ("k1", "k2", "p1", "p2")],
        "parameters": {"xi": _number(storage.at(MIRROR).first("xi"))},
    }
    return Intrinsics(block, MEI_KEYS)


def _read_lens(source: Source, camera: str | None, model: str | None) -> Intrinsics:
    refuse_camera(source.path, camera)
    storage = _storage(source)
    if MIRROR in storage.mapping:
        return _mei(storage)
    K, distortion = (storage.first(*NAMES[key]) for key in ("K", "distortion"))
    rows, coefficients = numbers_in(K), numbers_in(distortion)
    if len(rows) != 9:
        raise InputError(f"{K.where}: found {len(rows)} numbers, needed 9 by rows")
    block = {
        "model": model or _model(storage, distortion.where, len(coefficients)),
        "width": _side(storage, "width"),
        "height": _side(storage, "height"),
        "K": by_rows(rows),
        "distortion": coefficients,
    }
    return Intrinsics(block, names_in(storage.mapping))


def _model(storage: Node, where: str, num_coefficients: int) -> str:
    """Derive the camera model from the number of coefficients; cv2.fisheye, too, has four."""
    if "fisheye_model" in storage.mapping:
        if _number(storage.at("fisheye_model")):
            return "fisheye"
    elif num_coefficients == 4:
        found = "found 4 coefficients and no fisheye_model"
        raise InputError(f"{storage.where}: {found}, needed --model, as plumb_bob or fisheye")
    if num_coefficients not in OPENCV_MODELS:
        counts = ", ".join(map(str, OPENCV_MODELS))
        raise InputError(f"{where}: found {num_coefficients} numbers, needed one of: {counts}")
    return OPENCV_MODELS[num_coefficients]


FORMAT = replace(
    directed(
        "opencv",
        f"{KEY} of a FileStorage",
        lambda source: KEY in source.start and is_storage(source.start),
        _read,
        _make,
    ),
    lens=LensReader(lambda source: is_storage(source.start), _read_lens),
)
