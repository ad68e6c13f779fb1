"""Choice of frames from a long drive: those whose label images differ most, or evenly spaced ones."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, counted, one_of
from semcal_cli.observations.frame_naming import frame_names
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import read_thumbnails

Item = TypeVar("Item")


THUMBNAIL = 64, 36
"""Columns and rows of the thumbnails by which label images are compared."""


def evenly_spaced(items: Sequence[Item], count: int) -> list[Item]:
    """Keep at most `count` evenly spaced items, from the first to the last."""
    indices = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[index] for index in indices]


def with_frames(drive: Drive, indices: Iterable[int]) -> Drive:
    """Copy a drive with some of its frames, by their indices."""
    return drive.model_copy(update={"frames": tuple(drive.frames[index] for index in indices)})


def chosen_frames(drive: Drive, part: slice | None, excluded: Collection[str]) -> Drive:
    """Copy a drive with a part of its frames, without some that are excluded by name.

    Args:
        drive: The drive.
        part: Indices of the frames; None for all.
        excluded: Names of frames: their point clouds, also without folder and suffix where that is unique. All frames
            with such a cloud are left out.

    Raises:
        InputError: there is no frame of an excluded name, or no frame is left.
    """
    clouds = [frame.points for frame in drive.frames]
    short = frame_names(clouds)
    known, left_out = {*clouds, *short}, set(excluded)
    for name in excluded:
        if name not in known:
            names = one_of(name, dict.fromkeys(short))
            raise InputError(f"{drive.path}: --exclude: found no frame {name!r}, expected {names}")
    # Several frames may have one cloud, such as those of several images of a sweep.
    kept = [
        index
        for index in range(len(clouds))[part or slice(None)]
        if left_out.isdisjoint((clouds[index], short[index]))
    ]
    if not kept:
        options = " and ".join(["--frames"] * (part is not None) + ["--exclude"] * bool(excluded))
        raise InputError(
            f"{drive.path}: {options}: found no frame that is left of {counted(len(clouds), 'frame')}"
        )
    return with_frames(drive, kept)


def with_few_frames(drive: Drive, count: int) -> Drive:
    """Copy a drive with at most `count` evenly spaced frames."""
    return with_frames(drive, evenly_spaced(range(len(drive.frames)), count))


def few_frames(observations: Observations, count: int) -> Observations:
    """Keep at most `count` evenly spaced frames."""
    if observations.num_frames <= count:
        return observations
    return observations.of_frames(evenly_spaced(range(observations.num_frames), count))


def select_frames(drive: Drive, max_frames: int) -> Drive:
    """Keep at most `max_frames` frames of a drive, those whose label images differ most, in their order.

    Label images are read one by one and compared as thumbnails, by the share of pixels that differ. The first
    frame is chosen, then repeatedly the frame that is farthest from all chosen ones (Gonzalez, *Clustering to minimize
    the maximum intercluster distance*, 1985).

    Raises:
        InputError: a label image is missing or wrong.
    """
    if len(drive.frames) <= max_frames:
        return drive
    thumbnails = read_thumbnails(drive, *THUMBNAIL)
    chosen = farthest_points(thumbnails.reshape(len(thumbnails), -1), max_frames, num_different)
    return with_frames(drive, chosen)


def farthest_points(
    rows: npt.NDArray[Any],
    count: int,
    distances: Callable[[npt.NDArray[Any], npt.NDArray[Any]], npt.NDArray[Any]],
) -> list[int]:
    """Choose `count` rows of (N, M) that are far from one another; ties go to the lower index.

    Args:
        rows: The rows, at least `count`.
        count: How many to choose.
        distances: Function of all rows and one of them that returns the distances (N,) between them.

    Returns:
        Indices of the rows, in ascending order.
    """
    chosen = [0]
    nearest = distances(rows, rows[0])
    for _ in range(1, count):
        nearest[chosen] = -1
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, distances(rows, rows[chosen[-1]]))
    return sorted(chosen)


def num_different(rows: npt.NDArray[Any], row: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
    """Count the columns (N,) in which rows (N, M) differ from one row (M,)."""
    counts: npt.NDArray[np.intp] = np.count_nonzero(rows != row, axis=1)
    return counts
