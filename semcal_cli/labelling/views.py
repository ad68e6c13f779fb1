"""The images that a network sees: a camera's image, rectified or not, at the network's size.

Each pixel of the camera's image has the view that shows it best and its position there, so that the output for the
views is mapped back in one step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Image, Vectors
from semcal_cli.labelling.card import ImageFit, Place, Resample

DrawView: TypeAlias = Callable[[Image], Image]

MAX_VIEWS = 250
"""Largest number of views of an image."""
ONE_VIEW_DEG = 55.0
"""Largest angle from the optical axis that a single rectified image shows, degrees."""
FACE_DEG = 50.0
"""Half the field of view of the cube faces that rectify wider lenses, degrees; faces overlap by ten degrees."""
FACES = tuple(
    np.asarray(cv2.Rodrigues(np.array(turn))[0].round(), np.float64)
    for turn in (
        *((0.0, -0.5 * math.pi * quarters, 0.0) for quarters in range(4)),
        *((sign * 0.5 * math.pi, 0.0, 0.0) for sign in (1.0, -1.0)),
    )
)
"""R_face_camera (3, 3) of the cube faces: front, right, back, left, below, above."""
MAX_RECTIFIED = 2.0
"""Largest size of a rectified image, relative to the camera's."""


class ViewPart(NamedTuple):
    """An image made from the camera's: the image itself or rectified, or a part of it at the network's size."""

    size: tuple[int, int]
    """Columns and rows."""
    draw: DrawView
    positions: Vectors
    """Positions of the camera's pixels; NaN where this image does not show them."""
    merit: npt.NDArray[np.float64]
    """(N,) how well this image shows each camera pixel; minus infinity where it does not."""
    start: tuple[int, int] = (0, 0)
    """Column and row at which a tile begins in the image that it is cut from."""


@dataclass(frozen=True)
class Fitting:
    """How an image is brought to the network's size."""

    size: tuple[int, int]
    """Columns and rows of each view."""
    fit: ImageFit
    padding: Sequence[int]
    """Blue, green and red of the padding."""
    overlap: float
    """Smallest overlap of neighbouring tiles, as a fraction of a tile."""
    place: Place = "center"
    """Where a letterboxed image lies."""
    resample: Resample | None = None
    """Pillow filter; None for area averaging to shrink and bilinear to enlarge."""
    scaled_size: Callable[[tuple[int, int]], tuple[int, int]] = lambda size: size
    """Computes the columns and rows to which an image is scaled before it is cut into tiles."""


@dataclass(frozen=True, eq=False)
class Mosaic:
    """Images that are cut into tiles, and how to merge the scores of the tiles."""

    sizes: tuple[tuple[int, int], ...]
    """Columns and rows of each image."""
    tiles: tuple[tuple[int, tuple[int, int]], ...]
    """The image that each view is a tile of, and the column and row at which it starts there."""
    images: npt.NDArray[np.uint8]
    """(N,) the image that shows each camera pixel best, or `core.NO_VIEW`."""
    positions: npt.NDArray[np.float32]
    """(N, 2) position of each pixel there."""

    def merge_scores(self, scores: Sequence[npt.NDArray[np.float32]]) -> list[npt.NDArray[np.float32]]:
        """Merge the scores (C, h, w) of the views to those (C, H, W) of the images: the mean where tiles overlap.

        As transformers (`merge_image_patches` of EoMT's processor) and MMSegmentation merge windows.
        """
        sums = [np.zeros((len(scores[0]), rows, columns), np.float32) for columns, rows in self.sizes]
        counts = [np.zeros((rows, columns), np.float32) for columns, rows in self.sizes]
        for (image, (left, top)), tile_scores in zip(self.tiles, scores, strict=True):
            columns, rows = self.sizes[image]
            visible = tile_scores[:, : rows - top, : columns - left]
            across, down = slice(left, left + visible.shape[2]), slice(top, top + visible.shape[1])
            sums[image][:, down, across] += visible
            counts[image][down, across] += 1.0
        for total, count in zip(sums, counts, strict=True):
            total /= np.maximum(count, 1.0)
            # No pixel reads cells without a tile; equal values keep probabilities probabilities.
            total[:, count == 0.0] = 1.0 / len(total)
        return sums


@dataclass(frozen=True, eq=False)
class Views:
    """The images that a network sees of a camera's image."""

    draws: tuple[DrawView, ...]
    """Functions that make the views from the camera's image."""
    size: tuple[int, int]
    """Columns and rows of each view."""
    views: npt.NDArray[np.uint8]
    """(N,) the view that shows each camera pixel best, or `core.NO_VIEW`."""
    positions: npt.NDArray[np.float32]
    """(N, 2) position of each pixel there."""
    mosaic: Mosaic | None = None
    """The images that the views are tiles of; None if no image is cut into several."""

    def positions_on(self, columns: int, rows: int, *, align_corners: bool) -> npt.NDArray[np.float32]:
        """Compute positions (N, 2) on a coarser grid over a view, whose borders or outermost centres are the view's."""
        (width, height), grid = self.size, np.array([columns, rows], np.float32)
        size = np.array([width, height], np.float32)
        if align_corners:
            return np.asarray(self.positions * ((grid - 1) / np.maximum(size - 1, 1)), np.float32)
        return np.asarray((self.positions + 0.5) * (grid / size) - 0.5, np.float32)


