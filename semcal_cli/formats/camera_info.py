"""ROS's sensor_msgs/CameraInfo as YAML, as `camera_calibration` writes it: the intrinsics of a camera, no transform.

R and P are those of a single camera: the rectified image is not rotated, and has the K of the raw image.
"""

from __future__ import annotations

import re
from typing import Any

from semcal_cli.drive.camera import CAMERA_MODELS, Camera, CameraModel
from semcal_cli.errors import InputError
from semcal_cli.formats.format import CameraBlock, Format, FormatOptions, Source
from semcal_cli.formats.lenses import (
    NAMES,
    check_lens,
    coefficients_of,
    matrix_camera,
    model_by_count,
    refuse_camera,
)
from semcal_cli.formats.node import Node, image_side, parse_number
from semcal_cli.formats.opencv import is_storage
from semcal_cli.geometry.arrays import Pose

NAME, LENS = "camera-info", "distortion_model"
CAMERA = "camera"
MODELS: dict[str, CameraModel] = {
    "plumb_bob": "plumb_bob",
    "radtan": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
    "kannala_brandt": "fisheye",
}
"""Camera model of each distortion_model (sensor_msgs/distortion_models.h, image_geometry, names that drivers use)."""
LENS_NAMES: dict[CameraModel, str] = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "thin_prism": "rational_polynomial",
    "fisheye": "equidistant",
}
"""distortion_model of each camera model. A model of 12 or 14 coefficients has the name of the rational model."""
OST = re.compile(r"\A(#[^\n]*\n\s*)*\[image\]\s+width\s")
"""Beginning of ost.txt, which the calibrator of ROS writes beside ost.yaml."""
DOCUMENT_END = re.compile(r"^---[ \t]*$", re.MULTILINE)


def first_document(text: str) -> str:
    """Keep the first message of `ros2 topic echo`, which ends each message with `---`."""
    documents = DOCUMENT_END.split(text)
    has_content = (
        any(line.strip() and line[0] not in "%#" for line in part.splitlines()) for part in documents
    )
    return next((part for part, is_one in zip(documents, has_content, strict=True) if is_one), text)


def ros_intrinsics(document: Node) -> CameraBlock:
    """Read a sensor_msgs/CameraInfo, as camera_calibration_parsers write it or as `ros2 topic echo` prints it.

    K and D are used; R and P belong to the rectified images. K is for the full image (CameraInfo.msg), and is converted
    to that of binned and cropped images.

    Raises:
        InputError: the lens is not known, or a value is missing or wrong.
    """
    lens = document.at(LENS)
    if str(lens.value) not in MODELS:
        raise lens.mismatch(f"one of: {', '.join(MODELS)}")
    model = MODELS[str(lens.value)]

    def model_of(distortion: Node, count: int) -> str:
        is_long = count in CAMERA_MODELS["thin_prism"].counts[1:]
        return "thin_prism" if is_long and model == "rational_polynomial" else model

    camera = matrix_camera(document, model_of)
    return camera._replace(block=_of_part(document, camera.block))


def _of_part(document: Node, block: dict[str, Any]) -> dict[str, Any]:
    """Convert K and the size of the full image to those of a region of interest, and then of its binning.

    The region is in pixels of the full image; 0 is its full width or height, and a binning of 1 (CameraInfo.msg). A
    binned pixel is the mean of its pixels, so that pixel 0 of a binning of 2 lies at 0.5; image_geometry leaves out
    this quarter of a binned pixel.
    """
    roi = document.child("roi", document.mapping.get("roi") or {})

    def whole(node: Node, key: str) -> int:
        value = node.mapping.get(key, 0)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise node.child(key, value).mismatch("a whole number of at least 0")
        return value

    K, part = [list(row) for row in block["K"]], dict(block)
    for axis, (side, start, step) in enumerate(
        (("width", "x_offset", "binning_x"), ("height", "y_offset", "binning_y"))
    ):
        full, offset, binning = block[side], whole(roi, start), whole(document, step) or 1
        length = whole(roi, side) or full
        if offset + length > full:
            found = f"{start} {offset} and {side} {length}"
            raise InputError(f"{roi.where}: found {found}, expected a region within the {side} {full}")
        if length < binning:
            raise document.child(step, binning).mismatch(f"at most {length}, the {side}")
        part[side] = length // binning
        if offset or binning > 1:
            K[axis][:2] = [value / binning for value in K[axis][:2]]
            K[axis][2] = (K[axis][2] - offset + 0.5) / binning - 0.5
    return part | {"K": K}


