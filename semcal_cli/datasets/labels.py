"""Labels that a network wrote for the frames of a data set."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

from semcal_cli.datasets.files import files_by_stem
from semcal_cli.datasets.recording import Conversion, Recording, SourceFrame
from semcal_cli.errors import InputError

Side: TypeAlias = Literal["point_labels", "image_labels"]

SUFFIXES: dict[Side, tuple[str, ...]] = {
    "image_labels": (".png", ".npy", ".npz"),
    "point_labels": (".label", ".bin", ".npy", ".npz"),
}
CLOUD_SUFFIXES = (".pcd.bin", ".bin", ".pcd", ".ply", ".npy", ".npz", ".las", ".laz")
WITHOUT = {
    "points": "`semcal calibrate` compares segments and edges instead",
    "pictures": "`semcal label` makes them with a network",
}
"""What to do without labels of one side."""
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")


def stem(path: Path) -> str:
    """Remove the suffix from a file's name; `.pcd.bin` counts as one suffix."""
    suffix = next((suffix for suffix in CLOUD_SUFFIXES if path.name.endswith(suffix)), path.suffix)
    return path.name.removesuffix(suffix)


def with_labels(recording: Recording, side: Side, folder: Path) -> Recording:
    """Take the labels of points or of images from a folder, in files named after the frame, its image or its cloud.

    They replace the labels and the classes of the data set.

    Raises:
        InputError: no frame has a file there, or the points of the clouds have no order that a file could follow.
    """
    files = files_by_stem(folder, *SUFFIXES[side])
    frames = [_without_labels(frame, side, folder) for frame in recording.frames]
    frames = [
        replace(frame, **{side: next((files[stem] for stem in _stems(frame) if stem in files), None)})  # type: ignore[arg-type]
        for frame in frames
    ]
    if not any(getattr(frame, side) for frame in frames):
        expected = " or ".join(dict.fromkeys(_stems(recording.frames[0])))
        raise InputError(
            f"{folder}: found {len(files):,} label files, none named as a frame; needed {expected} "
            f"with {', '.join(SUFFIXES[side])}"
        )
    if side == "point_labels":
        return replace(recording, frames=frames, point_classes=None)
    return replace(recording, frames=frames, image_classes=None, ids_in_red=False)


def labelled(recording: Recording) -> Recording:
    """Leave out frames that lack labels which other frames have, and count them in a remark.

    Raises:
        InputError: some frames have labels of points, others have label images, and none has both.
    """
    frames = list(recording.frames)
    num_points = sum(frame.has_point_labels for frame in frames)
    num_images = sum(frame.image_labels is not None for frame in frames)
    remarks = []
    for side, what, option in (
        ("has_point_labels", "points", "--point-labels"),
        ("image_labels", "pictures", "--image-labels"),
    ):
        kept = [frame for frame in frames if getattr(frame, side)]
        if not kept and num_points and num_images:
            raise InputError(
                f"found {num_points:,} frames with labels of points and {num_images:,} with labels of "
                f"pictures, none of {len(recording.frames):,} with both, needed at least one"
            )
        if not kept and recording.labels_by is not None:
            remarks.append(
                f"no labels of {what}: {WITHOUT[what]}; {option} {recording.labels_by} takes those that you have"
            )
        elif kept and len(kept) < len(frames):
            remarks.append(f"{len(frames) - len(kept):,} frames without labels of {what} are left out")
        frames = kept or frames
    return replace(recording, frames=frames, remarks=(*recording.remarks, *remarks))


def _without_labels(frame: SourceFrame, side: Side, folder: Path) -> SourceFrame:
    """Drop the point labels that a conversion would write."""
    if side == "image_labels" or not isinstance(frame.points, Conversion):
        return frame
    if not frame.points.in_order:
        raise InputError(
            f"--point-labels: {folder}: found clouds that are cut from accumulated points, with their labels; "
            "needed sweeps, whose points are in the order of the labels"
        )
    return replace(frame, points=replace(frame.points, has_labels=False))


def _stems(frame: SourceFrame) -> Iterator[str]:
    """List the names, without suffix, that a label file of a frame may have."""
    yield frame.name
    if frame.image is not None:
        yield frame.image.stem
    if frame.cloud_file is not None:
        yield stem(frame.cloud_file)
    yield from frame.label_names
