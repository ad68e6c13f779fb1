"""Names of frames in sentences: their point clouds, without folder and suffix where that is unique."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from pathlib import PurePosixPath

MAX_NAMED = 6
"""Largest number of frames, or runs of frames, that a list names."""


def frame_names(names: Sequence[str]) -> list[str]:
    """Name all frames by their point clouds, without folder and suffix where that is unique."""
    stems = [PurePosixPath(name).stem for name in names]
    counts = Counter(stems)
    return [stem if counts[stem] == 1 else name for stem, name in zip(stems, names, strict=True)]


def frame_name(names: Sequence[str], index: int) -> str:
    """Name a frame by its point cloud without folder and suffix, if that is unique."""
    return frame_names(names)[index]


def frame_list(names: Sequence[str], indices: Sequence[int]) -> str:
    """List some frames, with runs of consecutive ones by the first and the last: "frames 000002 to 000005 and 000009".

    Args:
        names: Point cloud of each frame of the drive.
        indices: Indices of the frames to list, in ascending order.
    """
    short, parts = frame_names(names), list[tuple[str, int]]()
    for _, group in groupby(enumerate(indices), lambda placed: placed[1] - placed[0]):
        stretch = [short[index] for _, index in group]
        is_long = len(stretch) > 2
        parts += (
            [(f"{stretch[0]} to {stretch[-1]}", len(stretch))] if is_long else [(name, 1) for name in stretch]
        )
    word = "frames" if len(indices) > 1 else "frame"
    if len(parts) == 1:
        return f"{word} {parts[0][0]}"
    shown = parts if len(parts) <= MAX_NAMED else parts[: MAX_NAMED - 1]
    num_others = len(indices) - sum(count for _, count in shown)
    *firsts, last = [part for part, _ in shown] + ([f"{num_others} others"] if num_others else [])
    return f"{word} {', '.join(firsts)} and {last}"
