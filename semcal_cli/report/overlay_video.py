"""Images as a video, by OpenCV's FFmpeg."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.files.output_files import write_bytes
from semcal_cli.geometry.arrays import Image

FPS = 5.0
"""Frames of a drive in a second: slow enough to look at each."""
CODEC = "mp4v"
FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1)


def write_video(images: Iterable[Image], path: Path) -> None:
    """Write images (H, W, 3), blue, green, red, as .mp4. They may differ in size; smaller ones get black margins.

    One image at a time is in memory: the size of the video is known only once all have been drawn, so they wait in
    files without loss.

    Raises:
        InputError: OpenCV has no codec, or the file cannot be written.
    """
    with TemporaryDirectory() as folder:
        files, height, width = list[str](), 0, 0
        for image in images:
            files.append(f"{folder}/{len(files)}.png")
            if not cv2.imwrite(files[-1], image, FAST):
                raise InputError(f"{path}: its images cannot be written to {folder}")
            height, width = max(height, image.shape[0]), max(width, image.shape[1])
        size = width + width % 2, height + height % 2  # The codec takes even sides.
        part = Path(folder) / "video.mp4"
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*CODEC), FPS, size)
        for file in files:
            writer.write(_padded(file, size))
        writer.release()
        if not part.is_file() or not part.stat().st_size:
            raise InputError(f"{path}: OpenCV cannot write videos here, since it has no FFmpeg")
        write_bytes(part.read_bytes(), path)


def _padded(file: str, size: tuple[int, int]) -> Image:
    """Read an image, with black margins to a size (width, height) in pixels."""
    image = cv2.imread(file)
    assert image is not None
    canvas: Image = np.zeros((size[1], size[0], 3), np.uint8)
    canvas[: image.shape[0], : image.shape[1]] = image
    return canvas
