"""Names of frames in sentences, however many frames there are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from pathlib import PurePosixPath

MAX_PARTS = 6
"""Largest number of frames, or of stretches of frames, that a list names."""


def frame_name(names: Sequence[str], index: int) -> str:
    """Name a frame by its point cloud without folder and suffix, if that tells it from all others."""
    return frame_names(names)[index]


def frame_names(names: Sequence[str]) -> list[str]:
    """Name all frames by their point clouds, without folder and suffix where that tells them apart."""
    stems = [PurePosixPath(name).stem for name in names]
    counts = Counter(stems)
    return [stem if counts[stem] == 1 else name for stem, name in zip(stems, names, strict=True)]


def frame_list(names: Sequence[str], indices: Sequence[int]) -> str:
    """List some frames, stretches of consecutive ones by the first and the last: "frames 000002 to 000005 and 000009".

    Args:
        names: Point cloud of each frame of the drive.
        indices: Indices of the frames to list, in ascending order.
    """
    stretches = [
        [index for _, index in group]
        for _, group in groupby(enumerate(indices), lambda placed: placed[1] - placed[0])
    ]
    parts = [part for stretch in stretches for part in _parts(names, stretch)]
    word = "frames" if len(indices) > 1 else "frame"
    if len(parts) == 1:
        return f"{word} {parts[0][0]}"
    shown = parts if len(parts) <= MAX_PARTS else parts[: MAX_PARTS - 1]
    num_others = len(indices) - sum(count for _, count in shown)
    *firsts, last = [part for part, _ in shown] + ([f"{num_others} others"] if num_others else [])
    return f"{word} {', '.join(firsts)} and {last}"


def _parts(names: Sequence[str], stretch: Sequence[int]) -> list[tuple[str, int]]:
    """Name consecutive frames in one part, or each in one of its own if there are two, with the number of frames."""
    if len(stretch) > 2:
        return [(f"{frame_name(names, stretch[0])} to {frame_name(names, stretch[-1])}", len(stretch))]
    return [(frame_name(names, index), 1) for index in stretch]
