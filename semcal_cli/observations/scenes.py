"""Frames that show the same scene, as at a red light or in copies of a frame: they add no evidence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from semcal_cli.threads import thread_pool

CELL_DEG = 2.0
"""Size of the cells of directions whose nearest points are compared, in degrees."""
MAX_POINTS = 30_000
"""Largest number of points of a cloud that are used."""
SAME_RANGE_M, SAME_RANGE = 0.05, 0.01
"""Largest difference of two ranges that count as the same: metres, plus a share of the range."""
MIN_SAME_RANGE_SHARE = 0.7
"""Smallest share of directions with the same range in two frames that show one scene. It is 0.88 to 0.97 for copies
with 5 mm to 2 cm of noise, and at most 0.24 for frames of six synthetic drives. A car that rolls to a halt passes
through all values: neighbouring frames of a KITTI drive in a traffic jam have 0.48 to 0.84."""
MIN_COPIED = 0.999
"""Smallest share of equal pixels in copies of a label image. Labels of two images of one scene by a network are less
alike."""


def ranges_of(clouds: Sequence[npt.NDArray[np.float32]]) -> list[npt.NDArray[np.float32]]:
    """Compute the `nearest_ranges` of the points (N, 3) of each frame, metres, LiDAR frame."""
    with thread_pool() as pool:
        return list(pool.map(nearest_ranges, clouds))


def alike_frames(ranges: Sequence[npt.NDArray[np.float32]]) -> list[int]:
    """Group the frames that show the same scene, by the `nearest_ranges` of each.

    Returns:
        For each frame the index of the first frame that shows the same scene, directly or through others.
    """
    first = list(range(len(ranges)))
    if len(ranges) < 2:
        return first
    for later, earlier in np.argwhere(np.tril(_shares(ranges) >= MIN_SAME_RANGE_SHARE, -1)).tolist():
        later_scene, earlier_scene = sorted((first[earlier], first[later]), reverse=True)
        first = [earlier_scene if scene == later_scene else scene for scene in first]
    return first


def shares_alike(clouds: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float64]:
    """Compute the share (F, F) of directions seen in either of two sweeps (N, 3) that have the same range in both."""
    return _shares(ranges_of(clouds))


def _shares(nearest: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float64]:
    ranges, shares = np.array(nearest), np.zeros((len(nearest), len(nearest)))
    # Most directions have no points in any frame: a LiDAR looks neither up nor down.
    ranges = ranges[:, np.isfinite(ranges).any(axis=0)]
    with thread_pool() as pool:
        rows = pool.map(lambda frame: share_alike(ranges[: frame + 1], ranges[frame]), range(len(ranges)))
        for frame, row in enumerate(rows):
            shares[frame, : frame + 1] = shares[: frame + 1, frame] = row
    return shares


def share_alike(others: npt.NDArray[np.float32], own: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """Compute the share (F,) of the directions seen in a frame or another one that have the same range in both.

    Args:
        others: (F, C) `nearest_ranges` of other frames.
        own: (C,) that of the frame.
    """
    nearer = np.minimum(others, own)
    # The difference of two infinite ranges is NaN, which compares false.
    with np.errstate(invalid="ignore"):
        is_same = np.abs(others - own) < SAME_RANGE_M + SAME_RANGE * nearer
    num_finite = np.count_nonzero(np.isfinite(nearer), axis=1)
    return np.asarray(np.count_nonzero(is_same, axis=1) / np.maximum(num_finite, 1))


def copied_frames(scenes: Sequence[int], images: Sequence[npt.NDArray[np.uint8]]) -> list[int]:
    """Find the frames that are copies of an earlier one: the same scene with the same image labels.

    Args:
        scenes: Result of `alike_frames`.
        images: (H, W) classes of the pixels of each frame.
    """
    copies: list[int] = []
    kept: dict[int, list[int]] = {}
    for frame, scene in enumerate(scenes):
        earlier = kept.setdefault(scene, [])
        if any(float(np.mean(images[frame] == images[other])) >= MIN_COPIED for other in earlier):
            copies.append(frame)
        else:
            earlier.append(frame)
    return copies


def nearest_ranges(points: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Compute the range (C,) of the nearest point (N, 3) in each cell of directions, metres; infinite without one."""
    x, y, z = np.ascontiguousarray(points[:: max(len(points) // MAX_POINTS, 1)].T)
    flat = np.hypot(x, y)
    columns, rows = round(360.0 / CELL_DEG), round(180.0 / CELL_DEG)
    column = np.floor(np.arctan2(y, x) * (columns / (2.0 * np.pi))).astype(np.int32) % columns
    row = np.clip((np.arctan2(z, flat) / np.pi + 0.5) * rows, 0, rows - 1).astype(np.int32)
    nearest = np.full(rows * columns, np.inf, np.float32)
    np.minimum.at(nearest, row * columns + column, np.hypot(flat, z))
    return nearest