def _is_camera_info(source: Source) -> bool:
    has_K = any(name in source.mapping for name in NAMES["K"])
    return LENS in source.mapping and has_K and not is_storage(source.text)


def _read_ost(source: Source, model: str | None) -> CameraBlock:
    """Read ost.txt of camera_calibration: sections and lines of numbers below their names."""

    def numbers(name: str) -> Node:
        match = re.search(rf"^{name}[ \t]*\r?\n((?:[-+.\deE \t\r\n]+))", source.text, re.MULTILINE)
        words = match[1].split() if match else []
        return Node(str(source.path), [parse_number(f"{source.path}: {name}", word) for word in words], name)

    K, distortion = numbers("camera matrix").numbers(9), numbers("distortion")
    coefficients = distortion.numbers()
    sides = {side: numbers(side).numbers(1)[0] for side in ("width", "height")}
    block = {
        "model": model or model_by_count(distortion, len(coefficients)),
        **{side: image_side(f"{source.path}: {side}", value) for side, value in sides.items()},
        "K": [K[:3], K[3:6], K[6:]],
        "distortion": coefficients,
    }
    return CameraBlock(block, {"K": "camera matrix"})


def _read_lens(source: Source, camera: str | None, model: str | None) -> CameraBlock | None:
    if OST.search(source.start):
        refuse_camera(source.path, camera)
        return _read_ost(source, model)
    if LENS not in source.mapping:
        return None
    refuse_camera(source.path, camera)
    return ros_intrinsics(source.node)


def _read(source: Source, options: FormatOptions) -> Pose:
    raise InputError(
        f"{source.path}: found {NAME} intrinsics and no transform, expected a file with a transform"
    )


def _make(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
    camera, where = options.intrinsics, f"{options.option('to')} {NAME}"
    if camera is None:
        raise InputError(f"{where}: found no camera, expected IN to be a semcal calibration or a drive")
    check_lens(where, camera, LENS_NAMES)
    return camera_info_of(camera, options.camera or CAMERA)


def camera_info_of(camera: Camera, name: str) -> dict[str, Any]:
    """Make the document of a camera, whose lens is one of `LENS_NAMES`, as camera_calibration writes it."""
    numbers = [number for row in camera.K for number in row]
    return {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": name,
        "camera_matrix": _matrix(3, numbers),
        LENS: LENS_NAMES[camera.model],
        "distortion_coefficients": _matrix(1, _coefficients(camera)),
        "rectification_matrix": _matrix(3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": _matrix(3, [*numbers[:3], 0.0, *numbers[3:6], 0.0, *numbers[6:], 0.0]),
    }


def _coefficients(camera: Camera) -> list[float]:
    """List the distortion coefficients; in ROS, plumb_bob has five."""
    coefficients = coefficients_of(camera)
    return [*coefficients, 0.0] if camera.model == "plumb_bob" and len(coefficients) == 4 else coefficients


def _matrix(rows: int, data: list[float]) -> dict[str, Any]:
    return {"rows": rows, "cols": len(data) // rows, "data": data}


FORMAT = Format(
    NAME,
    "no transform: size, K and distortion of a ROS CameraInfo; IN is a calibration or a drive",
    _is_camera_info,
    _read,
    _make,
    asks=("camera",),
    has_transform=False,
    read_lens=_read_lens,
)
