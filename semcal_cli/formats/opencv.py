"""OpenCV's FileStorage: a 4 x 4 or 3 x 4 matrix, which users store in both directions, so --direction is needed.

semcal writes `CameraExtrinsicMat`, as Autoware's calibration tools did; livox_camera_calib has `ExtrinsicMat`.

The intrinsics next to it have the names of OpenCV's calibration sample (samples/cpp/.../camera_calibration.cpp), or
those of an omnidirectional camera (Mei and Rives) as camodocal and KITTI-360 write it.

OpenCV's own parser aborts the process on many damaged files. Its YAML (modules/core/src/persistence_yml.cpp) differs
from the standard: a first line `%YAML:1.0`, tags on matrices, and, from older versions, no space after a key's colon.
Its XML (persistence_xml.cpp) writes a key as an element, an item of a sequence as an element `_`, and numbers separated
by blanks.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from semcal_cli.drive.camera import CameraModel
from semcal_cli.errors import InputError, counted, describe, listed
from semcal_cli.files.documents import parse_document
from semcal_cli.formats.format import CameraBlock, FormatOptions, Source
from semcal_cli.formats.lenses import (
    MIN_COUNTS,
    MODELS,
    NAMES,
    check_lens,
    coefficients_of,
    intrinsic_matrix,
    matrix_camera,
    model_by_count,
    refuse_camera,
)
from semcal_cli.formats.matrix import SHAPES, directed_format
from semcal_cli.formats.node import NUMBER, Node
from semcal_cli.formats.pose import from_rows, rounded
from semcal_cli.geometry.arrays import Pose

KEY = "CameraExtrinsicMat"
"""Key of the matrix that is written, and that is read first."""
STORAGE = "opencv_storage"
"""Root element of the XML."""
NEAR_ROTATION = 0.1
"""Largest difference of R R^T from the identity by which a transform is told from a projection."""
MIRROR, PROJECTION, DISTORTION = "mirror_parameters", "projection_parameters", "distortion_parameters"
ORB = "Camera.{}", "Camera1.{}"
"""Names of a camera's parameters in the settings of ORB-SLAM2 and ORB-SLAM3 (Examples/Monocular/*.yaml)."""
ORB_TYPES: dict[str, CameraModel] = {"PinHole": "plumb_bob", "KannalaBrandt8": "fisheye"}
DIRECTIVE_OR_TAG = re.compile(r"\A\s*%YAML[: ]1\.\d[^\n]*|!!opencv-\w+|!<tag:[^>\n]{0,200}>")
MISSING_SPACE = re.compile(r"^([ \t]*[A-Za-z_]\w*):(?=[^\s])", re.MULTILINE)


def is_storage(text: str) -> bool:
    """Return whether a text was written by OpenCV."""
    return text.lstrip().startswith(("%YAML:", "<")) or "opencv-matrix" in text


def _is_storage_of_opencv(text: str) -> bool:
    """Return whether a text was written by OpenCV, and is no other XML."""
    return is_storage(text) and (not text.startswith("<") or f"<{STORAGE}" in text)


def _storage(source: Source) -> Node:
    text = source.text
    if text.lstrip().startswith("<"):
        return Node(str(source.path), _parse_xml(source))
    text = MISSING_SPACE.sub(r"\1: ", blank_storage(text))
    return Node(str(source.path), parse_document(text, source.path))


def blank_storage(text: str) -> str:
    """Blank what is no standard YAML in a FileStorage, so that all else keeps its place."""
    return DIRECTIVE_OR_TAG.sub(lambda match: re.sub(r"\S", " ", match[0]), text)


def _parse_xml(source: Source) -> dict[Any, Any]:
    path, root = source.path, source.xml
    try:
        document = _value(root)
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if root.tag != STORAGE or not isinstance(document, dict):
        raise InputError(f"{path}: found XML of {describe(root.tag)}, expected '{STORAGE}' with keys in it")
    return document


def _value(element: ET.Element) -> Any:
    """Convert an element to a mapping, a list, text, a number or a list of numbers."""
    if len(element):
        if all(child.tag == "_" for child in element):
            return [_value(child) for child in element]
        mapping: dict[str, Any] = {}
        for child in element:
            if child.tag in mapping:
                raise ValueError(f"key {describe(child.tag)} is given twice")
            mapping[child.tag] = _value(child)
        return mapping
    text = (element.text or "").strip()
    words = text.split()
    if not words or not all(NUMBER.fullmatch(word) for word in words):
        return text.strip('"')
    values = [float(word) for word in words]
    # The data of a matrix is a list, even of one number.
    return values if len(values) > 1 or element.tag == "data" else values[0]


def _read(source: Source, options: FormatOptions) -> Pose:
    node = _find_matrix(_storage(source), options)
    values = node.data()
    if len(values) not in (12, 16):
        raise InputError(f"{node.where}: found {counted(len(values), 'number')}, needed 16 by rows, or 12")
    return from_rows(node.where, values, options)


