"""Size of an image from the header of its file, as a drive can state it."""

from __future__ import annotations

from pathlib import Path

from semcal_cli.files.picture_sizes import read_size
from semcal_cli.formats.values import image_side


def image_size(path: Path) -> tuple[int, int]:
    """Read the width and height of an image, in pixels.

    Raises:
        InputError: the file does not exist, or is no image, or has no pixels.
    """
    width, height = read_size(path)
    return image_side(f"{path}: width", width), image_side(f"{path}: height", height)
