"""The images that a network sees: a camera's image, rectified or not, brought to the network's size.

Each pixel of the camera's image knows the view that shows it best, and its place there, so that what the network says
of the views is carried back in one step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.errors import InputError
from semcal_cli.labelling.card import Fit, Resample

Image: TypeAlias = npt.NDArray[np.uint8]
"""(H, W, 3) blue, green, red."""
Draw: TypeAlias = Callable[[Image], Image]
Places: TypeAlias = npt.NDArray[np.float64]
"""(N, 2) column and row of each pixel of the camera's image in another image; an integer is a pixel centre."""

MAX_VIEWS = 250
"""Most views of an image."""
ONE_VIEW_DEG = 55.0
"""Largest angle from the optical axis, in degrees, that a single rectified image shows."""
FACE_DEG = 50.0
"""Half of the field of view of a face of the cube that rectifies wider lenses: faces overlap by ten degrees."""
FACES = tuple(
    np.asarray(cv2.Rodrigues(np.array(turn))[0].round(), np.float64)
    for turn in (
        *((0.0, -0.5 * math.pi * quarters, 0.0) for quarters in range(4)),
        *((sign * 0.5 * math.pi, 0.0, 0.0) for sign in (1.0, -1.0)),
    )
)
"""R_face_camera (3, 3) of the faces of a cube: front, right, back, left, below, above."""
MAX_RECTIFIED = 2.0
"""Largest size of a rectified image, in widths and heights of the camera's."""


class Shown(NamedTuple):
    """An image made of the camera's: as it is or rectified, or a part of that in the network's size."""

    size: tuple[int, int]
    """Columns and rows."""
    draw: Draw
    places: Places
    """Places of the camera's pixels; NaN where this image does not show them."""
    merit: npt.NDArray[np.float64]
    """(N,) how well this image shows each pixel of the camera's; minus infinity where it does not."""
    start: tuple[int, int] = (0, 0)
    """Column and row at which a tile begins in the image that it is cut from."""


@dataclass(frozen=True)
class Fitting:
    """How an image comes to the network's size."""

    size: tuple[int, int]
    """Columns and rows of each view."""
    fit: Fit
    padding: Sequence[int]
    """Blue, green and red of what is beyond an image."""
    overlap: float
    """Least share of a tile that its neighbour shows, too."""
    resample: Resample | None = None
    """How an image is scaled; None for the mean where it shrinks, and linearly where it grows."""
    scaled: Callable[[tuple[int, int]], tuple[int, int]] = lambda size: size
    """Gives the columns and rows to which an image is scaled before it is cut into tiles, of its own."""


@dataclass(frozen=True, eq=False)
class Mosaic:
    """Images that are cut into tiles, whose scores are joined again."""

    sizes: tuple[tuple[int, int], ...]
    """Columns and rows of each image."""
    tiles: tuple[tuple[int, tuple[int, int]], ...]
    """Image of each view, and the column and row at which the view begins there."""
    images: npt.NDArray[np.uint8]
    """(N,) the image that shows each pixel of the camera's image best, or `_core.NO_VIEW`."""
    places: npt.NDArray[np.float32]
    """(N, 2) the pixel's place there."""

    def joined(self, scores: Sequence[npt.NDArray[np.float32]]) -> list[npt.NDArray[np.float32]]:
        """Join scores (C, h, w) of each view to (C, H, W) of each image: the mean where tiles overlap.

        This is how transformers (`merge_image_patches` of EoMT's processor) and MMSegmentation join windows.
        """
        sums = [np.zeros((len(scores[0]), rows, columns), np.float32) for columns, rows in self.sizes]
        counts = [np.zeros((rows, columns), np.float32) for columns, rows in self.sizes]
        for (image, (left, top)), of_tile in zip(self.tiles, scores, strict=True):
            columns, rows = self.sizes[image]
            shown = of_tile[:, : rows - top, : columns - left]
            across, down = slice(left, left + shown.shape[2]), slice(top, top + shown.shape[1])
            sums[image][:, down, across] += shown
            counts[image][down, across] += 1.0
        for total, count in zip(sums, counts, strict=True):
            total /= np.maximum(count, 1.0)
            # No pixel reads what no tile shows; equal shares keep probabilities what they are.
            total[:, count == 0.0] = 1.0 / len(total)
        return sums