def make_views(camera: Camera, fitting: Fitting, *, is_rectified: bool) -> Views:
    """Plan the views of a camera's images.

    Args:
        camera: The camera, with its lens.
        fitting: How an image is brought to the network's size.
        is_rectified: Whether the network sees images without the lens's distortion.

    Raises:
        InputError: there would be too many tiles.
    """
    if is_rectified:
        sources = list(_rectify(camera))
    else:
        pixels = _pixels(camera)
        sources = [ViewPart(camera.size, lambda image: image, pixels, np.zeros(len(pixels)))]
    best = np.argmax([source.merit for source in sources], axis=0)
    num_pixels = camera.width * camera.height
    views, positions = _no_views(num_pixels)
    images, source_positions = _no_views(num_pixels)
    draws: list[DrawView] = []
    tiles: list[tuple[int, tuple[int, int]]] = []
    sizes: list[tuple[int, int]] = []
    for index, source in enumerate(sources):
        is_here = (best == index) & np.isfinite(source.merit)
        if not is_here.any():
            continue
        merit = np.full(num_pixels, -np.inf)
        if fitting.fit == "tiles" and (sides := fitting.scaled_size(source.size)) != source.size:
            source = _make_part(source, (0, 0), source.size, sides, (0, 0), replace(fitting, size=sides))
        images[is_here], source_positions[is_here] = len(sizes), source.positions[is_here]
        for view in _parts(source, fitting):
            is_better = is_here & (view.merit > merit)
            if not is_better.any() and not _overlaps(view, source.positions[is_here]):
                continue
            if len(draws) == MAX_VIEWS:
                columns, rows = fitting.size
                raise InputError(
                    f"fit: found more than {MAX_VIEWS} tiles of {columns} x {rows}, needed fewer"
                )
            views[is_better], positions[is_better] = len(draws), view.positions[is_better]
            merit[is_better] = view.merit[is_better]
            draws.append(view.draw)
            tiles.append((len(sizes), view.start))
        sizes.append(source.size)
    is_cut = len(tiles) > len(sizes)
    mosaic = Mosaic(tuple(sizes), tuple(tiles), images, source_positions) if is_cut else None
    return Views(tuple(draws), fitting.size, views, positions, mosaic)