def _find_matrix(storage: Node, options: FormatOptions) -> Node:
    """Find the matrix with the name that the user gives, or the only one that can be a transform."""
    name, needed = options.camera, f"add {options.option('camera')} to name one{options.hint('camera')}"
    if name is None and KEY in storage.mapping:
        return storage.at(KEY)
    matrices = {key: storage.at(key) for key, value in storage.mapping.items() if _has_shape(value)}
    if name is not None:
        if name not in matrices:
            raise InputError(f"{storage.where}: found matrices {listed(matrices)}; {needed}")
        return matrices[name]
    if not matrices:
        expected = f"expected a 4 x 4 or 3 x 4 matrix, such as {KEY}"
        raise InputError(f"{storage.where}: found keys {listed(storage.mapping)}, {expected}")
    # Beside a transform may be projections, P.
    transforms = [node for node in matrices.values() if len(matrices) == 1 or _is_rotated(node)]
    if len(transforms) != 1:
        raise InputError(f"{storage.where}: found matrices {listed(matrices)}; {needed}")
    return transforms[0]


def _has_shape(value: object) -> bool:
    return isinstance(value, dict) and "data" in value and (value.get("rows"), value.get("cols")) in SHAPES


def _is_rotated(matrix: Node) -> bool:
    values = np.asarray(matrix.data(), np.float64)
    if len(values) not in (12, 16):
        return True
    R = values.reshape(-1, 4)[:3, :3]
    return bool(np.abs(R @ R.T - np.eye(3)).max() < NEAR_ROTATION)


def _make(T: Pose, options: FormatOptions) -> bytes:
    lines = ["%YAML:1.0", "---", _matrix(KEY, 4, rounded(T.ravel()))]
    if (camera := options.intrinsics) is not None:
        check_lens(f"{options.option('to')} opencv", camera, MIN_COUNTS)
        coefficients = coefficients_of(camera)
        lines += [
            f"image_width: {camera.width}",
            f"image_height: {camera.height}",
            f"fisheye_model: {int(camera.model == 'fisheye')}",
            _matrix("camera_matrix", 3, np.ravel(camera.K).tolist()),
            _matrix("distortion_coefficients", len(coefficients), coefficients),
        ]
    return "".join(f"{line}\n" for line in lines).encode()


def _matrix(key: str, rows: int, values: list[float]) -> str:
    """Write a matrix of doubles as FileStorage does."""
    numbers = ", ".join(repr(value + 0.0) for value in values)
    cols = len(values) // rows
    return f"{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {numbers} ]"


def _mei(storage: Node) -> CameraBlock:
    fx, fy, cx, cy = (storage.at(PROJECTION).at(key).number() for key in ("gamma1", "gamma2", "u0", "v0"))
    block = {
        "model": "omnidirectional",
        "width": storage.first(NAMES["width"]).side(),
        "height": storage.first(NAMES["height"]).side(),
        "K": intrinsic_matrix(fx, fy, cx, cy),
        "distortion": [storage.at(DISTORTION).at(key).number() for key in ("k1", "k2", "p1", "p2")],
        "parameters": {"xi": storage.at(MIRROR).at("xi").number()},
    }
    return CameraBlock(block, {"K": PROJECTION, "distortion": DISTORTION, "parameters": MIRROR})


def _orb(storage: Node, pattern: str) -> CameraBlock:
    """Read the camera of ORB-SLAM's settings: `Camera.fx` and so on, where k3 may be missing."""

    def value(name: str) -> float:
        return storage.at(pattern.format(name)).number()

    kind = str(storage.mapping.get("Camera.type", "PinHole"))
    if kind not in ORB_TYPES:
        raise storage.at("Camera.type").mismatch(f"one of: {', '.join(ORB_TYPES)}")
    names = ["k1", "k2", "k3", "k4"] if kind == "KannalaBrandt8" else ["k1", "k2", "p1", "p2", "k3"]
    is_given = [pattern.format(name) in storage.mapping for name in names]
    if kind == "PinHole" and not is_given[4]:
        names = names[:4] if any(is_given) else []
    block = {
        "model": ORB_TYPES[kind],
        "width": storage.at("Camera.width").side(),
        "height": storage.at("Camera.height").side(),
        "K": intrinsic_matrix(*map(value, ("fx", "fy", "cx", "cy"))),
        "distortion": [value(name) for name in names],
    }
    return CameraBlock(block, {"K": pattern.format("fx"), "distortion": pattern.format("k1")})


def _read_lens(source: Source, camera: str | None, model: str | None) -> CameraBlock | None:
    def model_of(distortion: Node, count: int) -> str:
        """Derive the camera model from the number of coefficients; cv2.fisheye also has four."""
        if model is not None:
            return model
        is_named = "fisheye_model" in storage.mapping
        if is_named and storage.at("fisheye_model").number():
            return "fisheye"
        if is_named and count in MODELS:
            return MODELS[count]
        return model_by_count(distortion, count, because="no fisheye_model")

    if not is_storage(source.start):
        return None
    refuse_camera(source.path, camera)
    storage = _storage(source)
    if MIRROR in storage.mapping:
        return _mei(storage)
    for pattern in ORB:
        if pattern.format("fx") in storage.mapping:
            return _orb(storage, pattern)
    block, keys = matrix_camera(storage, model_of)
    # A FileStorage writes whole numbers of a matrix of doubles without decimals.
    block |= {key: np.asarray(block[key], np.float64).tolist() for key in ("K", "distortion")}
    return CameraBlock(block, keys)


FORMAT = directed_format(
    "opencv",
    f"{KEY} of a FileStorage, its only 4 x 4 or 3 x 4 matrix, or the one that --camera names",
    lambda source: _is_storage_of_opencv(source.start),
    _read,
    _make,
    may_ask=("camera",),
    read_lens=_read_lens,
)
