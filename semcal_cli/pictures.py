"""Pictures on disk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.documents import write_bytes
from semcal_cli.errors import InputError


def read_picture(path: Path) -> npt.NDArray[np.uint8]:
    """Read a colour picture as its pixels are stored, whatever its EXIF orientation.

    Returns:
        (H, W, 3) blue, green, red.

    Raises:
        InputError: there is no such file, or it is no picture.
    """
    try:
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise InputError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    picture = cv2.imdecode(content, flags) if content.size else None
    if picture is None:
        raise InputError(f"{path}: found {content.size:,} bytes of no known format, needed a picture")
    return picture.astype(np.uint8, copy=False)


def write_picture(picture: npt.NDArray[np.uint8], path: Path) -> None:
    """Write a PNG as a whole or not at all: to a temporary file beside it, which is then renamed.

    Args:
        picture: (H, W) grey, or (H, W, 3) blue, green, red.
        path: What to write; its suffix is .png.

    Raises:
        InputError: the suffix is another, or the file cannot be written. An existing one is untouched then.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: found suffix {path.suffix!r}, needed .png")
    _, content = cv2.imencode(".png", picture)
    write_bytes(content.tobytes(), path)
