"""Displacement of label images against their pictures, in pixels and in scale."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.displacement import Displaced, find_displaced
from semcal_cli.drive.observations import Observations
from semcal_cli.threads import thread_pool

Picture = npt.NDArray[np.uint8]

NUM_PICTURES = 4
"""Number of frames whose pictures are read first."""
MIN_Z_TO_READ_ON = 1.0
"""Gain of the fit in standard errors above which the pictures of all frames are read."""
MAX_SHIFT_PX = 12
"""Largest displacement of any part of a label image that is tried, in pixels, across as well as down."""
SCALES = (-0.015, -0.01, -0.005, 0.0, 0.005, 0.01, 0.015)
"""Changes of the scale of label images that are tried."""
MAX_GOOD_PX = 1.5
"""Largest shift that label images of a good drive may have. Networks draw borders that are about as far off."""
MIN_BAD_PX = 2.5
"""Smallest displacement that is looked for, root mean square over the label image."""
ROWS, COLUMNS = 6, 8
"""Tiles of a label image, down and across."""


@dataclass(frozen=True)
class Move:
    """A displacement of a label image: each pixel by a shift and by a share of its way from the middle."""

    right_px: int
    down_px: int
    scale: float


@dataclass(frozen=True)
class MovedPixels:
    """The move at which label images fit their pictures best."""

    move: Move
    displaced: Displaced
    num_pictures: int
    """Number of pictures that were looked at."""


def find_moved_pixels(
    observations: Observations, read_picture: Callable[[int], Picture | None]
) -> MovedPixels | None:
    """Find the move at which label images of all or some frames fit their pictures better.

    A few pictures are read. If they leave a doubt, all are.

    Args:
        observations: The label images.
        read_picture: Reads the picture (H, W, 3) of a frame by its index; None if there is none.

    Returns:
        None if no picture can be read.
    """
    few = spread(observations.num_frames)
    found = _look(observations, read_picture, few)
    if found is None or found.displaced.z <= MIN_Z_TO_READ_ON or len(few) == observations.num_frames:
        return found
    return _look(observations, read_picture, range(observations.num_frames))


def spread(num_frames: int) -> list[int]:
    """Spread a few indices over those of all frames, even and odd ones by turns, for every other frame may differ."""
    if num_frames <= NUM_PICTURES:
        return list(range(num_frames))
    evenly = (place * (num_frames - 1) // (NUM_PICTURES - 1) for place in range(NUM_PICTURES))
    return [index - (index + place) % 2 if index else 0 for place, index in enumerate(evenly)]


def _look(
    observations: Observations, read_picture: Callable[[int], Picture | None], indices: Iterable[int]
) -> MovedPixels | None:
    def steps_of(index: int) -> npt.NDArray[np.float32] | None:
        picture = read_picture(index)
        if picture is None:
            return None
        image = observations.images[index].core
        return _core.steps_at_label_borders(picture, image, reach=MAX_SHIFT_PX, tiles=(ROWS, COLUMNS))

    indices = list(indices)
    with thread_pool() as pool:
        steps = dict(zip(indices, pool.map(steps_of, indices), strict=True))
    found = {index: each.reshape(ROWS * COLUMNS, -1) for index, each in steps.items() if each is not None}
    if not found:
        return None
    camera = observations.camera
    moves = _moves(camera.width, camera.height)
    fits = np.array(list(found.values()), np.float64)[:, moves.tiles[:, None], moves.places]
    best = find_displaced(fits, moves.is_good)
    with_picture = list(found)
    frames = tuple(with_picture[place] for place in best.frames)
    return MovedPixels(moves[best.candidate], Displaced(best.candidate, frames, best.z), len(found))


@dataclass(frozen=True, eq=False)
class _Moves:
    """All moves that are tried, and where each takes the tiles of a label image."""

    right_down_scale: npt.NDArray[np.float64]
    """(moves, 3) the moves."""
    is_good: npt.NDArray[np.bool_]
    """(moves,) whether label images of a good drive may be displaced so."""
    tiles: npt.NDArray[np.int64]
    """(tiles,) order of the tiles, in which those of the two colours of a chessboard take turns."""
    places: npt.NDArray[np.int64]
    """(tiles, moves) index of the shift of each tile, in this order, in its table of sums."""

    def __getitem__(self, index: int) -> Move:
        right_px, down_px, scale = self.right_down_scale[index].tolist()
        return Move(int(right_px), int(down_px), scale)


def _moves(width: int, height: int) -> _Moves:
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    tiles = np.argsort((row + column) % 2, kind="stable").reshape(2, -1).T.ravel()
    shifts = np.arange(-MAX_SHIFT_PX, MAX_SHIFT_PX + 1, dtype=np.float64)
    scale, down_px, right_px = (each.ravel() for each in np.meshgrid(SCALES, shifts, shifts, indexing="ij"))
    u = np.outer((column[tiles] + 0.5) / COLUMNS - 0.5, width * scale) + right_px
    v = np.outer((row[tiles] + 0.5) / ROWS - 0.5, height * scale) + down_px
    size_px = np.sqrt(np.mean(u**2 + v**2, axis=0))
    is_good = (scale == 0.0) & (size_px <= MAX_GOOD_PX)
    to_column, to_row = (np.rint(each).astype(np.int64) + MAX_SHIFT_PX for each in (u, v))
    is_reached = np.all((np.abs(u) < MAX_SHIFT_PX + 0.5) & (np.abs(v) < MAX_SHIFT_PX + 0.5), axis=0)
    tried = np.flatnonzero(is_reached & (is_good | (size_px >= MIN_BAD_PX)))
    places = to_row * len(shifts) + to_column
    return _Moves(np.column_stack([right_px, down_px, scale])[tried], is_good[tried], tiles, places[:, tried])
