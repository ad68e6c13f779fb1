"""Images of frames for a page, on which its script draws the points."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import cv2
import numpy as np
import PIL.Image
import PIL.WebPImagePlugin

from semcal_cli.geometry.arrays import Image
from semcal_cli.report.colors import (
    DISAGREES,
    ColorMeaning,
    PageColors,
    coloring_of,
    first_coloring,
    hex_legend,
    page_colors,
)
from semcal_cli.report.overlays import Overlays, edge_image, image_of
from semcal_cli.report.points import FramePoints, frame_points
from semcal_cli.threads import thread_pool

MAX_FRAMES = 20
MAX_IMAGE_BYTES, MAX_POINT_BYTES = 1_600_000, 1_400_000
"""Largest total size of the images, and of the points; base64 makes them a third longer."""
MAX_BYTES = 250_000
"""Largest size of one image."""
MAX_POINTS = 24_000
"""Largest number of points of an image."""
BEST_SHARES = 3
"""Shares of the bytes for the best image, which comes first and is large."""
MAX_COLUMNS, MIN_COLUMNS = 1280, 64
QUALITY, EFFORT = 60, 2
"""Settings of WebP's encoder."""
SHRINK = 0.95
"""Factor on the width of an image; its bytes fall a little slower than its pixels."""
MIN_VISIBLE_PX = 2.0
"""Displacement below which no motion is visible."""
CELLS, WINDOW = 30, (3, 5)
"""Number of cells across an image in which disagreeing points are counted, and cells of the magnified part."""
MIN_DISAGREEING = 8
"""Minimum number of disagreeing points in a magnified part."""


@dataclass(frozen=True)
class FrameImage:
    """The image of one frame, with its points for the page's script."""

    name: str
    """Name of the frame."""
    number: int
    """Number of the frame among those shown, from 0."""
    width: int
    height: int
    ground: Literal["photograph", "labels", "edges"]
    """What it shows: a photograph, the label image if there is none, or edges for the cue edges."""
    uri: str
    agreements: tuple[float | None, ...]
    """Share of the visible points that agree, by drawn pose."""
    points: dict[str, object]
    """See `FramePoints.encode`."""
    photograph: str = ""
    """The photograph behind edges, which other colours of the points are drawn on."""


@dataclass(frozen=True)
class Crop:
    """The part of an image in which most points disagree."""

    image: FrameImage
    window: tuple[float, float, float, float]
    """Left, top, width and height, relative to the image."""
    num_disagreeing: int
    num_judged: int


@dataclass(frozen=True)
class FrameImages:
    """Images of evenly spaced frames with the points at each captioned pose."""

    captions: tuple[str, ...]
    """Captions of the poses. Only the last pose is drawn if no motion between them is visible."""
    best: FrameImage
    """The image on which most points agree."""
    by: ColorMeaning
    """Meaning of the colours at first."""
    others: tuple[FrameImage, ...]
    """All others, in the order of the drive."""
    worst: Crop | None
    """The part of all images in which most points disagree; None for edges, many of which have no counterpart."""
    moved_px: tuple[float, float] | None
    """Median and 95 % quantile of the movement of points between the poses, pixels; None for one pose."""
    colors: PageColors

    @property
    def is_moved(self) -> bool:
        """Whether the motion of points between the poses is visible."""
        return self.moved_px is not None and self.moved_px[1] >= MIN_VISIBLE_PX

    @property
    def num_frames(self) -> int:
        """Number of images."""
        return 1 + len(self.others)


def make_images(overlays: Overlays) -> FrameImages:
    """Project the points of all frames, choose the best image, and pack all, in parallel.

    Args:
        overlays: Frames, at most `MAX_FRAMES`, and poses.

    Raises:
        InputError: an image is missing or wrong.
    """
    observations, views = overlays.observations, list(overlays.views.values())
    is_associated, frames = overlays.is_associated, range(observations.num_frames)
    with thread_pool() as pool:
        points_of_frames = list(pool.map(lambda frame: frame_points(views, frame, is_associated), frames))
        moved_px = _moved_px(points_of_frames) if len(views) > 1 else None
        if moved_px is not None and moved_px[1] < MIN_VISIBLE_PX:
            points_of_frames = [points._replace(poses=points.poses[-1:]) for points in points_of_frames]
        best = _best_frame(points_of_frames)
        num_shares = len(points_of_frames) + BEST_SHARES - 1
        shares = [Fraction(BEST_SHARES if frame == best else 1, num_shares) for frame in frames]
        images = list(
            pool.map(lambda frame: _pack(overlays, frame, points_of_frames[frame], shares[frame]), frames)
        )
    visible_classes = np.concatenate(
        [points.classes[points.poses[-1].is_visible] for points in points_of_frames]
    )
    return FrameImages(
        captions=tuple(overlays.poses),
        best=images[best],
        by=overlays.by,
        others=tuple(image for frame, image in enumerate(images) if frame != best),
        worst=_worst_crop(points_of_frames, images) if first_coloring(observations) == "class" else None,
        moved_px=moved_px,
        colors=page_colors(observations, visible_classes),
    )


