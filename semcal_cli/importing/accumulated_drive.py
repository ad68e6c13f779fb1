"""The drive of a sparse LiDAR, accumulated: sweeps that follow one another as one dense cloud for each image."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.drive.document import Drive, output_drive_file
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError
from semcal_cli.events import Listener, ignore
from semcal_cli.files.documents import document_text
from semcal_cli.files.input_files import is_same_file
from semcal_cli.files.output_files import remove_if_refused
from semcal_cli.files.validation import validate
from semcal_cli.importing.accumulation import AccumulatedCloud, Accumulation
from semcal_cli.importing.drive_folder import check_may_replace
from semcal_cli.importing.merged_drive import described_frame, relative_name

OF_POINTS = ("point_labels", "point_features")
"""Keys of a frame's files that have a row for each point of its sweep."""
OF_SWEEPS = {"frames", "lidar", "point_columns", "point_type", "time_unit"}
"""Keys of a drive that describe its frames, and its sweeps as they were recorded."""


@dataclass(frozen=True)
class AccumulatedDrive:
    """Summary of an accumulation."""

    drive: Drive
    """The drive."""
    num_sweeps: list[int]
    """Number of sweeps of each of its frames."""
    num_points: list[int]
    """Number of points of each of its frames."""
    share_moving: float
    """Share of the points that were left out because other rays pass through them."""
    share_hidden: float
    """Share of the points that were left out because the origin of their cloud does not see them."""
    distance_m: float
    """Median distance of the sweeps from the one with the image, before a motion's rest is corrected."""
    left_out: Counter[str]
    """Number of frames with an image that were left out, by reason."""
    num_sharing: int
    """Number of further frames with an image whose sweeps are part of these clouds."""


def check_accumulated(
    out: Path, sweeps: Path, read: Iterable[Path] = (), images: Iterable[Path] = (), *, force: bool
) -> None:
    """Check, before sweeps are imported, that the drive that is accumulated from them may be written.

    Args:
        out: Folder of the accumulated drive, or its drive.yaml.
        sweeps: Folder of the sweeps and of the images that the import writes.
        read: Files that the import reads.
        images: Images of the data that stay where they are.
        force: Whether a drive.yaml of other data, or any other file in its place, is replaced.

    Raises:
        InputError: the drive.yaml is one of the files that are read, or is there and is not one of these data.
    """
    path, known = output_drive_file(out), set(map(os.path.realpath, images))
    if os.path.realpath(path) in map(os.path.realpath, read):
        raise InputError(f"{path}: found a file that this import reads; choose another name")
    if not force:
        folder = sweeps.resolve()

        def is_known(file: Path, frame: Frame) -> bool:
            return os.path.realpath(file) in known or folder in file.resolve().parents

        check_may_replace(path, is_known, of_networks=True)


def accumulate_drive(
    drive: Drive,
    out: Path,
    on_event: Listener = ignore,
    *,
    seconds: float | None = None,
    num_sweeps: int | None = None,
    force: bool = False,
) -> AccumulatedDrive:
    """Write a drive in which each frame's cloud is that of many sweeps, as the LiDAR would see it at `points_stamp`.

    The sweep of a frame with an image, and those nearest to it in time, become one cloud, each sweep in one cloud only.
    Points that move, and those that the LiDAR would not see from where it is at `points_stamp`, are left out.

    Args:
        drive: The drive, whose frames are all sweeps, with images or without.
        out: Folder of the new drive, or its drive.yaml.
        on_event: Called with each event.
        seconds: Largest time from the first sweep of a cloud to the last; or
        num_sweeps: Largest number of sweeps of a cloud, instead of a time.
        force: Whether a drive.yaml of other data, or any other file in its place, is replaced.

    Raises:
        ValueError: both lengths are given, or neither.
        InputError: the rig moves and the drive has no poses and no twist, or these do not fit the sweeps; no frame has
            an image; stamps are missing; a file cannot be read or written; or the drive.yaml is there and is not one of
            these data.
    """
    if (seconds is None) == (num_sweeps is None):
        raise ValueError("found seconds and num_sweeps both or neither, expected one of them")
    path = output_drive_file(out)
    inputs = _check_output(path, drive, force=force)
    accumulation = Accumulation(drive, seconds, num_sweeps, on_event)
    with remove_if_refused(path.parent) as write:
        frames, clouds = _write_clouds(accumulation, path, inputs, write)
        if not frames:
            raise accumulation.refusal()
        document = _document(drive, path) | {"frames": frames}
        if not accumulation.has_intensity:
            document["point_columns"] = ["x", "y", "z"]
        if all(cloud.stood for cloud in clouds):
            document["motion"] = {"speed_m_s": 0.0}
        accumulated = validate(Drive, document, path)
        write(document_text(document, "yaml").encode(), path)
    accumulated._path = path
    return _summary(accumulated, accumulation, clouds)


