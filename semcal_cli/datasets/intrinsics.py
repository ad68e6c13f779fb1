"""Intrinsics from the files of calibration tools: a ROS camera_info, a Kalibr camchain, an OpenCV FileStorage.

Each becomes the `camera:` block of a drive, for the raw images. K and D of a camera_info are used; its R and P belong
to the rectified images.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from semcal_cli.datasets.files import pick
from semcal_cli.drive.lenses import DISTORTION_COUNTS, PARAMETERS
from semcal_cli.errors import InputError
from semcal_cli.files.documents import parse_document
from semcal_cli.files.messages import describe
from semcal_cli.files.reading import read_text
from semcal_cli.formats.lenses import KALIBR_LENSES, NAMES, OPENCV_MODELS, ROS_MODELS
from semcal_cli.formats.storage import Storage, is_storage
from semcal_cli.formats.values import camera_block, image_side, number

KALIBR_KEYS = {"K": "intrinsics", "distortion": "distortion_coeffs", "parameters": "intrinsics"}
MEI_KEYS = {
    "K": "projection_parameters",
    "distortion": "distortion_parameters",
    "parameters": "mirror_parameters",
}
DOCUMENT_END = re.compile(r"^---[ \t]*$")
KNOWN_AS = (
    "a ROS camera_info (distortion_model), a Kalibr camchain (cam0) or an OpenCV FileStorage (camera_matrix)"
)


def read_intrinsics(path: Path, camera: str | None = None, model: str | None = None) -> dict[str, Any]:
    """Read the camera block from a file of any known kind.

    Args:
        path: The file.
        camera: Name of a camera in a camchain; None for the only one.
        model: Camera model, which overrides that of the file; an OpenCV FileStorage does not always name one.

    Raises:
        InputError: the file is of no known kind, a key is missing or wrong, or `camera` or `model` does not fit.
    """
    block, keys = _read(path, camera, model)
    return camera_block(path, block if model is None else _with_model(path, block, model), keys)


def _read(path: Path, camera: str | None, model: str | None) -> tuple[dict[str, Any], dict[str, str]]:
    """Read the block without checks, and the file's own names of its keys."""
    text = read_text(path)
    if is_storage(text):
        _refuse_camera(path, camera)
        storage = Storage(path)
        if "mirror_parameters" in storage.document:
            return _mei(storage), MEI_KEYS
        return _opencv(storage, model), _names(storage.document)
    document = parse_document(_first_document(text), path)
    chain = {
        str(key): value
        for key, value in document.items()
        if isinstance(value, dict) and "camera_model" in value
    }
    if chain:
        return _kalibr(path, chain[pick("camera", camera, list(chain), path)]), KALIBR_KEYS
    if "distortion_model" in document:
        _refuse_camera(path, camera)
        return _ros(path, document), _names(document)
    keys = ", ".join(describe(key) for key in list(document)[:5]) or "none"
    raise InputError(f"{path}: found top-level keys {keys}, needed {KNOWN_AS}")


def _first_document(text: str) -> str:
    """Keep the first message of `ros2 topic echo`, which ends each message with `---`."""
    lines = text.split("\n")
    started = False
    for index, line in enumerate(lines):
        if started and DOCUMENT_END.match(line.rstrip()):
            return "\n".join(lines[:index])
        started = started or (bool(line.strip()) and not line.startswith(("%", "#", "---")))
    return text


def _refuse_camera(path: Path, camera: str | None) -> None:
    if camera is not None:
        raise InputError(f"{path}: found one camera without a name, needed no --camera ({camera!r})")


def _with_model(path: Path, block: dict[str, Any], model: str) -> dict[str, Any]:
    """Replace the camera model and keep K and the coefficients."""
    counts = next((counts for name, counts in DISTORTION_COUNTS.items() if name == model), None)
    if counts is None:
        raise InputError(f"--model: found {model!r}, needed one of: {', '.join(DISTORTION_COUNTS)}")
    if block["model"] != model and {block["model"], model} & PARAMETERS.keys():
        raise InputError(f"{path}: found model {block['model']!r}, which cannot be taken as --model {model}")
    distortion = block.get("distortion", [])
    if not isinstance(distortion, list) or len(distortion) not in counts:
        found = len(distortion) if isinstance(distortion, list) else describe(distortion)
        needed = " or ".join(map(str, counts))
        raise InputError(f"{path}: found {found} coefficients, needed {needed} for --model {model}")
    return block | {"model": model}


