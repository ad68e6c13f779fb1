"""Labels that a network wrote, beside the frames of a data set."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

from semcal_cli.datasets.files import files_by_stem
from semcal_cli.datasets.recording import Recording, SourceFrame
from semcal_cli.errors import InputError

Side: TypeAlias = Literal["point_labels", "image_labels"]

SUFFIXES: dict[Side, tuple[str, ...]] = {
    "image_labels": (".png", ".npy", ".npz"),
    "point_labels": (".label", ".bin", ".npy", ".npz"),
}
CLOUD_SUFFIXES = (".pcd.bin", ".bin", ".pcd", ".ply", ".npy", ".npz", ".las", ".laz")


def with_labels(recording: Recording, side: Side, folder: Path) -> Recording:
    """Take the labels of one side from a folder: files named as the frame, its picture or its cloud.

    The classes are then whatever the network writes: the data set's are forgotten.

    Raises:
        InputError: no frame has a file there.
    """
    files = files_by_stem(folder, *SUFFIXES[side])
    frames = [
        replace(frame, **{side: next((files[stem] for stem in _stems(frame) if stem in files), None)})  # type: ignore[arg-type]
        for frame in recording.frames
    ]
    if not any(getattr(frame, side) for frame in frames):
        expected = " or ".join(dict.fromkeys(_stems(recording.frames[0])))
        raise InputError(
            f"{folder}: found {len(files):,} label files, none named as a frame; needed {expected} "
            f"with {', '.join(SUFFIXES[side])}"
        )
    classes: Literal["point_classes", "image_classes"] = (
        "point_classes" if side == "point_labels" else "image_classes"
    )
    return replace(recording, frames=frames, **{classes: None})  # type: ignore[arg-type]


def labelled(recording: Recording) -> Recording:
    """Leave out frames that lack the labels that others have, and say how many."""
    remarks = []
    frames = list(recording.frames)
    for side, what, option in (
        ("point_labels", "points", "--point-labels DIR"),
        ("image_labels", "pictures", "--image-labels DIR"),
    ):
        kept = [
            frame for frame in frames if getattr(frame, side) or (side == "point_labels" and converted(frame))
        ]
        if not kept:
            remarks.append(f"no labels of {what}: a calibration needs them, see {option}")
        elif len(kept) < len(frames):
            remarks.append(f"{len(frames) - len(kept):,} frames without labels of {what} are left out")
        frames = kept or frames
    return replace(recording, frames=frames, remarks=(*recording.remarks, *remarks))


def converted(frame: SourceFrame) -> bool:
    """Whether the cloud, with its labels, is written anew."""
    return not isinstance(frame.points, Path)


def _stems(frame: SourceFrame) -> Iterator[str]:
    """Names, without suffix, that a label file of a frame may have."""
    yield frame.name
    if frame.image is not None:
        yield frame.image.stem
    if isinstance(frame.points, Path):
        name = frame.points.name
        yield next((name.removesuffix(s) for s in CLOUD_SUFFIXES if name.endswith(s)), frame.points.stem)
