"""The size of a picture as the header of its file states it, before the picture takes any memory."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, TypeAlias

from semcal_cli.errors import InputError
from semcal_cli.files.reading import open_file

MAX_PIXELS = 100_000_000
"""Most pixels of a picture."""
MAX_HEADER_BYTES = 16 << 20
"""Bytes at the start of a large file, among which its header is looked for."""
PNG, JPEG, BMP = b"\x89PNG", b"\xff\xd8\xff", b"BM"
"""First bytes of the formats."""
PNG_SIGNATURE_BYTES = 8
COLORS = ("RGB", "RGBA")
"""Pillow's modes of PNG whose pixels are colours; pixels of the other modes are one number, or one and alpha."""

Size: TypeAlias = tuple[int, int]
"""Columns and rows."""


def read_size(path: Path) -> Size:
    """Read the columns and rows of a PNG, JPEG or BMP from its header.

    Raises:
        InputError: the file is missing, or is not an image.
    """
    with open_file(path) as file:
        return stated_size(path, file)


def stated_size(path: Path, file: BinaryIO) -> Size:
    """Read the columns and rows from the header of an open file, which is left at its start.

    Raises:
        InputError: the file is not an image.
    """
    size, _ = _header(path, file)
    file.seek(0)
    return size


def holds_colors(path: Path) -> bool:
    """Tell whether a label image is a PNG of colours, whose pixels are not ids.

    Raises:
        InputError: the file is missing, or cannot be read.
    """
    with open_file(path) as file:
        if not file.read(len(PNG)).startswith(PNG):
            return False
        try:
            _, mode = _header(path, file)
        except InputError:
            return False
    return mode in COLORS


def damaged_picture(path: Path) -> InputError:
    """Make the error of a picture that cannot be decoded."""
    return InputError(f"{path}: found a damaged picture, needed a whole one")


def _header(path: Path, file: BinaryIO) -> tuple[Size, str]:
    """Read the size and Pillow's mode of the picture in an open file.

    Raises:
        InputError: the file is not an image.
    """
    num_bytes = file.seek(0, os.SEEK_END)
    file.seek(0)
    start = file.read(len(PNG))
    if not start.startswith((PNG, JPEG, BMP)):
        found = f"{num_bytes:,} bytes of no known format"
        raise InputError(f"{path}: found {found}, needed a PNG, JPEG or BMP")
    file.seek(0)
    # A header that goes on for ever would take memory and time.
    head = file if num_bytes <= MAX_HEADER_BYTES else BytesIO(file.read(MAX_HEADER_BYTES))
    try:
        size, mode = _parsed(head, start)
    except Exception:  # Pillow lets errors of any kind through, as struct's.
        raise damaged_picture(path) from None
    if 0 in size:
        raise damaged_picture(path)
    return size, mode


def _parsed(head: BinaryIO, start: bytes) -> tuple[Size, str]:
    """Parse a header by Pillow's parts: `PIL.Image.open` warns of sizes that are judged here, by `MAX_PIXELS`."""
    from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin

    if start.startswith(PNG):
        # The first chunk alone, since Pillow refuses errors in later ones that OpenCV reads past.
        head.seek(PNG_SIGNATURE_BYTES)
        stream = PngImagePlugin.PngStream(head)
        stream.call(*stream.read())
        return stream.im_size, stream.im_mode or ""
    open_picture = JpegImagePlugin.JpegImageFile if start.startswith(JPEG) else BmpImagePlugin.BmpImageFile
    picture = open_picture(head)
    return picture.size, picture.mode
