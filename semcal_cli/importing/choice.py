"""The user's choice of the frames and labels of a recording that become a drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from semcal_cli.config.data_suffixes import IMAGE_LABEL_SUFFIXES, POINT_LABEL_SUFFIXES
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, counted
from semcal_cli.importing.dataset_tree import files_by_stem
from semcal_cli.importing.file_pairing import stem
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.importing.recording import Conversion, Recording, SourceFrame
from semcal_cli.observations.frame_selection import evenly_spaced, select_frames

SPREAD_FRAMES = 20
"""Number of frames that `spread` chooses by default."""
SUBSTITUTES = {
    "point labels": "edges are compared instead",
    "image labels": "a network can make them",
}
"""What replaces the labels of one side."""


@dataclass(frozen=True)
class FrameChoice:
    """The user's choice of frames, and additions to a data set."""

    frames: slice = field(default_factory=lambda: slice(None))
    """Slice of all frames in order of time."""
    max_frames: int | None = None
    """Largest number of frames: evenly spaced ones, or those that `spread` chooses."""
    spread: bool = False
    """Whether to keep, of the slower half of the frames, those whose label images differ most."""
    max_gap_s: float | None = None
    """Largest time between the two stamps of a pair, in seconds."""
    image_labels: Path | None = None
    """Folder of label images."""
    point_labels: Path | None = None
    """Folder of point labels."""
    image_classes: str | None = None
    """Name or file of the class table of the label images; None for the data set's own."""
    point_classes: str | None = None
    """Name or file of the class table of the points; None for the data set's own."""
    odometry: bool = False
    """Whether the motion is estimated from the sweeps of all frames, also of those not chosen, if none is stated."""
    keeps_all: bool = False
    """Whether frames without labels are kept beside those with labels."""


def relabel(recording: Recording, options: FrameChoice) -> Recording:
    """Replace the labels and classes of the data set with those that the user gives.

    Raises:
        InputError: a folder has no labels of any frame, or a class table is wrong or does not fit.
    """
    if options.image_labels:
        frames = _with_labels(recording.frames, "image_labels", options.image_labels)
        recording = replace(recording, frames=frames, image_classes=None, ids_in_red=False)
    if options.point_labels:
        frames = [_without_own_labels(frame, options.point_labels) for frame in recording.frames]
        frames = _with_labels(frames, "point_labels", options.point_labels)
        recording = replace(recording, frames=frames, point_classes=None)
    if options.image_classes is not None:
        recording = replace(recording, image_classes=read_ontology(options.image_classes))
    if options.point_classes is not None:
        recording = replace(recording, point_classes=read_ontology(options.point_classes))
    if recording.image_classes and recording.ids_in_red:
        try:
            return replace(recording, image_classes=recording.image_classes.in_red())
        except InputError as error:
            raise InputError(f"--image-classes: {options.image_classes}: {error}") from None
    return recording


def _with_labels(
    frames: Sequence[SourceFrame], side: Literal["point_labels", "image_labels"], folder: Path
) -> list[SourceFrame]:
    """Take labels of one side from a folder of files named after the frame, its image or its cloud."""
    suffixes = POINT_LABEL_SUFFIXES if side == "point_labels" else IMAGE_LABEL_SUFFIXES
    files = files_by_stem(folder, *suffixes)
    label_files = [
        next((files[name] for name in _label_names(frame) if name in files), None) for frame in frames
    ]
    if not any(label_files):
        raise InputError(
            f"{folder}: found {len(files):,} label files, none named after a frame; expected "
            f"{' or '.join(dict.fromkeys(_label_names(frames[0])))} with {', '.join(suffixes)}"
        )
    used = list(filter(None, label_files))
    if len(set(used)) < len(used):
        file = next(file for index, file in enumerate(used) if file in used[:index])
        raise InputError(f"{file}: found several frames of this name, expected a label file for each")
    if side == "point_labels":
        return [replace(frame, point_labels=file) for frame, file in zip(frames, label_files, strict=True)]
    return [replace(frame, image_labels=file) for frame, file in zip(frames, label_files, strict=True)]


def _label_names(frame: SourceFrame) -> list[str]:
    """List the names, without suffix, that a label file of a frame may have."""
    image = [] if frame.image is None else [frame.image.stem]
    cloud = [] if frame.cloud_file is None else [stem(frame.cloud_file)]
    return [frame.name, *image, *cloud, *frame.label_names]


