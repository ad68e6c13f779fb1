"""Size and kind of an image from the header of its file."""

from __future__ import annotations

from pathlib import Path

from semcal_cli.files.reading import read_bytes
from semcal_cli.formats.values import image_side

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_HEADER_SIZE = 26
TRUE_COLORS = (2, 6)
"""Colour types of PNG with colours, without and with alpha. The other types have one number a pixel."""


def image_size(path: Path) -> tuple[int, int]:
    """Read the width and height of an image, in pixels.

    Raises:
        InputError: the file does not exist, or is no image, or has no pixels.
    """
    width, height = _size(path)
    return image_side(f"{path}: width", width), image_side(f"{path}: height", height)


def _size(path: Path) -> tuple[int, int]:
    header = _header(path)
    if header.startswith(PNG_SIGNATURE) and len(header) == PNG_HEADER_SIZE:
        return int.from_bytes(header[16:20], "big"), int.from_bytes(header[20:24], "big")
    from semcal_cli.files.images import read_image

    height, width = read_image(path).shape[:2]
    return width, height


def holds_colors(path: Path) -> bool:
    """Whether a label image is a PNG of colours, whose pixels are not ids."""
    header = _header(path)
    return header.startswith(PNG_SIGNATURE) and len(header) == PNG_HEADER_SIZE and header[25] in TRUE_COLORS


def _header(path: Path) -> bytes:
    return read_bytes(path, PNG_HEADER_SIZE)
