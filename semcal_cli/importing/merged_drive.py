"""Several drives of one rig as one: sequences that were recorded with the same camera, one after another."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.document import Drive, output_drive_file
from semcal_cli.drive.frames import FILES, Frame
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import InputError, describe
from semcal_cli.files.documents import document_text
from semcal_cli.files.input_files import is_same_file, read_text
from semcal_cli.files.output_files import remove_if_refused
from semcal_cli.files.validation import StrictModel, validate
from semcal_cli.importing.drive_folder import check_may_replace
from semcal_cli.importing.joined_sequences import SPACED, clock_shifts_s, later
from semcal_cli.importing.stamps import seconds_text
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.motion import compensated, read_poses
from semcal_cli.observations.point_times import MAX_SWEEP_S
from semcal_cli.observations.reading import read_clouds
from semcal_cli.result.refined_camera import camera_differences

SHARED = (
    "lidar",
    "ignore",
    "classes",
    "palette",
    "point_columns",
    "point_type",
    "time_unit",
    "time_offset_s",
    "time_offset_sigma_s",
)
"""Keys whose values must be the same in all drives."""
OPTIONAL = ("frame_ids", "networks", "synchronization", "T_camera_lidar")
"""Keys that are left out where their values are not the same."""
MAX_SHOWN = 60
"""Length of the longest list that a message writes out."""
SAME_POSE = 1e-9
"""Largest difference of two references that are the same."""


class MergedDrive(NamedTuple):
    """Summary of a merge."""

    path: Path
    """The drive.yaml."""
    num_frames: int
    """Number of its frames."""
    remarks: tuple[str, ...]
    """Sentences that the user should read: keys that are left out, and drives that are moved in time."""


def merge_drives(drives: Sequence[Drive], out: Path, *, force: bool = False) -> MergedDrive:
    """Write one drive with the frames of several drives of one rig, in their order. It names the files where they are.

    Poses become one file beside the new drive. Drives whose clocks begin anew are moved in time after one another.

    Args:
        drives: The drives, at least one.
        out: Folder of the new drive, or its drive.yaml.
        force: Whether a drive.yaml of other data, or any other file in its place, is replaced.

    Raises:
        InputError: the drives differ in the camera or in another key that counts for all frames, two of them have the
            same frame, their poses overlap in time or do not cover their own frames, a file cannot be read or written,
            or the drive.yaml is there and is not one of these data.
    """
    path, first = output_drive_file(out), drives[0]
    poses_path = path.parent / "poses" / f"{path.stem}.txt"
    for drive in drives:
        _check_kept(drive, (path, poses_path))
        _check_same(first, drive)
    _check_no_frame_twice(drives)
    if not force:
        known_files = {
            os.path.realpath(drive.resolve(name))
            for drive in drives
            for frame in drive.frames
            for name in (frame.image, frame.image_labels, frame.points)
            if name is not None
        }
        check_may_replace(path, lambda file, frame: os.path.realpath(file) in known_files)
    left_out = tuple(key for key in OPTIONAL if not _have_same(drives, key))
    remarks = [f"{key} is not the same in all drives, and is left out" for key in left_out]
    # What nobody stated, such as the clock, is not stated by a copy.
    document = first.model_dump(mode="json", exclude_unset=True, exclude_none=True, exclude=set(left_out))
    shifts_s = _shifts_s(drives)
    if any(shifts_s):
        remarks.append(SPACED.format("drives"))
    document["frames"] = [
        described_frame(drive, _later(frame, shift_s), path)
        for drive, shift_s in zip(drives, shifts_s, strict=True)
        for frame in drive.frames
    ]
    if isinstance(first.camera.mask, str):
        document["camera"]["mask"] = relative_name(first, first.camera.mask, path)
    poses = _joined_poses(drives, shifts_s)
    if poses is not None:
        for drive in drives:
            _check_covered(drive)
        document["motion"]["poses"] = poses_path.relative_to(path.parent).as_posix()
    validate(Drive, document, path)
    with remove_if_refused(path.parent) as write:
        if poses is not None:
            write(poses.encode(), poses_path)
        write(document_text(document, "yaml").encode(), path)
    return MergedDrive(path, len(document["frames"]), tuple(remarks))


def _check_kept(drive: Drive, outputs: tuple[Path, ...]) -> None:
    """Check that the merged drive replaces neither a drive nor its poses."""
    for output in outputs:
        if is_same_file(output, drive.path):
            raise InputError(f"{output}: found one of the drives to merge; choose another -o")
        if (motion := drive.motion) and motion.poses and is_same_file(output, drive.resolve(motion.poses)):
            raise InputError(f"{output}: found the poses of {drive.path}; choose another -o")


def _check_covered(drive: Drive) -> None:
    """Check that a drive's own poses cover its frames: the joined ones also cover the time between two drives.

    Only frames near the first and the last pose are read: points and image are within `MAX_SWEEP_S` of the stamp of
    their sweep.
    """
    assert drive.motion is not None
    stamps_s, _ = read_poses(drive.resolve(str(drive.motion.poses)))
    near_s = MAX_SWEEP_S + abs(drive.time_offset_s) + drive.camera.readout_s
    start_s, end_s = min(stamps_s) + near_s, max(stamps_s) - near_s
    for index, frame in enumerate(drive.frames):
        if frame.points_stamp is None or not start_s < frame.points_stamp < end_s:
            near = with_frames(drive, [index])
            compensated(near, read_clouds(near))


def _check_same(first: Drive, drive: Drive) -> None:
    """Check that what a drive states of all its frames is the same as in the first drive."""
    if differences := camera_differences(drive.camera, first.camera, str(first.path)):
        raise InputError(f"{drive.path}: camera: found {', '.join(differences)}, expected the same camera")
    values = {key: (getattr(first, key), getattr(drive, key)) for key in SHARED}
    values["camera.mask"] = _located_mask(first), _located_mask(drive)
    values["motion"] = _motion_of_any_poses(first), _motion_of_any_poses(drive)
    for key, (value, other) in values.items():
        if value != other:
            place, known, found = _first_difference(key, *map(_plain, (value, other)))
            raise InputError(
                f"{drive.path}: {place}: found {_shown(found)}, expected {_shown(known)} as in {first.path}"
            )


def _check_no_frame_twice(drives: Sequence[Drive]) -> None:
    """Check that no two drives have a frame of the same sweep and the same image: it would count twice."""
    known = dict[tuple[str | None, ...], Path]()
    for drive in drives:
        names = [(frame, (frame.points, frame.image or frame.image_labels)) for frame in drive.frames]
        files = {
            tuple(name and os.path.realpath(drive.resolve(name)) for name in file_names): frame
            for frame, file_names in names
        }
        for key, frame in files.items():
            if (other := known.get(key)) is not None:
                raise InputError(
                    f"{drive.path}: {frame.key('points')}: found a frame that {other} has, too, expected other frames: "
                    "leave out one of the drives, or the frame"
                )
        known |= dict.fromkeys(files, drive.path)


def _plain(value: object) -> object:
    """Return the content of a block as a document, and any other value as it is."""
    return value.model_dump(mode="json") if isinstance(value, StrictModel) else value


def _first_difference(key: str, value: object, other: object) -> tuple[str, object, object]:
    """Find the first key in which two blocks differ, and its two values."""
    if isinstance(value, dict) and isinstance(other, dict):
        for name in {**value, **other}:
            if value.get(name) != other.get(name):
                return _first_difference(f"{key}.{name}", value.get(name), other.get(name))
    return key, value, other


def _shown(value: object) -> str:
    """Describe a value, and write out a path and a short list."""
    if isinstance(value, str):
        return repr(value)
    if isinstance(value, list | tuple) and len(text := str([*value])) <= MAX_SHOWN:
        return text
    return describe(value)


def _located_mask(drive: Drive) -> object:
    mask = drive.camera.mask
    return os.path.realpath(drive.resolve(mask)) if isinstance(mask, str) else mask


def _motion_of_any_poses(drive: Drive) -> Motion | None:
    """Return the motion with the same name for any file of poses."""
    motion = drive.motion
    return motion and motion.model_copy(update={"poses": motion.poses and "a file"})


def _have_same(drives: Sequence[Drive], key: str) -> bool:
    first, *others = (getattr(drive, key) for drive in drives)
    if isinstance(first, tuple) and all(isinstance(other, tuple) for other in others):
        return all(np.allclose(first, other, rtol=0.0, atol=SAME_POSE) for other in others)
    return all(first == other for other in others)


def described_frame(drive: Drive, frame: Frame, path: Path) -> dict[str, Any]:
    """Describe a frame of a drive for another drive.yaml at `path`, which names its files where they are."""
    document = frame.model_dump(mode="json", exclude_none=True)
    return document | {key: relative_name(drive, document[key], path) for key in FILES if key in document}


def relative_name(drive: Drive, name: str, path: Path) -> str:
    """Name a file of a drive relative to another drive.yaml at `path`."""
    return os.path.relpath(drive.resolve(name), path.parent)


def _shifts_s(drives: Sequence[Drive]) -> list[float]:
    """Find the seconds to add to the stamps of each drive. Drives with one file of poses have one clock."""
    if drives[0].motion is not None and drives[0].motion.point_times == "absolute":
        return [0.0] * len(drives)
    clocks = [_poses_file(drive) or drive.path for drive in drives]
    sweeps_s = dict[Path, list[float]]()
    for clock, drive in zip(clocks, drives, strict=True):
        stamps_s = [frame.points_stamp for frame in drive.frames if frame.points_stamp is not None]
        sweeps_s.setdefault(clock, []).extend(stamps_s)
    poses_s = [read_poses(clock)[0] if _poses_file(drives[0]) else [] for clock in sweeps_s]
    shifts_s = dict(zip(sweeps_s, clock_shifts_s([*sweeps_s.values()], poses_s), strict=True))
    return [shifts_s[clock] for clock in clocks]


def _later(frame: Frame, shift_s: float) -> Frame:
    stamps = {key: later(getattr(frame, key), shift_s) for key in ("points_stamp", "image_stamp")}
    return frame.model_copy(update=stamps) if shift_s else frame


def _poses_file(drive: Drive) -> Path | None:
    return drive.resolve(drive.motion.poses) if drive.motion and drive.motion.poses else None


def _joined_poses(drives: Sequence[Drive], shifts_s: Sequence[float]) -> str | None:
    """Join the files of the poses in order of time; None without poses. No frame lies between two files."""
    files = {
        file: shift_s for drive, shift_s in zip(drives, shifts_s, strict=True) if (file := _poses_file(drive))
    }
    spans = []
    for file, shift_s in files.items():
        stamps, _ = read_poses(file)
        spans.append((min(stamps) + shift_s, max(stamps) + shift_s, file))
    spans.sort()
    for (_, end_s, before), (start_s, _, file) in pairwise(spans):
        if start_s <= end_s:
            raise InputError(
                f"{file}: found poses from {start_s:.3f} s on, before the last of {before} at {end_s:.3f} s, expected "
                "drives of different times"
            )
    texts = [_shifted_text(file, files[file]) for *_, file in spans]
    return "\n".join([*texts, ""]) if texts else None


def _shifted_text(file: Path, shift_s: float) -> str:
    """Read the text of poses, with a time added to each stamp."""
    text = read_text(file, limit=MAX_TABLE_BYTES).rstrip("\n")
    if not shift_s:
        return text
    lines = []
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            stamp, rest = line.replace(",", " ").split(maxsplit=1)
            line = f"{seconds_text(round(float(stamp) * NS) + round(shift_s * NS))} {rest}"
        lines.append(line)
    return "\n".join(lines)
