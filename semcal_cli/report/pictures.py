"""Pictures of frames for a page, whose script draws the points on them."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
import PIL.Image
import PIL.WebPImagePlugin

from semcal_cli.drive.observations import Observations
from semcal_cli.report.edges import coloring_of, edge_picture, is_edge
from semcal_cli.report.overlay import Image, Overlays, picture_of
from semcal_cli.report.palette import (
    DISAGREES,
    Coloring,
    color_tables,
    legends,
)
from semcal_cli.report.points import FramePoints, frame_points
from semcal_cli.threads import thread_pool

MAX_FRAMES = 20
MAX_PICTURE_BYTES, MAX_POINT_BYTES = 1_600_000, 1_400_000
"""Largest size of all pictures, and of all points, together; as base64 text they are a third longer."""
MAX_BYTES = 250_000
"""Largest size of one picture."""
MAX_POINTS = 24_000
"""Largest number of points of a picture."""
BEST_SHARES = 3
"""Shares of the bytes that the best picture gets, which stands first and large."""
MAX_COLUMNS, MIN_COLUMNS = 1280, 64
QUALITY, EFFORT = 60, 2
"""Settings of WebP's encoder."""
SHRINK = 0.95
"""Factor on the width of an image; its bytes fall a little slower than its pixels."""
SEEN_PX = 2.0
"""Displacement below which nothing can be seen to move."""
CELLS, WINDOW = 30, (3, 5)
"""Cells across a picture in which disagreeing points are counted, and rows and columns of the magnified part."""
MIN_DISAGREEING = 8
"""Least number of disagreeing points in a part that is magnified."""


@dataclass(frozen=True)
class Crop:
    """The part of a picture in which most points disagree."""

    window: tuple[float, float, float, float]
    """Left and upper end, width and height, as shares of the picture."""
    num_disagreeing: int
    num_judged: int


@dataclass(frozen=True)
class Picture:
    """The picture of one frame, with its points for the page's script."""

    name: str
    """Name of the frame."""
    number: int
    """Number of the frame among those shown, from 0."""
    width: int
    height: int
    ground: Literal["photograph", "labels", "edges"]
    """What it shows: the label image where a drive has no picture, and the picture's edges with those of sweeps."""
    uri: str
    agreements: tuple[float | None, ...]
    """Share of the visible points that agree, by drawn pose."""
    points: dict[str, object]
    """See `FramePoints.packed`."""


@dataclass(frozen=True)
class Pictures:
    """Pictures of evenly spaced frames, at the poses under their captions."""

    captions: tuple[str, ...]
    """What the poses are called. If points cannot be seen to move between them, only the last one is drawn."""
    best: Picture
    """The picture on which most points agree."""
    by: Coloring
    """What colours say at first."""
    others: tuple[Picture, ...]
    """All others, in the order of the drive."""
    worst: tuple[Picture, Crop] | None
    """The part of all pictures in which most points disagree; None of edges, of which many have no partner anywhere."""
    moved_px: tuple[float, float] | None
    """Median and 95 % quantile of the pixels by which points move between the poses; None for one pose."""
    palette: dict[str, list[list[int] | None]]
    """Red, green and blue by class or edge, by level of depth, and by agreement; None for what is not drawn."""
    legends: dict[str, dict[str, str]]
    """Colour of each name, #rrggbb, by what colours say."""

    @property
    def is_moved(self) -> bool:
        """Whether points can be seen to move between the poses."""
        return self.moved_px is not None and self.moved_px[1] >= SEEN_PX

    @property
    def num_frames(self) -> int:
        """Number of pictures."""
        return 1 + len(self.others)


def make_pictures(overlays: Overlays) -> Pictures:
    """Project the points of all frames, choose the best picture, and pack all, in parallel.

    Args:
        overlays: Frames, at most `MAX_FRAMES`, and poses.

    Raises:
        InputError: an image is missing or wrong.
    """
    observations, views = overlays.observations, list(overlays.views.values())
    together = overlays.together
    numbers = range(observations.num_frames)
    with thread_pool() as pool:
        projected = list(pool.map(lambda number: frame_points(views, number, together), numbers))
        moved_px = _moved_px(projected) if len(views) > 1 else None
        if moved_px is not None and moved_px[1] < SEEN_PX:
            projected = [replace(points, poses=points.poses[-1:]) for points in projected]
        best = _best(projected)
        made = list(pool.map(_packer(overlays, projected, best), numbers))
    shown = [points.classes[points.poses[-1].is_visible] for points in projected]
    return Pictures(
        captions=tuple(overlays.poses),
        best=made[best],
        by=overlays.by,
        others=tuple(picture for number, picture in enumerate(made) if number != best),
        worst=_worst(projected, made) if coloring_of(observations) == "class" else None,
        moved_px=moved_px,
        palette=color_tables(observations),
        legends=legends(observations, np.concatenate(shown)),
    )