@dataclass(frozen=True, eq=False)
class Views:
    """What a network sees of a camera's image."""

    draws: tuple[Draw, ...]
    """Functions that make the views of the camera's image."""
    size: tuple[int, int]
    """Columns and rows of each view."""
    views: npt.NDArray[np.uint8]
    """(N,) the view that shows each pixel of the camera's image best, or `_core.NO_VIEW`."""
    places: npt.NDArray[np.float32]
    """(N, 2) the pixel's place there."""
    mosaic: Mosaic | None = None
    """The images that the views are tiles of; None if no image is cut into several."""

    def places_on(self, columns: int, rows: int, *, align_corners: bool) -> npt.NDArray[np.float32]:
        """Places (N, 2) on a grid that covers a view: at any stride, so that borders or outermost centres agree."""
        (width, height), grid = self.size, np.array([columns, rows], np.float32)
        size = np.array([width, height], np.float32)
        if align_corners:
            return np.asarray(self.places * ((grid - 1) / np.maximum(size - 1, 1)), np.float32)
        return np.asarray((self.places + 0.5) * (grid / size) - 0.5, np.float32)


def make_views(camera: Camera, fitting: Fitting, *, is_rectified: bool) -> Views:
    """Plan the views of a camera's images.

    Args:
        camera: The camera, with its lens.
        fitting: How an image comes to the network's size.
        is_rectified: Whether the network sees images without the lens's distortion.

    Raises:
        InputError: tiles would be too many.
    """
    if is_rectified:
        sources = list(_rectified(camera))
    else:
        pixels = _pixels(camera)
        sources = [Shown(camera.size, lambda image: image, pixels, np.zeros(len(pixels)))]
    best = np.argmax([source.merit for source in sources], axis=0)
    num_pixels = camera.width * camera.height
    views, places = _nowhere(num_pixels)
    images, places_there = _nowhere(num_pixels)
    draws: list[Draw] = []
    tiles: list[tuple[int, tuple[int, int]]] = []
    sizes: list[tuple[int, int]] = []
    for index, source in enumerate(sources):
        is_here = (best == index) & np.isfinite(source.merit)
        if not is_here.any():
            continue
        merit = np.full(num_pixels, -np.inf)
        if fitting.fit == "tiles" and (sides := fitting.scaled(source.size)) != source.size:
            source = _part(source, (0, 0), source.size, sides, (0, 0), replace(fitting, size=sides))
        images[is_here], places_there[is_here] = len(sizes), source.places[is_here]
        for view in _parts(source, fitting):
            is_better = is_here & (view.merit > merit)
            if not is_better.any() and not _reaches(view, source.places[is_here]):
                continue
            if len(draws) == MAX_VIEWS:
                columns, rows = fitting.size
                raise InputError(
                    f"fit: found more than {MAX_VIEWS} tiles of {columns} x {rows}, needed fewer"
                )
            views[is_better], places[is_better] = len(draws), view.places[is_better]
            merit[is_better] = view.merit[is_better]
            draws.append(view.draw)
            tiles.append((len(sizes), view.start))
        sizes.append(source.size)
    is_cut = len(tiles) > len(sizes)
    mosaic = Mosaic(tuple(sizes), tuple(tiles), images, places_there) if is_cut else None
    return Views(tuple(draws), fitting.size, views, places, mosaic)