def _check_output(path: Path, drive: Drive, *, force: bool) -> set[str]:
    """Check that the drive.yaml at `path` may be written, and return the files of the drive, which must stay."""
    if is_same_file(path, drive.path):
        raise InputError(f"{path}: found the drive to accumulate; choose another -o")
    inputs = {os.path.realpath(drive.resolve(name)) for name in drive.files()}
    if not force:
        check_may_replace(path, lambda file, frame: os.path.realpath(file) in inputs, of_networks=True)
    return inputs


def _write_clouds(
    accumulation: Accumulation, path: Path, inputs: set[str], write: Callable[[bytes, Path], None]
) -> tuple[list[dict[str, Any]], list[AccumulatedCloud]]:
    """Write the files of the clouds; return the frames of the drive.yaml at `path`, and the clouds without points."""
    frames, clouds = dict[int, dict[str, Any]](), list[AccumulatedCloud]()
    for frame, cloud in accumulation.clouds():
        files = cloud.files(f"{path.stem}/{cloud.place:06d}")
        if not clouds:
            path.unlink(missing_ok=True)  # or, if this run ends early, it would name clouds of two runs
        for name, content in files.values():
            if os.path.realpath(path.parent / name) in inputs:
                raise InputError(f"{path.parent / name}: found a file of the drive; choose another -o")
            write(content, path.parent / name)
        names = {key: name for key, (name, _) in files.items()}
        frames[cloud.place] = _frame(accumulation.drive, frame, path) | names
        # A view of no points would keep them all in memory.
        clouds.append(cloud._replace(points=cloud.points[:0].copy(), labels=None))
    return [frames[place] for place in sorted(frames)], clouds


def _summary(
    accumulated: Drive, accumulation: Accumulation, clouds: Sequence[AccumulatedCloud]
) -> AccumulatedDrive:
    num_read = sum(cloud.num_read for cloud in clouds)
    return AccumulatedDrive(
        accumulated,
        [cloud.num_sweeps for cloud in clouds],
        [cloud.num_points for cloud in clouds],
        sum(cloud.num_moving for cloud in clouds) / num_read,
        sum(cloud.num_hidden for cloud in clouds) / num_read,
        float(np.median([cloud.distance_m for cloud in clouds])),
        accumulation.left_out,
        accumulation.num_sharing,
    )


def _frame(drive: Drive, frame: Frame, path: Path) -> dict[str, Any]:
    """Describe a frame for a drive.yaml at `path`, without what belongs to the points of its sweep."""
    return described_frame(drive, frame.model_copy(update=dict.fromkeys(OF_POINTS)), path)


def _document(drive: Drive, path: Path) -> dict[str, Any]:
    """Make the content of the drive.yaml at `path`, without frames."""
    document = drive.model_dump(mode="json", exclude_unset=True, exclude_none=True, exclude=OF_SWEEPS)
    if isinstance(drive.camera.mask, str):
        document["camera"]["mask"] = relative_name(drive, drive.camera.mask, path)
    # A cloud of many sweeps has neither the pattern of one nor a time for each point.
    if any(drive.origin_m):
        document["lidar"] = {"origin_m": list(drive.origin_m)}
    if drive.motion is not None and drive.motion.speed_m_s is None:
        document["motion"]["point_times"] = "deskewed"
        if drive.motion.poses is not None:
            document["motion"]["poses"] = relative_name(drive, drive.motion.poses, path)
    return document
