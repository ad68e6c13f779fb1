"""Whether labels belong to what they label: point labels by order, and label images by their images.

From entry to entry of a sweep, labels change where the range steps, and borders of a label image lie on edges of its
image. If the two coincide better at another displacement, labels belong to other points or pixels: a converter lost
an entry, or another tool resized the label images. Where there are no images, or points have no order, good drives
give no finding either. None of that needs a pose.

Each half of a frame votes for or against a displacement, and its vote decides whether the other half counts. So no half
is chosen by its own fit. The gains of all blocks that count are added up and divided by the root of their summed
squares. If labels fit nothing, blocks gain as often as they lose, and this ratio exceeds z with a probability of at
most exp(-z^2 / 2) (Efron, *Student's t-test under symmetry conditions*, 1969). Labels that are where they belong
lose in nearly all blocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, counted, format_against_limit
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Image, Numbers
from semcal_cli.observations.frame_naming import frame_list
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import read_frame_image
from semcal_cli.threads import thread_pool

SHIFTED_POINT_LABELS = Check(
    topic="shifted-point-labels",
    advice="check that no points were skipped when they were written, and label these sweeps again",
    entry=Entry(
        title="Point labels are shifted",
        section=PageSection.FILES,
        quotes=(
            (
                "point labels fit the clouds better when shifted by 3 entries towards the end of the "
                "file, by 9.1 standard errors (limit 4): check that no points were skipped when "
                "they were written, and label these sweeps again"
            ),
        ),
        meaning="The borders of labels lie a few entries away from steps in range.",
        cause="The labels were written for a point cloud without missing returns, or in another order.",
        remedy="Label the sweeps again: one label for each point in the file, in the order of the file.",
        figure=(
            "Gain in agreement when point labels are shifted along the file. The check needs point "
            "labels in scan order."
        ),
    ),
)
SHIFTED_LABEL_IMAGES = Check(
    topic="shifted-label-images",
    advice="check that they were made from these images at the same size, and label them again",
    entry=Entry(
        title="Label images are shifted",
        section=PageSection.FILES,
        quotes=(
            (
                "label images fit their images better when shifted by 3 pixels right, by 6.3 standard "
                "errors (limit 4): check that they were made from these images at the same size, "
                "and label them again"
            ),
        ),
        meaning="The borders of labels are shifted or scaled relative to the edges in the images.",
        cause=(
            "The labels belong to rectified images although K is raw, a resize is off by half a "
            "stride, or images were padded."
        ),
        remedy="Label the images that the drive names, at their own size, as `semcal label` does.",
        figure="Gain in agreement when label images are shifted or scaled. The check needs images.",
    ),
)
MAX_ENTRIES = 32
"""Largest displacement of point labels that is tried, in entries."""
NUM_BLOCKS = 128
"""Number of blocks of consecutive entries of a sweep."""
NUM_IMAGES = 4
"""Number of frames whose images are read first."""
MIN_Z_TO_READ_ON = 1.0
"""Gain of the fit in standard errors above which the images of all frames are read."""
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


class LabelAlignment(NamedTuple):
    """What labels say about the points and pixels that they belong to."""

    measured: tuple[Measured, ...]
    """How much better labels fit where they are displaced."""
    notes: tuple[str, ...] = ()
    """Sentences about images that could not be read."""


def check_label_alignment(drive: Drive, observations: Observations) -> LabelAlignment:
    """Check that labels of points and pixels belong to them, and say which labels do not.

    Args:
        drive: The drive, for its images and the names of its frames. Images that cannot be read are left out.
        observations: Labelled points, in the order of their files, and label images of the same frames.
    """
    measured, unread = list[Measured](), set[str]()

    def read_image(index: int) -> Image | None:
        image = drive.frames[index].image
        if image is None:
            return None
        try:
            return read_frame_image(drive, drive.frames[index])
        except InputError as error:
            unread.add(str(error).replace(str(drive.resolve(image)), image))
            return None

    def of(displaced: _Displaced) -> str:
        names = [frame.points for frame in drive.frames]
        is_some = len(displaced.frames) not in (0, displaced.num_frames)
        return f" of {frame_list(names, displaced.frames)}" if is_some else ""

    if not observations.has_partitions:
        points = _moved_points(observations)
        better, most = format_against_limit(points.z, SHIFTED_POINT_LABELS.limit(), 1)
        sentence = (
            f"point labels{of(points)} fit the clouds better when {_entries_words(*points.move)}, "
            f"by {better} standard errors (limit {most})"
        )
        measured.append(SHIFTED_POINT_LABELS.measured(points.z, sentence))
    pixels = _moved_pixels(observations, read_image)
    if pixels is not None:
        better, most = format_against_limit(pixels.z, SHIFTED_LABEL_IMAGES.limit(), 1)
        sentence = (
            f"label images{of(pixels)} fit their images better when {_move_words(*pixels.move)}, "
            f"by {better} standard errors (limit {most})"
        )
        measured.append(SHIFTED_LABEL_IMAGES.measured(pixels.z, sentence))
    if not unread:
        return LabelAlignment(tuple(measured))
    more = f", and {len(unread) - 1} more" if len(unread) > 1 else ""
    note = f"not all label images were checked against their images: {min(unread)}{more}"
    return LabelAlignment(tuple(measured), (note,))


class _Displaced(NamedTuple):
    """The displacement, of those that good labels do not have, at which labels of some frames fit best."""

    move: tuple[float, ...]
    """The displacement: entries towards the end of the file, or pixels right and down and the change of the scale."""
    frames: tuple[int, ...]
    """Indices of the frames whose labels fit better there."""
    z: float
    """Gain of the fit in standard errors: divided by the root of the blocks' summed squares."""
    num_frames: int
    """Number of frames that were looked at."""