def read_mei(path: Path) -> dict[str, Any]:
    """Read an omnidirectional camera (Mei and Rives) as camodocal and KITTI-360 write it.

    Raises:
        InputError: the file is no OpenCV FileStorage, or a key is missing or wrong.
    """
    return camera_block(path, _mei(Storage(path)), MEI_KEYS)


def ros_camera(source: Path, document: dict[Any, Any]) -> dict[str, Any]:
    """Make the camera block of a sensor_msgs/CameraInfo whose fields have been read; `source` is named in errors.

    Raises:
        InputError: the lens is not known, or a value is wrong.
    """
    return camera_block(source, _ros(source, document), _names(document))


def _mei(storage: Storage) -> dict[str, Any]:
    fx, fy, cx, cy = (
        storage.number("projection_parameters", key) for key in ("gamma1", "gamma2", "u0", "v0")
    )
    return {
        "model": "omnidirectional",
        "width": storage.side("image_width"),
        "height": storage.side("image_height"),
        "K": _intrinsic_matrix(fx, fy, cx, cy),
        "distortion": [storage.number("distortion_parameters", key) for key in ("k1", "k2", "p1", "p2")],
        "parameters": {"xi": storage.number("mirror_parameters", "xi")},
    }


def _ros(path: Path, document: dict[Any, Any]) -> dict[str, Any]:
    """Read a sensor_msgs/CameraInfo, as camera_calibration_parsers write it or as `ros2 topic echo` prints it.

    K is for the full image (CameraInfo.msg), so binned and cropped images are refused.
    """
    model = ROS_MODELS.get(str(document["distortion_model"]))
    if model is None:
        raise _unknown(path, "distortion_model", document["distortion_model"], ROS_MODELS)
    K = _data(path, document, "camera_matrix", "K", "k")
    if not isinstance(K, list) or len(K) != 9:
        raise InputError(f"{path}: camera_matrix: found {describe(K)}, needed 9 numbers by rows")
    width = _first(path, document, "image_width", "width")
    height = _first(path, document, "image_height", "height")
    _refuse_parts(path, document, width, height)
    distortion = _data(path, document, "distortion_coefficients", "D", "d")
    if model == "rational_polynomial" and isinstance(distortion, list):
        model = "thin_prism" if len(distortion) in DISTORTION_COUNTS["thin_prism"][1:] else model
    return {
        "model": model,
        "width": width,
        "height": height,
        "K": [K[0:3], K[3:6], K[6:9]],
        "distortion": distortion,
    }


def _refuse_parts(path: Path, document: dict[Any, Any], width: Any, height: Any) -> None:
    """Refuse binned and cropped images. The default 0 means a binning of 1, or the full width or height."""
    roi = document.get("roi") or {}
    if not isinstance(roi, dict):
        raise InputError(f"{path}: roi: found {describe(roi)}, needed a mapping")
    allowed = {"binning_x": (0, 1), "binning_y": (0, 1)}
    allowed_roi = {"x_offset": (0,), "y_offset": (0,), "width": (0, width), "height": (0, height)}
    for where, node, values in (("", document, allowed), ("roi.", roi, allowed_roi)):
        for key, needed in values.items():
            if node.get(key, 0) not in needed:
                raise InputError(
                    f"{path}: {where}{key}: found {describe(node[key])}, needed {' or '.join(map(describe, needed))}: "
                    "K is for the full picture"
                )


def _kalibr(path: Path, camera: dict[Any, Any]) -> dict[str, Any]:
    """Read a camera of a Kalibr camchain (github.com/ethz-asl/kalibr/wiki/yaml-formats)."""
    read = _KALIBR_MODELS.get(str(camera["camera_model"]))
    if read is None:
        raise _unknown(path, "camera_model", camera["camera_model"], _KALIBR_MODELS)
    sides = _numbers(path, camera, "resolution", 2)
    width, height = (image_side(f"{path}: resolution", side) for side in sides)
    return {"width": width, "height": height} | read(path, camera)


def _kalibr_pinhole(path: Path, camera: dict[Any, Any]) -> dict[str, Any]:
    lens = str(_first(path, camera, "distortion_model"))
    if lens not in KALIBR_LENSES:
        raise _unknown(path, "distortion_model", lens, KALIBR_LENSES)
    K = _intrinsic_matrix(*_numbers(path, camera, "intrinsics", 4))
    distortion = (
        camera.get("distortion_coeffs", []) if lens == "none" else _first(path, camera, "distortion_coeffs")
    )
    return {"model": KALIBR_LENSES[lens], "K": K, "distortion": distortion}


