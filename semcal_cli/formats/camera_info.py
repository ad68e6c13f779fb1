"""ROS's sensor_msgs/CameraInfo as YAML, as `camera_calibration` writes it: the intrinsics of a camera, no transform.

R and P are of a single camera: the rectified picture is not turned, and has the K of the raw one. In a file of the
user's they stay as they are, since they say which rectified picture the user wants.
"""

from __future__ import annotations

from typing import Any

from semcal_cli.drive.document import Camera
from semcal_cli.errors import InputError
from semcal_cli.files.messages import describe
from semcal_cli.formats.format import Format, FormatOptions, Source, document_writer
from semcal_cli.formats.lenses import (
    NAMES,
    ROS_MODELS,
    ROS_NAMES,
    check_lens,
    coefficients_of,
    numbers_of,
    with_count,
)
from semcal_cli.formats.setting import check_size, tell
from semcal_cli.formats.storage import is_storage
from semcal_cli.geometry.poses import Pose

NAME, LENS = "camera-info", "distortion_model"
CAMERA = "camera"


def _recognises(source: Source) -> bool:
    found = source.mapping
    return LENS in found and any(name in found for name in NAMES["K"]) and not is_storage(source.text)


def _read(source: Source, options: FormatOptions) -> Pose:
    raise InputError(
        f"{source.path}: found the intrinsics of a {NAME} and no transform, needed a file with a transform"
    )


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    """Set the intrinsics: of all that a file has, or of a new one."""
    camera, where = options.intrinsics, str(options.file) if document else f"--to {NAME}"
    if camera is None and document:
        needed = "needed IN to be a calibration that estimated and kept its camera's"
        raise InputError(f"{where}: found a {NAME}, which holds intrinsics alone, {needed}")
    if camera is None:
        raise InputError(f"{where}: found no camera, needed IN to be a calibration of semcal's or a drive")
    check_lens(where, camera, ROS_NAMES)
    if document:
        _set(document, camera, options)
        return
    fx, _, cx, _, fy, cy, *_ = numbers_of(camera)
    document |= {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": options.camera or CAMERA,
        "camera_matrix": _matrix(3, numbers_of(camera)),
        LENS: ROS_NAMES[camera.model],
        "distortion_coefficients": _matrix(1, _coefficients(camera)),
        "rectification_matrix": _matrix(3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": _matrix(3, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    }


def _coefficients(camera: Camera) -> list[float]:
    """Distortion coefficients; plumb_bob has five of them in ROS."""
    found = coefficients_of(camera)
    return [*found, 0.0] if camera.model == "plumb_bob" and len(found) == 4 else found


def _matrix(rows: int, data: list[float]) -> dict[str, Any]:
    return {"rows": rows, "cols": len(data) // rows, "data": data}


def _set(document: Any, camera: Camera, options: FormatOptions) -> None:
    """Replace K and the coefficients of a file, in its own layout."""
    sides = [
        next((document[name] for name in NAMES[side] if name in document), None)
        for side in ("width", "height")
    ]
    check_size(options, camera, sides)
    of_file = ROS_MODELS.get(str(document[LENS]))
    if of_file != ROS_MODELS[ROS_NAMES[camera.model]]:
        raise InputError(
            f"{options.file}: {LENS}: found {describe(document[LENS])}, needed {ROS_NAMES[camera.model]!r}"
        )
    K, D = (_name(document, kind, options) for kind in ("K", "distortion"))
    _numbers(document, K, options)
    count = len(_numbers(document, D, options))
    _replace(document, K, numbers_of(camera))
    _replace(document, D, _coefficients(with_count(camera, count)))
    tell(options, camera)


def _name(document: Any, kind: str, options: FormatOptions) -> str:
    """Find the file's own name of K or of the coefficients."""
    found = next((name for name in NAMES[kind] if name in document), None)
    if found is None:
        raise InputError(f"{options.file}: {NAMES[kind][0]}: found nothing, needed a value")
    return found


def _numbers(document: Any, key: str, options: FormatOptions) -> list[Any]:
    """Look up the list of a matrix, under its key `data` or directly under its name."""
    value = document[key]
    numbers = value.get("data") if isinstance(value, dict) else value
    if not isinstance(numbers, list):
        raise InputError(f"{options.file}: {key}: found {describe(numbers)}, needed numbers")
    return numbers


def _replace(document: Any, key: str, numbers: list[float]) -> None:
    value = document[key]
    if not isinstance(value, dict):
        document[key] = numbers
        return
    if len(numbers) != len(value["data"]):
        value |= {"rows": 1, "cols": len(numbers)}
    value["data"] = numbers


FORMAT = Format(
    NAME,
    "no transform: size, K and distortion of a ROS CameraInfo; IN is a calibration or a drive",
    _recognises,
    _read,
    document_writer(_put),
    _put,
    asks=("camera",),
    has_transform=False,
)