def _find_displaced(
    fits: Numbers, moves: npt.NDArray[Any], is_good: npt.NDArray[np.bool_], frames: Sequence[int]
) -> _Displaced:
    """Find the displacement at which labels of all or some frames fit best.

    Args:
        fits: (frames, blocks, displacements) how well labels fit. Even blocks of a frame are one half of it, odd
            ones the other.
        moves: (displacements, k) the displacements.
        is_good: (displacements,) whether good labels may have this displacement.
        frames: (frames,) indices of the frames.
    """
    at_best_good = fits[:, :, is_good][:, :, fits[:, :, is_good].sum(axis=(0, 1)).argmax()]
    halves = np.stack([fits[:, half::2].sum(axis=1) for half in (0, 1)], axis=1)
    halves -= np.stack([at_best_good[:, half::2].sum(axis=1) for half in (0, 1)], axis=1)[:, :, None]
    counts = halves[:, ::-1] > 0.0
    best = int(np.where(is_good, -np.inf, np.where(counts, halves, 0.0).sum(axis=(0, 1))).argmax())
    gains = fits[:, :, best] - at_best_good
    counted = np.concatenate([gains[counts[:, half, best], half::2].ravel() for half in (0, 1)])
    spread = math.sqrt(float(np.square(counted).sum()))
    z = float(counted.sum()) / spread if spread > 0.0 else 0.0
    better = tuple(frames[place] for place in np.flatnonzero(gains.sum(axis=1) > 0.0).tolist())
    return _Displaced(tuple(moves[best].tolist()), better, z, len(frames))


def _moved_points(observations: Observations) -> _Displaced:
    """Find the number of entries by which point labels fit better, towards the end of the file if positive."""
    clouds = [cloud.core for cloud in observations.clouds]
    steps = core.steps_at_label_changes(clouds, reach=MAX_ENTRIES, num_blocks=NUM_BLOCKS)
    entries = np.arange(-MAX_ENTRIES, MAX_ENTRIES + 1)
    return _find_displaced(np.array(steps, np.float64), entries[:, None], entries == 0, range(len(clouds)))


def _moved_pixels(observations: Observations, read_image: Callable[[int], Image | None]) -> _Displaced | None:
    """Find the move at which label images of all or some frames fit their images better; None without images.

    A few images are read, and all of them if these raise a doubt.
    """
    few = spread(observations.num_frames)
    displaced = _look(observations, read_image, few)
    if displaced is None or displaced.z <= MIN_Z_TO_READ_ON or len(few) == observations.num_frames:
        return displaced
    return _look(observations, read_image, range(observations.num_frames))


