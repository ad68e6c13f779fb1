"""Size and kind of an image from the header of its file."""

from __future__ import annotations

from pathlib import Path

from semcal_cli.files.picture_sizes import read_size
from semcal_cli.files.reading import read_start
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
    width, height = read_size(path)
    return image_side(f"{path}: width", width), image_side(f"{path}: height", height)


def holds_colors(path: Path) -> bool:
    """Whether a label image is a PNG of colours, whose pixels are not ids."""
    header = read_start(path, PNG_HEADER_SIZE)
    return header.startswith(PNG_SIGNATURE) and len(header) == PNG_HEADER_SIZE and header[25] in TRUE_COLORS
