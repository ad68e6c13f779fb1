"""OpenCV's FileStorage: `CameraExtrinsicMat` (4 x 4), which users store in both directions, so --direction is needed.

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

from semcal_cli.errors import InputError, counted, describe
from semcal_cli.files.documents import parse_document
from semcal_cli.formats.format import CameraBlock, FormatOptions, Source
from semcal_cli.formats.lenses import (
    MIN_COUNTS,
    NAMES,
    check_lens,
    coefficients_of,
    intrinsic_matrix,
    matrix_camera,
    numbers_of,
    refuse_camera,
)
from semcal_cli.formats.matrix import directed_format
from semcal_cli.formats.node import NUMBER, Node
from semcal_cli.formats.pose import from_rows
from semcal_cli.geometry.arrays import Pose

KEY = "CameraExtrinsicMat"
MIRROR, PROJECTION, DISTORTION = "mirror_parameters", "projection_parameters", "distortion_parameters"
MODELS = {4: "plumb_bob", 5: "plumb_bob", 8: "rational_polynomial", 12: "thin_prism", 14: "thin_prism"}
"""Camera model of each number of coefficients, if the lens is not a fisheye."""
YAML_REPLACEMENTS = (
    (re.compile(r"\A\s*%YAML[: ]1\.\d[^\n]*\n"), ""),
    (re.compile(r"!!opencv-\w+|!<tag:[^>\n]{0,200}>"), ""),
    (re.compile(r"^([ \t]*[A-Za-z_]\w*):(?=[^\s])", re.MULTILINE), r"\1: "),
)


def is_storage(text: str) -> bool:
    """Return whether a text was written by OpenCV."""
    return text.lstrip().startswith(("%YAML:", "<")) or "opencv-matrix" in text


def _storage(source: Source) -> Node:
    text = source.text
    if text.lstrip().startswith("<"):
        return Node(str(source.path), _parse_xml(source))
    for pattern, replacement in YAML_REPLACEMENTS:
        text = pattern.sub(replacement, text)
    return Node(str(source.path), parse_document(text, source.path))


def _parse_xml(source: Source) -> dict[Any, Any]:
    path, root = source.path, source.xml
    try:
        document = _value(root)
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if root.tag != "opencv_storage" or not isinstance(document, dict):
        raise InputError(
            f"{path}: found XML of {describe(root.tag)}, needed 'opencv_storage' with keys in it"
        )
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
    node = _storage(source).at(KEY)
    values = node.data()
    if len(values) not in (12, 16):
        raise InputError(f"{node.where}: found {counted(len(values), 'number')}, needed 16 by rows, or 12")
    return from_rows(node.where, values, options)


def _make(T: Pose, options: FormatOptions) -> bytes:
    lines = ["%YAML:1.0", "---", _matrix(KEY, 4, T.ravel().tolist())]
    if (camera := options.intrinsics) is not None:
        check_lens("--to opencv", camera, MIN_COUNTS)
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


def _read_lens(source: Source, camera: str | None, model: str | None) -> CameraBlock | None:
    def model_of(distortion: Node, count: int) -> str:
        """Derive the camera model from the number of coefficients; cv2.fisheye also has four."""
        if model is not None:
            return model
        if "fisheye_model" in storage.mapping:
            if storage.at("fisheye_model").number():
                return "fisheye"
        elif count == 4:
            problem = "found 4 coefficients and no fisheye_model"
            raise InputError(f"{storage.where}: {problem}, needed --model, such as plumb_bob or fisheye")
        if count not in MODELS:
            counts = ", ".join(map(str, MODELS))
            raise InputError(f"{distortion.where}: found {counted(count, 'number')}, needed one of: {counts}")
        return MODELS[count]

    if not is_storage(source.start):
        return None
    refuse_camera(source.path, camera)
    storage = _storage(source)
    if MIRROR in storage.mapping:
        return _mei(storage)
    block, keys = matrix_camera(storage, model_of)
    # A FileStorage writes whole numbers of a matrix of doubles without decimals.
    block |= {key: np.asarray(block[key], np.float64).tolist() for key in ("K", "distortion")}
    return CameraBlock(block, keys)


FORMAT = directed_format(
    "opencv",
    f"{KEY} of a FileStorage",
    lambda source: KEY in source.start and is_storage(source.start),
    _read,
    _make,
    read_lens=_read_lens,
)