def _no_views(num_pixels: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """Make the views and positions of pixels that no view shows."""
    return np.full(num_pixels, core.NO_VIEW, np.uint8), np.zeros((num_pixels, 2), np.float32)


def _overlaps(tile: ViewPart, positions: Vectors) -> bool:
    """Return whether a tile has cells that are interpolated at positions (N, 2) in the image that it is cut from."""
    start = np.array(tile.start)
    return bool(((positions > start - 1) & (positions < start + tile.size)).all(axis=1).any())


def _pixels(camera: Camera) -> Vectors:
    columns, rows = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    return np.stack([columns.ravel(), rows.ravel()], axis=1)


# Rectified images


def _rectify(camera: Camera) -> Iterator[ViewPart]:
    """Yield one rectified image along the optical axis, or the faces of a cube for a lens that is too wide."""
    lens = core_camera(camera)
    rays = lens.unproject(_pixels(camera))
    is_inside = np.isfinite(rays).all(axis=1)
    if not is_inside.any():
        raise InputError("--rectify: found a lens that sees none of its pixels; choose another")
    focal, forward = lens.pixels_per_radian, np.clip(rays[is_inside, 2].min(), -1.0, 1.0)
    if math.degrees(math.acos(forward)) > ONE_VIEW_DEG:
        side = max(round(2.0 * math.tan(math.radians(FACE_DEG)) * focal), 1)
        center = np.full(2, (side - 1) / 2.0)
        for R_face_camera in FACES:
            yield _pinhole(lens, rays, R_face_camera, focal, center, (side, side))
        return
    # The whole field of view, at the same scale on the optical axis unless the image gets too large.
    slopes = rays[is_inside, :2] / rays[is_inside, 2:]
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    max_size = MAX_RECTIFIED * np.array([camera.width, camera.height])
    focal *= min(1.0, *(max_size / (np.ceil(focal * (high - low)) + 1)))
    columns, rows = (int(side) for side in np.ceil(focal * (high - low)) + 1)
    yield _pinhole(lens, rays, np.eye(3), focal, -focal * low, (columns, rows))


def _pinhole(
    lens: core.Camera,
    rays_camera: npt.NDArray[np.float64],
    R_face_camera: npt.NDArray[np.float64],
    focal: float,
    center: npt.NDArray[np.float64],
    size: tuple[int, int],
) -> ViewPart:
    """Make an image without distortion; `rays_camera` (N, 3) are those of the camera's pixels."""
    columns, rows = size
    u, v = np.meshgrid((np.arange(columns) - center[0]) / focal, (np.arange(rows) - center[1]) / focal)
    source_pixels = lens.project(np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1) @ R_face_camera)
    # Pixels outside the lens's field of view take the colour of a corner.
    source_pixels = np.where(np.isfinite(source_pixels), source_pixels, -1e4).reshape(rows, columns, 2)
    across, down = source_pixels[..., 0].astype(np.float32), source_pixels[..., 1].astype(np.float32)
    rays_face = rays_camera @ R_face_camera.T
    forward = rays_face[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        positions = focal * rays_face[:, :2] / forward[:, None] + center
    is_shown = ((positions >= -0.5) & (positions < np.array(size) - 0.5)).all(axis=1)
    merit = np.where(is_shown & (forward > 0.0), forward, -np.inf)

    def draw(image: Image) -> Image:
        # A panorama continues beyond its border, by less than a pixel.
        rectified = cv2.remap(image, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(rectified, np.uint8)

    return ViewPart(size, draw, positions, merit)


# The network's size


def _parts(source: ViewPart, fitting: Fitting) -> Iterator[ViewPart]:
    """Yield the network's images of an image or of its tiles."""
    (width, height), (columns, rows) = source.size, fitting.size
    if fitting.fit == "tiles":
        tile = min(columns, width), min(rows, height)
        for left in _starts(width, columns, fitting.overlap):
            for top in _starts(height, rows, fitting.overlap):
                yield _make_part(source, (left, top), tile, tile, (0, 0), fitting)
        return
    across, down = columns / width, rows / height
    if fitting.fit == "letterbox":
        across = down = min(across, down)
    scaled = (min(max(round(width * across), 1), columns), min(max(round(height * down), 1), rows))
    corner = (columns - scaled[0]) // 2, (rows - scaled[1]) // 2
    if fitting.place == "corner":
        corner = (0, 0)
    yield _make_part(source, (0, 0), source.size, scaled, corner, fitting)


def _starts(length: int, side: int, overlap: float) -> list[int]:
    """Return the first pixels of evenly spread tiles along a length; one tile if it covers all."""
    if length <= side:
        return [0]
    count = math.ceil((length - side) / ((1.0 - overlap) * side)) + 1
    return [int(place) for place in np.linspace(0, length - side, count)]


def _make_part(
    source: ViewPart,
    start: tuple[int, int],
    extent: tuple[int, int],
    scaled: tuple[int, int],
    corner: tuple[int, int],
    fitting: Fitting,
) -> ViewPart:
    """Make the network's image of the part of an image that starts at `start`; columns come first.

    The part is scaled from `extent` to `scaled` pixels, and placed at `corner`.
    """
    (left, top), (width, height), size = start, extent, fitting.size
    positions = source.positions - np.array(start)
    is_inside = ((positions >= -0.5) & (positions < np.array(extent) - 0.5)).all(axis=1)
    # The tile whose border is farthest away shows a pixel best; the border of the whole image does not count.
    to_start = np.where(np.array(start) == 0, np.inf, positions + 0.5)
    to_end = np.where(np.add(start, extent) >= source.size, np.inf, np.array(extent) - 0.5 - positions)
    merit = np.where(is_inside, np.minimum(to_start, to_end).min(axis=1), -np.inf)
    scaled_positions = (positions + 0.5) * (np.array(scaled) / np.array(extent)) - 0.5 + np.array(corner)
    borders = (corner[1], size[1] - corner[1] - scaled[1], corner[0], size[0] - corner[0] - scaled[0])

    def draw(image: Image) -> Image:
        part: Any = source.draw(image)[top : top + height, left : left + width]
        if scaled != extent:
            part = resize_image(part, scaled, fitting.resample)
        if any(borders):
            part = cv2.copyMakeBorder(part, *borders, cv2.BORDER_CONSTANT, value=tuple(fitting.padding))
        return np.asarray(part, np.uint8)

    return ViewPart(size, draw, scaled_positions, merit, start)


def resize_image(image: Image, size: tuple[int, int], resample: Resample | None) -> Image:
    """Scale an image to columns and rows."""
    if resample is not None:
        import PIL.Image

        filter_ = PIL.Image.Resampling[resample.upper()]
        return np.asarray(PIL.Image.fromarray(image).resize(size, filter_))
    shrinks = size[0] < image.shape[1] or size[1] < image.shape[0]
    interpolation = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=interpolation), np.uint8)
