"""Choice of the frames of a recording that become frames of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from semcal_cli.datasets.recording import Recording, SourceFrame
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frame_selection import evenly_spaced, select_frames
from semcal_cli.errors import InputError

SPREAD_FRAMES = 20
"""Number of frames that `spread` chooses by default."""


@dataclass(frozen=True)
class Choice:
    """Frames to keep."""

    frames: slice = field(default_factory=lambda: slice(None))
    """Slice of all frames in order of time."""
    max_frames: int | None = None
    """Largest number of frames: evenly spaced ones, or those that `spread` chooses."""
    spread: bool = False
    """Whether to keep the slower half of the frames, and of these the ones whose label images differ most."""
    max_gap_s: float | None = None
    """Largest time between the two stamps of a pair, in seconds."""


def narrowed(recording: Recording, choice: Choice) -> Recording:
    """Leave out pairs that are too far apart in time, then keep the chosen frames.

    Raises:
        InputError: no frame is left.
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
    """Find the frames whose label images differ most.

    Args:
        drive: The drive that all frames would make; its folder need not exist yet.
        recording: The frames with the paths of their files.
        choice: How many frames to keep; without `spread` all are kept.

    Returns:
        Indices of the frames, in ascending order.

    Raises:
        InputError: a frame has no label image, or a label image cannot be read.
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
    """Keep the slower half of the frames and at least `count`; keep all frames if a speed is unknown."""
    speeds = [frame.speed_mps for frame in frames]
    if any(speed is None for speed in speeds):
        return list(frames)
    order = np.argsort(np.array(speeds, dtype=float), kind="stable")
    return [frames[index] for index in sorted(order[: max(count, (len(frames) + 1) // 2)])]


def _gap_s(frame: SourceFrame) -> float:
    if frame.points_stamp is None or frame.image_stamp is None:
        return 0.0
    return abs(frame.points_stamp - frame.image_stamp)
