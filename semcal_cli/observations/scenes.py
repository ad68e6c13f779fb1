"""Frames that show the same scene, as at a red light or in copies of a frame: they add no evidence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from semcal_cli import core

MIN_SAME_RANGE_SHARE = 0.7
"""Smallest share of directions with the same range in two frames that show one scene. It is 0.88 to 0.97 for copies
with 5 mm to 2 cm of noise, and at most 0.24 for frames of six synthetic drives. A car that rolls to a halt passes
through all values: neighbouring frames of a KITTI drive in a traffic jam have 0.48 to 0.84."""
MIN_COPIED = 0.999
"""Smallest share of equal pixels in copies of a label image. Labels of two images of one scene by a network are less
alike."""


def alike_frames(sweeps: Sequence[core.NearestRanges]) -> list[int]:
    """Group the frames that show the same scene, by the nearest ranges of the sweep of each.

    Returns:
        For each frame the index of the first frame that shows the same scene, directly or through others.
    """
    first = list(range(len(sweeps)))
    if len(sweeps) < 2:
        return first
    for later, earlier in np.argwhere(
        np.tril(core.shares_alike(sweeps) >= MIN_SAME_RANGE_SHARE, -1)
    ).tolist():
        later_scene, earlier_scene = sorted((first[earlier], first[later]), reverse=True)
        first = [earlier_scene if scene == later_scene else scene for scene in first]
    return first


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