def spread(num_frames: int) -> list[int]:
    """Spread a few indices over those of all frames, even and odd ones by turns, for every other frame may differ."""
    if num_frames <= NUM_IMAGES:
        return list(range(num_frames))
    evenly = (place * (num_frames - 1) // (NUM_IMAGES - 1) for place in range(NUM_IMAGES))
    return [index - (index + place) % 2 if index else 0 for place, index in enumerate(evenly)]


def _look(
    observations: Observations, read_image: Callable[[int], Image | None], indices: Iterable[int]
) -> _Displaced | None:
    def steps_of(index: int) -> npt.NDArray[np.float32] | None:
        image = read_image(index)
        if image is None:
            return None
        labels = observations.images[index].core
        return core.steps_at_label_borders(image, labels, reach=MAX_SHIFT_PX, tiles=(ROWS, COLUMNS))

    indices = list(indices)
    with thread_pool() as pool:
        steps = dict(zip(indices, pool.map(steps_of, indices), strict=True))
    sums = {
        index: image_steps.reshape(ROWS * COLUMNS, -1)
        for index, image_steps in steps.items()
        if image_steps is not None
    }
    if not sums:
        return None
    moves, is_good, tiles, places = _moves(observations.camera.width, observations.camera.height)
    fits = np.array(list(sums.values()), np.float64)[:, tiles[:, None], places]
    return _find_displaced(fits, moves, is_good, list(sums))


def _moves(
    width: int, height: int
) -> tuple[Numbers, npt.NDArray[np.bool_], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """List the moves that are tried: each pixel by a shift, and by a share of its way from the middle.

    Returns:
        (moves, 3) pixels right and down, and the change of the scale; (moves,) whether label images of a good drive may
        be displaced so; (tiles,) order of the tiles, in which those of the two colours of a chessboard take turns; and
        (tiles, moves) index of the shift of each tile, in this order, in its table of sums.
    """
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    tiles = np.argsort((row + column) % 2, kind="stable").reshape(2, -1).T.ravel()
    shifts = np.arange(-MAX_SHIFT_PX, MAX_SHIFT_PX + 1, dtype=np.float64)
    scale, down_px, right_px = (axis.ravel() for axis in np.meshgrid(SCALES, shifts, shifts, indexing="ij"))
    u = np.outer((column[tiles] + 0.5) / COLUMNS - 0.5, width * scale) + right_px
    v = np.outer((row[tiles] + 0.5) / ROWS - 0.5, height * scale) + down_px
    size_px = np.sqrt(np.mean(u**2 + v**2, axis=0))
    is_good = (scale == 0.0) & (size_px <= MAX_GOOD_PX)
    to_column, to_row = (np.rint(shift).astype(np.int64) + MAX_SHIFT_PX for shift in (u, v))
    is_reached = np.all((np.abs(u) < MAX_SHIFT_PX + 0.5) & (np.abs(v) < MAX_SHIFT_PX + 0.5), axis=0)
    tried = np.flatnonzero(is_reached & (is_good | (size_px >= MIN_BAD_PX)))
    places = to_row * len(shifts) + to_column
    return np.column_stack([right_px, down_px, scale])[tried], is_good[tried], tiles, places[:, tried]


def _entries_words(entries: float) -> str:
    side = "start" if entries < 0 else "end"
    return f"shifted by {counted(abs(int(entries)), 'entry')} towards the {side} of the file"


def _move_words(right_px: float, down_px: float, scale: float) -> str:
    """Describe how label images are to be moved: "shifted by 3 pixels right and 2 down"."""
    words = [f"scaled by {1.0 + scale:g} about the middle"] if scale else []
    sides = [(int(right_px), "right", "left"), (int(down_px), "down", "up")]
    if parts := [f"{abs(px)} {after if px > 0 else before}" for px, after, before in sides if px]:
        count, side = parts[0].split()
        parts[0] = f"{count} {'pixel' if count == '1' else 'pixels'} {side}"
        words.append(f"shifted by {' and '.join(parts)}")
    return " and ".join(words)
