"""Choice of frames: of a long drive, those that differ most in what they show, or evenly spaced ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.reading import colors, label_paths

Item = TypeVar("Item")


THUMBNAIL = 64, 36
"""Columns and rows of the label images as they are compared."""


def evenly_spaced(items: Sequence[Item], count: int) -> list[Item]:
    """Keep at most `count` items, the first among them, and the last if there may be two."""
    indices = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[index] for index in indices]


def select_frames(drive: Drive, max_frames: int) -> Drive:
    """Keep the frames of a drive whose label images differ most, in their order, if there are more than `max_frames`.

    Label images are read once, one after the other, and compared as thumbnails by the share of pixels that differ. The
    first frame is chosen, then again and again the one that is farthest from all that were (Gonzalez, *Clustering to
    minimize the maximum intercluster distance*, 1985).

    Raises:
        InputError: a label image is missing or is not what its name or the drive says.
    """
    if len(drive.frames) <= max_frames:
        return drive
    camera = drive.camera
    thumbnails = _core.read_label_thumbnails(
        label_paths(drive, "image_labels"), camera.width, camera.height, *THUMBNAIL, colors(drive)
    )
    chosen = farthest_points(thumbnails.reshape(len(thumbnails), -1), max_frames)
    return drive.model_copy(update={"frames": tuple(drive.frames[i] for i in chosen)})


def farthest_points(rows: npt.NDArray[np.uint16], count: int) -> list[int]:
    """Choose rows (N, M) that differ in many places from one another; ties go to the lower index.

    Returns:
        Indices of `count` rows, in ascending order.
    """
    chosen = [0]
    nearest = np.count_nonzero(rows != rows[0], axis=1)
    for _ in range(1, count):
        nearest[chosen] = -1
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.count_nonzero(rows != rows[chosen[-1]], axis=1))
    return sorted(chosen)
