"""Single frames: their names in sentences, files that they share, and whether points and pixels belong together.

They do not where an image is from another moment or another camera, or is mirrored.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import chain, groupby
from pathlib import PurePosixPath

import numpy as np

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, told_apart
from semcal_cli.estimation.uncertainty.information import (
    information_by_frame,
    information_by_squares,
    pointwise_information,
)
from semcal_cli.files.input_files import hash_file
from semcal_cli.findings.check import ODD_FRAMES, Measured
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.observations.observations import Observations

MAX_NAMED = 6
"""Largest number of frames, or runs of frames, that a list names."""
FILES = {
    "points": "points",
    "point_labels": "point labels",
    "image_labels": "label images",
    "image": "images",
}
"""Keys of a frame's files, with their names in sentences."""
MIN_PAIRS = 500.0
"""Least number of pairs of points and pixels with which a frame is checked."""
NUM_EXCHANGES = 3
"""Number of other frames whose images are tried."""


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


def check_pairs(
    observations: Observations, T_camera_lidar: Pose, agreement: core.Agreement, names: Sequence[str]
) -> tuple[Measured, ...]:
    """Check for each frame that its points agree with its own pixels.

    Labels are judged by the classes that go together in all frames. Segments, edges and intensity carry less
    information and are judged by squares of the images, whose scatter shows how much is chance.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        agreement: Agreement of all frames at this pose.
        names: Name of each frame: its point cloud.
    """
    if observations.is_multimodal:
        found = information_by_squares(observations, T_camera_lidar)
        own, num_pairs = found.by_frame, found.weight_by_frame
        most_exchanged = own + ODD_FRAMES.limit("another image, by squares") * found.sigma_by_frame
    else:
        joints = agreement.frame_joints[: observations.num_frames]
        table = pointwise_information(joints.sum(axis=0))
        own, num_pairs = information_by_frame(joints, table), joints.sum(axis=(1, 2))
        most_exchanged = ODD_FRAMES.limit("another image") * own

    def measure(others: Observations) -> Numbers:
        """Compute the information (F,) with the pixels of other observations."""
        if others.is_multimodal:
            return information_by_squares(others, T_camera_lidar).by_frame
        return information_by_frame(core.agreement(others.core, T_camera_lidar).frame_joints, table)

    is_seen = num_pairs >= MIN_PAIRS
    if not is_seen.any() or observations.num_frames < 2:
        return ()
    usual, least = float(np.quantile(own[is_seen], 0.75)), ODD_FRAMES.limit("information")
    doubtful = np.flatnonzero(is_seen & (own < least * usual))
    wrong = []
    if len(doubtful) > 0:
        is_wrong = (own <= 0.0) | (_exchanged(observations, measure) > most_exchanged)
        wrong = doubtful[is_wrong[doubtful]].tolist()
    if not wrong:
        share = float(own[is_seen].min()) / usual if usual > 0.0 else math.nan
        return (ODD_FRAMES.measured(share, limit="information"),)
    worst = min(wrong, key=lambda frame: float(own[frame]))
    share = float(own[worst]) / usual if usual > 0.0 else -math.inf
    part, needed = told_apart(share, least, unit="%")
    as_well = f"{part} as well as others" if share >= 0.0 else "worse than chance"
    sentence = (
        f"points and pixels of {frame_list(names, wrong)} may not belong together, since {frame_name(names, worst)} "
        f"agrees {as_well}, needed at least {needed}, or better than with images of other frames"
    )
    return (ODD_FRAMES.measured(share, sentence, "information"),)


def _exchanged(observations: Observations, measure: Callable[[Observations], Numbers]) -> Numbers:
    """Compute the largest information of each frame's points with the pixels of some other frames, (F,)."""
    images, count = observations.images, observations.num_frames
    shifts = np.unique(np.linspace(1, count - 1, NUM_EXCHANGES).round().astype(int))
    scenes, found = observations.scenes, []
    for shift in shifts.tolist():
        others = observations.with_images(images[shift:] + images[:shift])
        same = [scenes[frame] == scenes[(frame + shift) % count] for frame in range(count)]
        found.append(np.where(same, -np.inf, measure(others)))
    return np.asarray(np.max(found, axis=0))


def find_identical_files(drive: Drive) -> list[str]:
    """Name the frames whose points, labels or images are identical, in a sentence for each group of frames."""
    kinds: dict[tuple[int, ...], list[str]] = defaultdict(list)
    for key, kind in FILES.items():
        for group in _identical(drive, key):
            kinds[group].append(kind)
    names, sentences = [frame.points for frame in drive.frames], []
    for group, of_group in sorted(kinds.items()):
        *firsts, last = of_group
        same = f"{', '.join(firsts)} and {last}" if firsts else last
        # A frame that is listed several times is named once.
        first, *others = sorted({names[index]: index for index in reversed(group)}.values())
        if others:
            verb = "have" if len(others) > 1 else "has"
            sentence = (
                f"{frame_list(names, others)} {verb} the same {same} as frame {frame_name(names, first)}"
            )
        else:
            sentence = f"frame {frame_name(names, first)} is listed {len(group)} times, with the same {same}"
        sentences.append(sentence)
    return sentences


def _identical(drive: Drive, key: str) -> list[tuple[int, ...]]:
    """Group the indices of frames whose files of one kind are the same bytes. Only files of the same size are read."""
    named = [(index, getattr(frame, key)) for index, frame in enumerate(drive.frames)]
    paths = {index: drive.resolve(name) for index, name in named if name is not None}
    by_size, by_content = defaultdict[int, list[int]](list), defaultdict[str, list[int]](list)
    for index, path in paths.items():
        with suppress(OSError):
            by_size[path.stat().st_size].append(index)
    for index in chain.from_iterable(group for group in by_size.values() if len(group) > 1):
        with suppress(InputError):
            by_content[hash_file(paths[index])].append(index)
    return [tuple(group) for group in by_content.values() if len(group) > 1]
