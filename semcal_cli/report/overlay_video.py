"""Images as a video, by OpenCV's FFmpeg."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.files.output_files import write_bytes
from semcal_cli.geometry.arrays import Image

FPS = 5.0
"""Frames of a drive in a second: slow enough to look at each."""
SUFFIX, CODEC = ".mp4", "mp4v"


def check_video(path: Path) -> None:
    """Check the suffix of a video.

    Raises:
        InputError: it is not .mp4.
    """
    if path.suffix.lower() != SUFFIX:
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected {SUFFIX}")


def write_video(images: Sequence[Image], path: Path) -> None:
    """Write images (H, W, 3), blue, green, red, which may differ in size; smaller ones get black margins.

    Raises:
        InputError: OpenCV has no codec, or the file cannot be written.
    """
    # The codec takes even sides.
    height, width = (2 * -(-max(image.shape[axis] for image in images) // 2) for axis in (0, 1))
    with TemporaryDirectory() as folder:
        part = Path(folder) / f"video{SUFFIX}"
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*CODEC), FPS, (width, height))
        for image in images:
            canvas = np.zeros((height, width, 3), np.uint8)
            canvas[: image.shape[0], : image.shape[1]] = image
            writer.write(canvas)
        writer.release()
        if not part.is_file() or not part.stat().st_size:
            raise InputError(f"{path}: OpenCV cannot write videos here, since it has no FFmpeg")
        write_bytes(part.read_bytes(), path)
