"""Choice of frames from a long drive: those whose label images differ most, or evenly spaced ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import colors, label_paths

Item = TypeVar("Item")


THUMBNAIL = 64, 36
"""Columns and rows of the thumbnails by which label images are compared."""


def evenly_spaced(items: Sequence[Item], count: int) -> list[Item]:
    """Keep at most `count` evenly spaced items, from the first to the last."""
    indices = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[index] for index in indices]


def few_frames(observations: Observations, count: int) -> Observations:
    """Keep at most `count` evenly spaced frames, of every cue."""
    num_frames = observations.num_frames // observations.num_cues
    kept = evenly_spaced(range(num_frames), count)
    return observations.of_frames(
        cue * num_frames + frame for cue in range(observations.num_cues) for frame in kept
    )


def select_frames(drive: Drive, max_frames: int) -> Drive:
    """Keep at most `max_frames` frames of a drive, those whose label images differ most, in their order.

    Label images are read one after the other and compared as thumbnails, by the share of pixels that differ. The first
    frame is chosen, then repeatedly the frame that is farthest from all chosen ones (Gonzalez, *Clustering to minimize
    the maximum intercluster distance*, 1985).

    Raises:
        InputError: a label image is missing or wrong.
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
    """Choose `count` rows of (N, M) that differ from one another in many columns; ties go to the lower index.

    Returns:
        Indices of the rows, in ascending order.
    """
    chosen = [0]
    nearest = np.count_nonzero(rows != rows[0], axis=1)
    for _ in range(1, count):
        nearest[chosen] = -1
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.count_nonzero(rows != rows[chosen[-1]], axis=1))
    return sorted(chosen)
