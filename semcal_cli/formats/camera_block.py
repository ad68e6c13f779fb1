"""The `camera:` block of a drive from a file of any format that holds the intrinsics of raw images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from semcal_cli.drive.camera import CAMERA_MODELS
from semcal_cli.errors import InputError, counted, describe, mismatch
from semcal_cli.files.input_files import read_text
from semcal_cli.formats.camera_info import first_document, ros_intrinsics
from semcal_cli.formats.format import CameraBlock, Source
from semcal_cli.formats.format_table import all_formats
from semcal_cli.formats.node import Node, checked_camera_block
from semcal_cli.formats.opencv import is_storage

KNOWN_FORMATS = (
    "a ROS camera_info (distortion_model) or ost.txt, a Kalibr camchain (cam0), an OpenCV FileStorage (camera_matrix), "
    "ORB-SLAM's (Camera.fx) or FAST-LIVO2's settings (cam_fx), direct_visual_lidar_calibration's calib.json, or "
    "OpenCalib's JSON (cam_K)"
)

EXAMPLE = (
    "{distortion_model: plumb_bob, width: 1242, height: 375, K: [721.5, 0, 609.6, 0, 721.5, 172.9, 0, 0, 1], "
    "D: [0, 0, 0, 0, 0]}"
)
"""A camera_info of images without distortion."""


def read_intrinsics(
    path: Path,
    camera: str | None = None,
    model: str | None = None,
    size: Callable[[], tuple[int, int]] | None = None,
) -> dict[str, Any]:
    """Read the camera block from a file of any known format.

    Args:
        path: The file.
        camera: Name of a camera in a camchain; None for the only one.
        model: Camera model that overrides that of the file; an OpenCV FileStorage does not always name one.
        size: Returns columns and rows of the images, for a file that has none; None if there are no images.

    Raises:
        InputError: the file has no known format, a key is missing or wrong, or `camera` or `model` does not fit.
    """
    text = read_text(path)
    source = Source(path, (text if is_storage(text) else first_document(text)).encode())
    block, keys = _read(source, camera, model)
    if "width" not in block:
        if size is None:
            raise InputError(f"{path}: found no size of the images, and no images")
        block |= dict(zip(("width", "height"), size(), strict=True))
    return checked_camera_block(path, block if model is None else _with_model(path, block, model), keys)


def ros_camera(source: str, document: dict[Any, Any]) -> dict[str, Any]:
    """Make the camera block from the fields of a sensor_msgs/CameraInfo; errors name `source`.

    Raises:
        InputError: the lens is unknown, or a value is wrong.
    """
    return checked_camera_block(source, *ros_intrinsics(Node(source, document)))


def resized(block: dict[str, Any], size: tuple[int, int]) -> dict[str, Any]:
    """Convert a camera block to images that were resized to `size`, columns and rows.

    Raises:
        InputError: the images have another aspect.
    """
    if not _has_aspect(block, size):
        raise InputError(
            f"--resized: found images of {size[0]} x {size[1]} pixels, expected the aspect of {block['width']} x "
            f"{block['height']}, as K has"
        )
    K = [list(row) for row in block["K"]]
    for axis, scale in enumerate((size[0] / block["width"], size[1] / block["height"])):
        K[axis][:2] = [value * scale for value in K[axis][:2]]
        K[axis][2] = (K[axis][2] + 0.5) * scale - 0.5
    return block | {"width": size[0], "height": size[1], "K": K}


def size_problem(block: dict[str, Any], size: tuple[int, int], stated: str = "its intrinsics state") -> str:
    """Describe images of another size, columns and rows, than a camera block; empty for the same.

    Args:
        block: The camera block.
        size: Columns and rows of the images.
        stated: What states those of the block.
    """
    needed = block["width"], block["height"]
    if size == needed:
        return ""
    image_size, camera_size = ("{} x {}".format(*sides) for sides in (size, needed))
    advice = "; if the images were resized, --resized converts K" if _has_aspect(block, size) else ""
    return f"found an image of {image_size} pixels, needed {camera_size}, as {stated}{advice}"


def _has_aspect(block: dict[str, Any], size: tuple[int, int]) -> bool:
    """Whether images are of the aspect of a camera block: a side of the smaller ones is off by less than one pixel."""
    width, height = int(block["width"]), int(block["height"])
    return abs(size[0] * height - size[1] * width) < max(width, height, *size)


def _read(source: Source, camera: str | None, model: str | None) -> CameraBlock:
    for format in all_formats():
        if format.read_lens is not None and (block := format.read_lens(source, camera, model)) is not None:
            return block
    keys = ", ".join(describe(key) for key in list(source.node.mapping)[:5]) or "none"
    raise InputError(
        f"{source.path}: found top-level keys {keys}, expected {KNOWN_FORMATS}; such as {EXAMPLE}"
    )


def _with_model(path: Path, block: dict[str, Any], model: str) -> dict[str, Any]:
    """Replace the camera model and keep K and the coefficients."""
    lenses = {str(name): lens for name, lens in CAMERA_MODELS.items()}
    if model not in lenses:
        raise InputError(f"--model: found {model!r}, expected one of: {', '.join(lenses)}")
    if block["model"] != model and (lenses[block["model"]].parameters or lenses[model].parameters):
        raise InputError(f"{path}: found model {block['model']!r}, which --model {model} cannot replace")
    distortion, counts = block.get("distortion", []), lenses[model].counts
    if not isinstance(distortion, list) or len(distortion) not in counts:
        is_list = isinstance(distortion, list)
        description = counted(len(distortion), "coefficient") if is_list else describe(distortion)
        needed = " or ".join(map(str, counts))
        raise InputError(f"{path}: {mismatch(description, needed)} for --model {model}")
    return block | {"model": model}