def _kalibr_omni(path: Path, camera: dict[Any, Any]) -> dict[str, Any]:
    lens = str(_first(path, camera, "distortion_model"))
    if lens not in ("radtan", "none"):
        raise _unknown(path, "distortion_model", lens, {"radtan": "", "none": ""})
    xi, *pinhole = _numbers(path, camera, "intrinsics", 5)
    distortion = [] if lens == "none" else _first(path, camera, "distortion_coeffs")
    K = _intrinsic_matrix(*pinhole)
    return {"model": "omnidirectional", "K": K, "distortion": distortion, "parameters": {"xi": xi}}


def _kalibr_double_sphere(path: Path, camera: dict[Any, Any]) -> dict[str, Any]:
    xi, alpha, *pinhole = _numbers(path, camera, "intrinsics", 6)
    return {
        "model": "double_sphere",
        "K": _intrinsic_matrix(*pinhole),
        "parameters": {"xi": xi, "alpha": alpha},
    }


_KALIBR_MODELS: dict[str, Callable[[Path, dict[Any, Any]], dict[str, Any]]] = {
    "pinhole": _kalibr_pinhole,
    "omni": _kalibr_omni,
    "ds": _kalibr_double_sphere,
}


def _opencv(storage: Storage, model: str | None) -> dict[str, Any]:
    """Read a file of OpenCV's calibration samples, or one of its usual variants."""
    K = storage.first(("camera_matrix", "cameraMatrix", "CameraMatrix", "K"))
    if len(K) != 9:
        raise InputError(f"{storage.path}: camera_matrix: found {len(K)} numbers, needed 9 by rows")
    distortion = storage.first(("distortion_coefficients", "distCoeffs", "dist_coeffs", "D"))
    return {
        "model": model or _opencv_model(storage, len(distortion)),
        "width": storage.side("image_width", "width"),
        "height": storage.side("image_height", "height"),
        "K": [K[0:3], K[3:6], K[6:9]],
        "distortion": distortion,
    }


def _opencv_model(storage: Storage, num_coefficients: int) -> str:
    """Derive the camera model from the number of coefficients; cv2.fisheye, too, has four."""
    if "fisheye_model" in storage.document:
        if storage.number("fisheye_model"):
            return "fisheye"
    elif num_coefficients == 4:
        found = "found 4 coefficients and no fisheye_model"
        raise InputError(f"{storage.path}: {found}, needed --model, as plumb_bob or fisheye")
    if num_coefficients not in OPENCV_MODELS:
        counts = ", ".join(map(str, OPENCV_MODELS))
        found = f"distortion_coefficients: found {num_coefficients} numbers"
        raise InputError(f"{storage.path}: {found}, needed one of: {counts}")
    return OPENCV_MODELS[num_coefficients]


def _names(document: Mapping[Any, Any]) -> dict[str, str]:
    """Find the file's own names of the keys of the block."""
    return {key: next((name for name in names if name in document), key) for key, names in NAMES.items()}


def _data(path: Path, document: dict[Any, Any], *names: str) -> Any:
    """Find the numbers of a matrix: under its key `data`, or directly under its name."""
    value = _first(path, document, *names)
    if isinstance(value, dict):
        value = _first(path, value, "data")
    return value


def _numbers(path: Path, document: dict[Any, Any], name: str, count: int) -> list[float]:
    values = _first(path, document, name)
    if (
        not isinstance(values, list)
        or len(values) != count
        or any(isinstance(value, bool) or not isinstance(value, int | float) for value in values)
    ):
        raise InputError(f"{path}: {name}: found {describe(values)}, needed {count} numbers")
    return [number(f"{path}: {name}", value) for value in values]


def _first(path: Path, document: dict[Any, Any], *names: str) -> Any:
    for name in names:
        if name in document:
            return document[name]
    raise InputError(f"{path}: {names[0]}: found nothing, needed a value")


def _intrinsic_matrix(fx: float, fy: float, cx: float, cy: float) -> list[list[float]]:
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]


def _unknown(path: Path, key: str, found: object, known: Mapping[str, object]) -> InputError:
    return InputError(f"{path}: {key}: found {describe(found)}, needed one of: {', '.join(known)}")
