"""Frames that show the same scene, as at a red light or in copies of one frame: they are no new evidence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

CELL_DEG = 2.0
"""Side of a cell of directions whose nearest point is compared, in degrees."""
MAX_POINTS = 30_000
"""Largest number of points of a cloud that are looked at."""
SAME_RANGE_M, SAME_RANGE = 0.05, 0.01
"""Difference of two ranges that are the same: metres, and a share of the range."""
MIN_ALIKE = 0.7
"""Least share of directions with the same range in two frames that show one scene. Copies with 5 mm to 2 cm of noise
have 0.88 to 0.97, and frames of six synthetic drives at most 0.24. A car that rolls to a halt goes through all values:
on a drive of KITTI in a traffic jam, neighbouring frames have 0.48 to 0.84."""
MIN_COPIED = 0.999
"""Least share of equal pixels in copies of a label image. A network labels two pictures of one scene less alike."""


def alike_frames(clouds: Sequence[npt.NDArray[np.float32]]) -> list[int]:
    """Group the frames that show one scene.

    Args:
        clouds: (N, 3) points of each frame, metres, LiDAR frame.

    Returns:
        For each frame the index of the first frame that shows the same scene, directly or by way of others.
    """
    ranges = [_nearest_ranges(points) for points in clouds]
    first = list(range(len(clouds)))
    for later in range(len(clouds)):
        for earlier in range(later):
            if first[earlier] != first[later] and _share_alike(ranges[earlier], ranges[later]) >= MIN_ALIKE:
                joined, kept = sorted((first[earlier], first[later]), reverse=True)
                first = [kept if each == joined else each for each in first]
    return first


def shares_alike(clouds: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float64]:
    """Share of directions with the same range in two frames, (F, F).

    Args:
        clouds: (N, 3) points of each frame, metres, LiDAR frame.
    """
    ranges = [_nearest_ranges(points) for points in clouds]
    return np.array([[_share_alike(a, b) for b in ranges] for a in ranges])


def copied_frames(scenes: Sequence[int], images: Sequence[npt.NDArray[np.uint8]]) -> list[int]:
    """Find the frames that are copies of an earlier one: the same scene, with the same labels of pixels.

    Args:
        scenes: Result of `alike_frames`.
        images: (H, W) classes of the pixels of each frame.
    """
    copies: list[int] = []
    kept: dict[int, list[int]] = {}
    for frame, scene in enumerate(scenes):
        earlier = kept.setdefault(scene, [])
        if any(float(np.mean(images[frame] == images[each])) >= MIN_COPIED for each in earlier):
            copies.append(frame)
        else:
            earlier.append(frame)
    return copies


def _nearest_ranges(points: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Range of the nearest point in each cell of directions, metres; infinite where there is none."""
    x, y, z = points[:: max(len(points) // MAX_POINTS, 1)].T
    flat = np.hypot(x, y)
    columns, rows = round(360.0 / CELL_DEG), round(180.0 / CELL_DEG)
    column = np.floor(np.arctan2(y, x) * (columns / (2.0 * np.pi))).astype(np.int64) % columns
    row = np.clip((np.arctan2(z, flat) / np.pi + 0.5) * rows, 0, rows - 1).astype(np.int64)
    nearest = np.full(rows * columns, np.inf, np.float32)
    np.minimum.at(nearest, row * columns + column, np.hypot(flat, z))
    return nearest


def _share_alike(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32]) -> float:
    """Share of the directions seen in either frame that have the same range in both."""
    nearer = np.minimum(a, b)
    with np.errstate(
        invalid="ignore"
    ):  # The difference of two infinite ranges is no number, and below nothing.
        is_same = np.abs(a - b) < SAME_RANGE_M + SAME_RANGE * nearer
    return int(is_same.sum()) / max(int(np.isfinite(nearer).sum()), 1)
