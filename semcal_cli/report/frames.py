"""Pictures of frames with their points, small enough for a page."""

from __future__ import annotations

import base64
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2

from semcal_cli.report.colors import Legend, hex_color
from semcal_cli.report.input import ReportInput
from semcal_cli.report.overlay import Image

MAX_FRAMES = 20
MAX_TOTAL_BYTES = 3_000_000
"""Largest size of all images together; as base64 text they are a third longer."""
MAX_BYTES = 250_000
"""Largest size of one image."""
MAX_COLUMNS, MIN_COLUMNS = 1280, 64
QUALITY = 60
SHRINK = 0.95
"""Factor on the width of an image; its bytes fall a little slower than its pixels."""


@dataclass(frozen=True)
class FrameImages:
    """One frame with its points, before and after."""

    name: str
    """Name of the frame's point cloud."""
    width: int
    height: int
    before: str | None
    """Image as a data URI; None without a pose to compare with."""
    after: str


def frame_images(report: ReportInput) -> tuple[list[FrameImages], dict[str, str]]:
    """Draw evenly spaced frames before and after, in parallel.

    Returns:
        Pictures, and the colour of each class as #rrggbb.

    Raises:
        InputError: an image is missing or wrong.
    """
    overlays = report.overlays(MAX_FRAMES)
    numbers = range(overlays.observations.num_frames)
    max_bytes = min(MAX_BYTES, MAX_TOTAL_BYTES // (len(numbers) * len(overlays.poses)))

    def draw(number: int) -> tuple[FrameImages, Legend]:
        images, legend = overlays.draw(number)
        *before, after = (data_uri(image, max_bytes) for image in images.values())
        height, width = next(iter(images.values())).shape[:2]
        name = overlays.drive.frames[number].points
        return FrameImages(name, width, height, before[0] if before else None, after), legend

    with ThreadPoolExecutor() as pool:
        found, legends = zip(*pool.map(draw, numbers), strict=True)
    named = {name: hex_color(color) for legend in legends for name, color in legend.items()}
    return list(found), named


def data_uri(image: Image, max_bytes: int) -> str:
    """Encode an image as a data URI, and shrink it until it is small enough."""
    columns = min(image.shape[1], MAX_COLUMNS)
    content = _webp(image, columns)
    while len(content) > max_bytes and columns > MIN_COLUMNS:
        columns = max(MIN_COLUMNS, int(columns * SHRINK * math.sqrt(max_bytes / len(content))))
        content = _webp(image, columns)
    return f"data:image/webp;base64,{base64.b64encode(content).decode()}"


def _webp(image: Image, columns: int) -> bytes:
    height, width = image.shape[:2]
    size = (columns, max(1, round(columns * height / width)))
    small = image if columns == width else cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    return content.tobytes()
