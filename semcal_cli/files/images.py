"""Reading and writing of images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.files.picture_sizes import MAX_PIXELS, Size, damaged_picture, stated_size
from semcal_cli.files.reading import check_size, open_file, size_of
from semcal_cli.files.writing import write_bytes

BYTES_A_PIXEL, MORE_BYTES = 8, 1 << 24
"""Largest size of a picture's file: bytes for each pixel, and bytes that it may hold besides, such as a preview."""


def read_image(path: Path, size: Size | None = None) -> npt.NDArray[np.uint8]:
    """Read a colour image as its pixels are stored, whatever its EXIF orientation.

    The size that its header states is judged before the image is decoded.

    Args:
        path: A PNG, JPEG or BMP.
        size: Columns and rows that the image needs to have; None takes any of at most `MAX_PIXELS` pixels.

    Returns:
        (H, W, 3) blue, green, red.

    Raises:
        InputError: the file is missing, or is not an image, or is one of another size.
    """
    with open_file(path) as file:
        width, height = found = stated_size(path, file)
        _check_pixels(path, found, size)
        limit = BYTES_A_PIXEL * width * height + MORE_BYTES
        check_size(path, size_of(file), limit, f" for {width} x {height} pixels")
        content = file.read(size_of(file))
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    except cv2.error:
        image = None
    if image is None or image.shape[1::-1] != found:
        raise damaged_picture(path)
    return image.astype(np.uint8, copy=False)


def check_image(path: Path, size: Size) -> None:
    """Check by its header that an image has these columns and rows, without decoding it.

    Raises:
        InputError: the file is missing, or is not an image, or is one of another size.
    """
    with open_file(path) as file:
        _check_pixels(path, stated_size(path, file), size)


def _check_pixels(path: Path, found: Size, needed: Size | None) -> None:
    width, height = found
    if needed is not None and found != needed:
        raise InputError(f"{path}: found {width} x {height} pixels, needed {needed[0]} x {needed[1]}")
    if width * height > MAX_PIXELS:
        raise InputError(f"{path}: found {width:,} x {height:,} pixels, needed at most {MAX_PIXELS:,}")


def write_image(image: npt.NDArray[np.uint8], path: Path) -> None:
    """Write a PNG as a whole or not at all: to a temporary file beside it, which is then renamed.

    Args:
        image: (H, W) grey, or (H, W, 3) blue, green, red.
        path: File to write; its suffix is .png.

    Raises:
        InputError: the suffix is not .png, or the file cannot be written. An existing file stays untouched then.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: found suffix {path.suffix!r}, needed .png")
    _, content = cv2.imencode(".png", image)
    write_bytes(content.tobytes(), path)
