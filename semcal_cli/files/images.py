"""Reading and writing of images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.files.reading import read_bytes
from semcal_cli.files.writing import write_bytes

MAGIC = b"\x89PNG", b"\xff\xd8\xff", b"BM"
"""First bytes of PNG, JPEG and BMP files."""


def read_image(path: Path) -> npt.NDArray[np.uint8]:
    """Read a colour image as its pixels are stored, whatever its EXIF orientation.

    Returns:
        (H, W, 3) blue, green, red.

    Raises:
        InputError: the file is missing, or is not an image.
    """
    content = read_bytes(path)
    if not content.startswith(MAGIC):
        raise InputError(
            f"{path}: found {len(content):,} bytes of no known format, needed a PNG, JPEG or BMP"
        )
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"{path}: found a damaged picture, or too large a one, needed a picture")
    return image.astype(np.uint8, copy=False)


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
