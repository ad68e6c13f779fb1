"""Which frames of a recording become frames of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from semcal_cli.datasets.recording import Recording, SourceFrame
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frame_selection import evenly_spaced, select_frames
from semcal_cli.errors import InputError

SPREAD_FRAMES = 20
"""Frames that `spread` chooses if no other number is given."""


@dataclass(frozen=True)
class Choice:
    """Which frames to keep."""

    frames: slice = field(default_factory=lambda: slice(None))
    """Of those that there are, in order of time."""
    max_frames: int | None = None
    """At most so many: evenly spaced, or as `spread` says."""
    spread: bool = False
    """Keep the slower half of the frames, and of these the ones whose label images differ most."""
    max_gap_s: float | None = None
    """Leave out pairs whose stamps are farther apart."""


def narrowed(recording: Recording, choice: Choice) -> Recording:
    """Leave out pairs too far apart in time, then keep the frames that were asked for.

    Raises:
        InputError: none are left.
    """
    near = [frame for frame in recording.frames if _gap_s(frame) <= (choice.max_gap_s or np.inf)]
    remarks = list(recording.remarks)
    left_out = len(recording.frames) - len(near)
    if left_out:
        remarks.append(f"{left_out:,} pairs more than {choice.max_gap_s} s apart are left out")
    if not near:
        raise InputError(
            f"--max-gap-s: found {left_out:,} pairs, none within {choice.max_gap_s} s, needed at least one"
        )
    frames = near[choice.frames]
    if not frames:
        raise InputError(
            f"--frames: found {len(near):,} frames, none of those asked for, needed at least one"
        )
    if choice.spread:
        frames = slowest(frames, choice.max_frames or SPREAD_FRAMES)
    elif choice.max_frames:
        frames = evenly_spaced(frames, choice.max_frames)
    return replace(recording, frames=frames, remarks=tuple(remarks))


def most_varied(drive: Drive, recording: Recording, choice: Choice) -> Sequence[int]:
    """Indices of the frames whose label images differ most; all if `spread` was not asked for.

    Args:
        drive: The drive that all frames would make; its folder need not be there yet.
        recording: Its frames, where they lie.
        choice: How many.

    Raises:
        InputError: a frame has no label image, or one is wrong.
    """
    sources = recording.frames
    if not choice.spread:
        return range(len(sources))
    frames = [
        frame.model_copy(update={"image_labels": str(source.image_labels.absolute())})
        for frame, source in zip(drive.frames, sources, strict=True)
        if source.image_labels
    ]
    if len(frames) < len(sources):
        needed = f"--image-labels {recording.labels_by}"
        raise InputError(f"--spread: found frames without label images, needed {needed}")
    chosen = select_frames(
        drive.model_copy(update={"frames": tuple(frames)}), choice.max_frames or SPREAD_FRAMES
    )
    kept = set(map(id, chosen.frames))
    return [index for index, frame in enumerate(frames) if id(frame) in kept]


def slowest(frames: Sequence[SourceFrame], count: int) -> list[SourceFrame]:
    """Keep the slower half of the frames, but at least `count`; all where a speed is not known."""
    speeds = [frame.speed_mps for frame in frames]
    if any(speed is None for speed in speeds):
        return list(frames)
    order = np.argsort(np.array(speeds, dtype=float), kind="stable")
    return [frames[index] for index in sorted(order[: max(count, (len(frames) + 1) // 2)])]


def _gap_s(frame: SourceFrame) -> float:
    if frame.points_stamp is None or frame.image_stamp is None:
        return 0.0
    return abs(frame.points_stamp - frame.image_stamp)