def _nowhere(num_pixels: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """Make the views and places of pixels that no view shows."""
    return np.full(num_pixels, _core.NO_VIEW, np.uint8), np.zeros((num_pixels, 2), np.float32)


def _reaches(tile: Shown, places: Places) -> bool:
    """Tell whether scores of a tile are interpolated at some of the places (N, 2) in the image that it is cut from."""
    start = np.array(tile.start)
    return bool(((places > start - 1) & (places < start + tile.size)).all(axis=1).any())


def _pixels(camera: Camera) -> Places:
    columns, rows = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    return np.stack([columns.ravel(), rows.ravel()], axis=1)


# Rectified images


def _rectified(camera: Camera) -> Iterator[Shown]:
    """Yield one rectified image along the optical axis, or the faces of a cube for a lens that sees too much."""
    lens = core_camera(camera)
    rays = lens.unproject(_pixels(camera))
    inside = np.isfinite(rays).all(axis=1)
    if not inside.any():
        raise InputError("--rectify: found a lens that reaches no pixel, needed another")
    focal, forward = lens.pixels_per_radian, np.clip(rays[inside, 2].min(), -1.0, 1.0)
    if math.degrees(math.acos(forward)) > ONE_VIEW_DEG:
        side = max(round(2.0 * math.tan(math.radians(FACE_DEG)) * focal), 1)
        center = np.full(2, (side - 1) / 2.0)
        for R_face_camera in FACES:
            yield _pinhole(lens, rays, R_face_camera, focal, center, (side, side))
        return
    # All that the camera sees, of the same scale on the optical axis if that is not too large.
    slopes = rays[inside, :2] / rays[inside, 2:]
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    most = MAX_RECTIFIED * np.array([camera.width, camera.height])
    focal *= min(1.0, *(most / (np.ceil(focal * (high - low)) + 1)))
    columns, rows = (int(side) for side in np.ceil(focal * (high - low)) + 1)
    yield _pinhole(lens, rays, np.eye(3), focal, -focal * low, (columns, rows))


def _pinhole(
    lens: _core.Camera,
    rays_camera: npt.NDArray[np.float64],
    R_face_camera: npt.NDArray[np.float64],
    focal: float,
    center: npt.NDArray[np.float64],
    size: tuple[int, int],
) -> Shown:
    """Make an image without distortion; `rays_camera` (N, 3) are those of the camera's pixels."""
    columns, rows = size
    u, v = np.meshgrid((np.arange(columns) - center[0]) / focal, (np.arange(rows) - center[1]) / focal)
    taken = lens.project(np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1) @ R_face_camera)
    # What the lens does not reach takes the colour of a corner.
    taken = np.where(np.isfinite(taken), taken, -1e4).reshape(rows, columns, 2)
    across, down = taken[..., 0].astype(np.float32), taken[..., 1].astype(np.float32)
    rays_face = rays_camera @ R_face_camera.T
    forward = rays_face[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        places = focal * rays_face[:, :2] / forward[:, None] + center
    shown = ((places >= -0.5) & (places < np.array(size) - 0.5)).all(axis=1)
    merit = np.where(shown & (forward > 0.0), forward, -np.inf)

    def draw(image: Image) -> Image:
        # An image all round goes on beyond its border, by less than a pixel.
        drawn = cv2.remap(image, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(drawn, np.uint8)

    return Shown(size, draw, places, merit)


# The network's size


def _parts(source: Shown, fitting: Fitting) -> Iterator[Shown]:
    """Yield the network's images of an image, or of its parts."""
    (width, height), (columns, rows) = source.size, fitting.size
    if fitting.fit == "tiles":
        tile = min(columns, width), min(rows, height)
        for left in _starts(width, columns, fitting.overlap):
            for top in _starts(height, rows, fitting.overlap):
                yield _part(source, (left, top), tile, tile, (0, 0), fitting)
        return
    across, down = columns / width, rows / height
    if fitting.fit == "letterbox":
        across = down = min(across, down)
    scaled = (min(max(round(width * across), 1), columns), min(max(round(height * down), 1), rows))
    corner = (columns - scaled[0]) // 2, (rows - scaled[1]) // 2
    yield _part(source, (0, 0), source.size, scaled, corner, fitting)


def _starts(length: int, side: int, overlap: float) -> list[int]:
    """First pixels of tiles of a side along a length, evenly spread; one for all if it is longer."""
    if length <= side:
        return [0]
    count = math.ceil((length - side) / ((1.0 - overlap) * side)) + 1
    return [int(place) for place in np.linspace(0, length - side, count)]


def _part(
    source: Shown,
    start: tuple[int, int],
    extent: tuple[int, int],
    scaled: tuple[int, int],
    corner: tuple[int, int],
    fitting: Fitting,
) -> Shown:
    """Make the network's image of the part of an image that begins at `start`; columns stand first.

    The part is scaled from `extent` pixels to `scaled` ones, and begins at `corner` there.
    """
    (left, top), (width, height), size = start, extent, fitting.size
    places = source.places - np.array(start)
    inside = ((places >= -0.5) & (places < np.array(extent) - 0.5)).all(axis=1)
    # The part whose border is farthest away shows a pixel best; the image's own border is no part's.
    to_start = np.where(np.array(start) == 0, np.inf, places + 0.5)
    to_end = np.where(np.add(start, extent) >= source.size, np.inf, np.array(extent) - 0.5 - places)
    merit = np.where(inside, np.minimum(to_start, to_end).min(axis=1), -np.inf)
    moved = (places + 0.5) * (np.array(scaled) / np.array(extent)) - 0.5 + np.array(corner)
    borders = (corner[1], size[1] - corner[1] - scaled[1], corner[0], size[0] - corner[0] - scaled[0])

    def draw(image: Image) -> Image:
        drawn: Any = source.draw(image)[top : top + height, left : left + width]
        if scaled != extent:
            drawn = resized(drawn, scaled, fitting.resample)
        if any(borders):
            drawn = cv2.copyMakeBorder(drawn, *borders, cv2.BORDER_CONSTANT, value=tuple(fitting.padding))
        return np.asarray(drawn, np.uint8)

    return Shown(size, draw, moved, merit, start)


def resized(image: Image, size: tuple[int, int], resample: Resample | None) -> Image:
    """Scale an image to columns and rows."""
    if resample is not None:
        import PIL.Image

        how = PIL.Image.Resampling[resample.upper()]
        return np.asarray(PIL.Image.fromarray(image).resize(size, how))
    shrinks = size[0] < image.shape[1] or size[1] < image.shape[0]
    interpolation = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=interpolation), np.uint8)
