"""Pictures of frames with their points, small enough for a page."""

from __future__ import annotations

import base64
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2

from semcal_cli.report.input import ReportInput
from semcal_cli.report.overlay import Legend, Picture, hex_color

MAX_FRAMES = 20
MAX_TOTAL_BYTES = 3_000_000
"""Of all pictures together; as text they are a third longer."""
MAX_BYTES = 250_000
"""Of one picture."""
MAX_COLUMNS, MIN_COLUMNS = 1280, 64
QUALITY = 60
SHRINK = 0.95
"""Bytes fall a little slower than pixels."""


@dataclass(frozen=True)
class FramePictures:
    """One frame, before and after."""

    name: str
    """Its point cloud."""
    width: int
    height: int
    before: str | None
    """Picture as a data URI."""
    after: str


def frame_pictures(report: ReportInput) -> tuple[list[FramePictures], dict[str, str]]:
    """Draw evenly spaced frames before and after, in parallel.

    Returns:
        Pictures, and the colour of each class as #rrggbb.

    Raises:
        InputError: a picture is missing or wrong.
    """
    overlays = report.overlays(MAX_FRAMES)
    numbers = range(overlays.observations.num_frames)
    max_bytes = min(MAX_BYTES, MAX_TOTAL_BYTES // (len(numbers) * len(overlays.poses)))

    def draw(number: int) -> tuple[FramePictures, Legend]:
        pictures, legend = overlays.draw(number)
        *before, after = (_data_uri(picture, max_bytes) for picture in pictures.values())
        height, width = next(iter(pictures.values())).shape[:2]
        name = overlays.drive.frames[number].points
        return FramePictures(name, width, height, before[0] if before else None, after), legend

    with ThreadPoolExecutor() as pool:
        found, legends = zip(*pool.map(draw, numbers), strict=True)
    named = {name: hex_color(color) for legend in legends for name, color in legend.items()}
    return list(found), named


def _data_uri(picture: Picture, max_bytes: int) -> str:
    """Shrink a picture until it is small enough."""
    columns = min(picture.shape[1], MAX_COLUMNS)
    content = _webp(picture, columns)
    while len(content) > max_bytes and columns > MIN_COLUMNS:
        columns = max(MIN_COLUMNS, int(columns * SHRINK * math.sqrt(max_bytes / len(content))))
        content = _webp(picture, columns)
    return f"data:image/webp;base64,{base64.b64encode(content).decode()}"


def _webp(picture: Picture, columns: int) -> bytes:
    height, width = picture.shape[:2]
    size = (columns, max(1, round(columns * height / width)))
    small = picture if columns == width else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".webp", small, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    return content.tobytes()