def _best(projected: Sequence[FramePoints]) -> int:
    """Find the frame on which most points agree, of those that do not show much less than others."""
    shown = [points.poses[-1] for points in projected]
    enough = 0.5 * float(np.median([points.num_judged for points in shown]))
    return max(
        range(len(shown)),
        key=lambda frame: (shown[frame].num_judged >= enough, shown[frame].agreement or 0.0, -frame),
    )


def _packer(overlays: Overlays, projected: Sequence[FramePoints], best: int) -> Callable[[int], Picture]:
    num_shares = len(projected) + BEST_SHARES - 1
    bytes_per_point = 1 + 6 * len(projected[0].poses)

    def pack(number: int) -> Picture:
        share = BEST_SHARES if number == best else 1
        points = projected[number]
        most = min(MAX_POINTS, share * MAX_POINT_BYTES // (num_shares * bytes_per_point))
        few = few_points(overlays.observations, points, most)
        image, ground = _ground(overlays, number)
        height, width = image.shape[:2]
        return Picture(
            name=overlays.frame_names[number],
            number=number,
            width=width,
            height=height,
            ground=ground,
            uri=data_uri(image, min(MAX_BYTES, share * MAX_PICTURE_BYTES // num_shares)),
            agreements=tuple(pose.agreement for pose in points.poses),
            points=few.packed(width, height),
        )

    return pack


def _ground(overlays: Overlays, number: int) -> tuple[Image, Literal["photograph", "labels", "edges"]]:
    """Draw what lies beneath the points of a frame."""
    if coloring_of(overlays.observations) == "edge":
        return edge_picture(overlays.drive, overlays.drive.frames[number]), "edges"
    image, is_photograph = picture_of(overlays.drive, overlays.observations, number)
    return image, "photograph" if is_photograph else "labels"


def few_points(observations: Observations, points: FramePoints, most: int) -> FramePoints:
    """Keep at most this number of points of a frame, those with an edge before all others."""
    return points.thinned(most, is_edge(points.classes) if coloring_of(observations) == "edge" else None)


def _worst(projected: Sequence[FramePoints], made: Sequence[Picture]) -> tuple[Picture, Crop] | None:
    crops = [_crop(points, picture) for points, picture in zip(projected, made, strict=True)]
    worst = max(range(len(made)), key=lambda frame: (crops[frame].num_disagreeing, -frame))
    return (made[worst], crops[worst]) if crops[worst].num_disagreeing >= MIN_DISAGREEING else None


def _crop(points: FramePoints, picture: Picture) -> Crop:
    """Find the part of a picture in which most points disagree."""
    pose = points.poses[-1]
    size_px = picture.width / CELLS
    rows = max(WINDOW[0], math.ceil(picture.height / size_px))
    judged = pose.is_visible & (pose.kinds <= DISAGREES)
    cells = np.floor((pose.positions[judged] + 0.5) / size_px).astype(np.intp)
    u, v = cells[:, 0].clip(0, CELLS - 1), cells[:, 1].clip(0, rows - 1)
    counts = np.zeros((2, rows, CELLS))
    np.add.at(counts[0], (v, u), pose.kinds[judged] == DISAGREES)
    np.add.at(counts[1], (v, u), 1.0)
    sums = np.lib.stride_tricks.sliding_window_view(counts, WINDOW, axis=(1, 2)).sum(axis=(3, 4))
    row, column = np.unravel_index(int(sums[0].argmax()), sums[0].shape)
    height = min(WINDOW[0] * size_px / picture.height, 1.0)
    top = min(row * size_px / picture.height, 1.0 - height)
    window = float(column / CELLS), float(top), WINDOW[1] / CELLS, float(height)
    return Crop(window, int(sums[0, row, column]), int(sums[1, row, column]))


def _moved_px(projected: Sequence[FramePoints]) -> tuple[float, float]:
    moved = np.concatenate([points.moved_px() for points in projected])
    if len(moved) == 0:
        return math.inf, math.inf
    return float(np.median(moved)), float(np.quantile(moved, 0.95))


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
    content = io.BytesIO()
    # OpenCV has no choice of the effort, and takes twice the time for five per cent fewer bytes.
    pillow = PIL.Image.fromarray(cv2.cvtColor(small, cv2.COLOR_BGR2RGB))
    pillow.save(content, "WEBP", quality=QUALITY, method=EFFORT)
    return content.getvalue()