def _without_own_labels(frame: SourceFrame, folder: Path) -> SourceFrame:
    """Drop the point labels that a conversion would write."""
    if not isinstance(frame.points, Conversion):
        return frame
    if not frame.points.in_order:
        raise InputError(
            f"--point-labels: {folder}: found clouds that are cut from accumulated points together with their labels; "
            "expected sweeps, whose points are in the order of the labels"
        )
    return replace(frame, points=replace(frame.points, has_labels=False))


def keep_labelled(recording: Recording) -> Recording:
    """Leave out frames that lack labels which other frames have, and count them in a remark.

    Raises:
        InputError: some frames have point labels, others have label images, and none has both.
    """
    frames = list(recording.frames)
    num_points = sum(frame.has_point_labels for frame in frames)
    num_images = sum(frame.image_labels is not None for frame in frames)
    remarks = []
    for side, labels, option in (
        ("has_point_labels", "point labels", "--point-labels"),
        ("image_labels", "image labels", "--image-labels"),
    ):
        frames_with_labels = [frame for frame in frames if getattr(frame, side)]
        if not frames_with_labels and num_points and num_images:
            raise InputError(
                f"found {counted(num_points, 'frame')} with point labels and {num_images:,} with image "
                f"labels, none of {len(recording.frames):,} with both, needed at least one"
            )
        if not frames_with_labels and recording.labels_by is not None:
            remarks.append(
                f"no {labels}: {SUBSTITUTES[labels]}; add your own with {option} {recording.labels_by}"
            )
        elif frames_with_labels and len(frames_with_labels) < len(frames):
            remarks.append(
                f"left out {counted(len(frames) - len(frames_with_labels), 'frame')} without {labels}"
            )
        frames = frames_with_labels or frames
    return replace(recording, frames=frames, remarks=(*recording.remarks, *remarks))


def narrow(recording: Recording, options: FrameChoice) -> Recording:
    """Leave out pairs that are too far apart in time, then keep the chosen frames.

    Raises:
        InputError: no frame is left.
    """
    synchronous = [frame for frame in recording.frames if frame.gap_s <= (options.max_gap_s or np.inf)]
    remarks = list(recording.remarks)
    if left_out := len(recording.frames) - len(synchronous):
        remarks.append(f"left out {counted(left_out, 'pair')} more than {options.max_gap_s} s apart")
    if not synchronous:
        raise InputError(
            f"--max-gap-s: found {counted(left_out, 'pair')}, none within {options.max_gap_s} s, needed at least one"
        )
    frames = synchronous[options.frames]
    if not frames:
        raise InputError(
            f"--frames: found {counted(len(synchronous), 'frame')}, none in this slice, needed at least one"
        )
    if options.spread:
        frames = _slowest(frames, options.max_frames or SPREAD_FRAMES)
    elif options.max_frames:
        frames = evenly_spaced(frames, options.max_frames)
    return replace(recording, frames=frames, remarks=tuple(remarks))


def _slowest(frames: Sequence[SourceFrame], count: int) -> list[SourceFrame]:
    """Keep the slower half of the frames and at least `count`; keep all frames if a speed is unknown."""
    speeds = [frame.speed_mps for frame in frames]
    if None in speeds:
        return list(frames)
    order = np.argsort(np.array(speeds, dtype=float), kind="stable")
    return [frames[index] for index in sorted(order[: max(count, (len(frames) + 1) // 2)])]


def select_varied(drive: Drive, recording: Recording, options: FrameChoice) -> list[SourceFrame]:
    """Keep the frames whose label images differ most; keep all frames without `spread`.

    Args:
        drive: The drive that all frames would make; its folder need not exist yet.
        recording: The frames with the paths of their files.
        options: How many frames to keep.

    Raises:
        InputError: a frame has no label image, or a label image cannot be read.
    """
    sources = list(recording.frames)
    if not options.spread:
        return sources
    if not all(source.image_labels for source in sources):
        labels = f"--image-labels {recording.labels_by}"
        raise InputError(f"--spread: found frames without label images; add {labels}")
    frames = tuple(
        frame.model_copy(update={"image_labels": str(Path(str(source.image_labels)).absolute())})
        for frame, source in zip(drive.frames, sources, strict=True)
    )
    chosen = select_frames(drive.model_copy(update={"frames": frames}), options.max_frames or SPREAD_FRAMES)
    chosen_ids = set(map(id, chosen.frames))
    return [source for source, frame in zip(sources, frames, strict=True) if id(frame) in chosen_ids]