def _best_frame(points_of_frames: Sequence[FramePoints]) -> int:
    """Find the frame on which most points agree, among those that show enough points."""
    last_poses = [points.poses[-1] for points in points_of_frames]
    min_judged = 0.5 * float(np.median([points.num_judged for points in last_poses]))
    return max(
        range(len(last_poses)),
        key=lambda frame: (
            last_poses[frame].num_judged >= min_judged,
            last_poses[frame].agreement or 0.0,
            -frame,
        ),
    )


def _pack(overlays: Overlays, frame: int, points: FramePoints, share: Fraction) -> FrameImage:
    """Make the image of a frame, given its share of the total bytes."""
    drive, observations, point_share = overlays.drive, overlays.observations, share
    ground: Literal["photograph", "labels", "edges"] = "edges"
    photograph = ""
    if coloring_of(observations) == "edge":
        image = edge_image(drive, observations, frame)
        share /= 2  # the page is no larger for the second picture
        photograph = data_uri(image_of(drive, observations, frame)[0], share)
    else:
        image, is_photograph = image_of(drive, observations, frame)
        ground = "photograph" if is_photograph else "labels"
    height, width = image.shape[:2]
    bytes_per_point = 1 + 6 * len(points.poses)
    max_points = min(MAX_POINTS, int(point_share * MAX_POINT_BYTES / bytes_per_point))
    return FrameImage(
        name=overlays.frame_names[frame],
        number=frame,
        width=width,
        height=height,
        ground=ground,
        uri=data_uri(image, share),
        agreements=tuple(None if observations.is_multimodal else pose.agreement for pose in points.poses),
        points=points.thin(max_points).encode(width, height),
        photograph=photograph,
    )


def _worst_crop(points_of_frames: Sequence[FramePoints], images: Sequence[FrameImage]) -> Crop | None:
    crops = map(_crop, points_of_frames, images)
    worst = max(crops, key=lambda crop: (crop.num_disagreeing, -crop.image.number))
    return worst if worst.num_disagreeing >= MIN_DISAGREEING else None


def _crop(points: FramePoints, image: FrameImage) -> Crop:
    """Find the part of an image in which most points disagree."""
    pose = points.poses[-1]
    size_px = image.width / CELLS
    rows = max(WINDOW[0], math.ceil(image.height / size_px))
    is_judged = pose.is_visible & (pose.kinds <= DISAGREES)
    cells = np.floor((pose.positions[is_judged] + 0.5) / size_px).astype(np.intp)
    u, v = cells[:, 0].clip(0, CELLS - 1), cells[:, 1].clip(0, rows - 1)
    counts = np.zeros((2, rows, CELLS))
    np.add.at(counts[0], (v, u), pose.kinds[is_judged] == DISAGREES)
    np.add.at(counts[1], (v, u), 1.0)
    sums = np.lib.stride_tricks.sliding_window_view(counts, WINDOW, axis=(1, 2)).sum(axis=(3, 4))
    row, column = np.unravel_index(int(sums[0].argmax()), sums[0].shape)
    height = min(WINDOW[0] * size_px / image.height, 1.0)
    top = min(row * size_px / image.height, 1.0 - height)
    window = float(column / CELLS), float(top), WINDOW[1] / CELLS, float(height)
    return Crop(image, window, int(sums[0, row, column]), int(sums[1, row, column]))


def _moved_px(points_of_frames: Sequence[FramePoints]) -> tuple[float, float]:
    distances_px = np.concatenate([points.moved_px() for points in points_of_frames])
    if len(distances_px) == 0:
        return math.inf, math.inf
    return float(np.median(distances_px)), float(np.quantile(distances_px, 0.95))


def overlay_uri(overlays: Overlays, share: Fraction) -> tuple[str, dict[str, str]]:
    """Draw the points of the first frame at its only pose, as a data URI, and the legend of their colours.

    Args:
        overlays: A frame and a pose.
        share: Share of the image in the bytes of all images of the page.

    Raises:
        InputError: the image is missing or wrong.
    """
    images, legend = overlays.draw(0)
    (image,) = images.values()
    return data_uri(image, share), hex_legend(legend)


def data_uri(image: Image, share: Fraction) -> str:
    """Encode an image as a data URI, and shrink it until it fits its share of the bytes of all images."""
    max_bytes = min(MAX_BYTES, int(share * MAX_IMAGE_BYTES))
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
    # OpenCV cannot set the effort, and takes twice as long for five per cent fewer bytes.
    pillow = PIL.Image.fromarray(cv2.cvtColor(small, cv2.COLOR_BGR2RGB))
    pillow.save(content, "WEBP", quality=QUALITY, method=EFFORT)
    return content.getvalue()
