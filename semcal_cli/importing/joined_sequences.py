"""Several sequences of a data set as one recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Pose
from semcal_cli.importing.recording import Conversion, Recording

BLOCKS_OF_ALL = (
    "camera",
    "lidar",
    "frame_ids",
    "point_classes",
    "image_classes",
    "ids_in_red",
    "point_form",
    "motion",
    "synchronization",
    "time_offset_s",
    "time_offset_sigma_s",
)
"""Fields of a recording that are the same in all sequences of one drive."""


def join_sequences(
    recordings: Mapping[str, Recording], *, are_labelled_by_name: bool, by_odometry: bool
) -> Recording:
    """Make one recording of several sequences of a data set, with their frames in the given order.

    Args:
        recordings: The recordings by the names of their sequences, at least one.
        are_labelled_by_name: Whether labels are looked up by the names of frames.
        by_odometry: Whether the motion will be estimated from the sweeps in order of time.

    Raises:
        InputError: the sequences differ in the camera or in another block of the drive, frames have the same name
            where files are named after them, or the sequences have a motion and overlap in time.
    """
    poses = _joined_poses(recordings)
    if by_odometry or poses is not None:
        _check_times(recordings)
    (first_name, first), *others = recordings.items()
    frames, remarks = list(first.frames), list(first.remarks)
    for name, recording in others:
        if (block := _differing_block(recording, first)) is not None:
            raise InputError(
                f"--sequence: found another {block} in {name} than in {first_name}, expected the same"
            )
        known = {frame.name for frame in frames}
        again = next((frame.name for frame in recording.frames if frame.name in known), None)
        if again is not None and (
            are_labelled_by_name or any(isinstance(frame.points, Conversion) for frame in recording.frames)
        ):
            raise InputError(
                f"--sequence: found frame {again} in {name}, too, expected frames of other names for their files: "
                "import each sequence alone, and use `semcal merge`"
            )
        frames += recording.frames
        remarks += [remark for remark in recording.remarks if remark not in remarks]
    read = tuple(dict.fromkeys(path for recording in recordings.values() for path in recording.read))
    return replace(first, frames=frames, remarks=tuple(remarks), read=read, poses=poses)


def _differing_block(one: Recording, other: Recording) -> str | None:
    """Name the first block of the drive in which two sequences differ; None if they agree."""
    for key in BLOCKS_OF_ALL:
        if getattr(one, key) != getattr(other, key):
            return key
    T, other_T = (
        (np.nan,) if recording.T_camera_lidar is None else recording.T_camera_lidar
        for recording in (one, other)
    )
    return None if np.array_equal(T, other_T, equal_nan=True) else "reference"


def _joined_poses(recordings: Mapping[str, Recording]) -> dict[int, Pose] | None:
    """Join the poses of all sequences in order of time; None if no sequence has poses."""
    poses = {name: recording.poses for name, recording in recordings.items() if recording.poses is not None}
    if not poses:
        return None
    if lacking := [name for name in recordings if name not in poses]:
        raise InputError(
            f"--sequence: found poses of {next(iter(poses))}, and none of {lacking[0]}, expected poses of all or none: "
            "import each sequence alone"
        )
    joined = {stamp_ns: T for of_one in poses.values() for stamp_ns, T in of_one.items()}
    return {stamp_ns: joined[stamp_ns] for stamp_ns in sorted(joined)}


def _check_times(recordings: Mapping[str, Recording]) -> None:
    """Check that sequences are of different times: their poses, or sweeps without poses, do not overlap."""
    spans = []
    for name, recording in recordings.items():
        stamps_s = [stamp_ns / NS for stamp_ns in recording.poses or ()]
        stamps_s += [frame.points_stamp for frame in recording.frames if frame.points_stamp is not None]
        if stamps_s:
            spans.append((min(stamps_s), max(stamps_s), name))
    for (_, end_s, before), (start_s, _, name) in pairwise(sorted(spans)):
        if start_s <= end_s:
            raise InputError(
                f"--sequence: found times of {name} from {start_s:.3f} s on, before the end of {before} at "
                f"{end_s:.3f} s, expected sequences of different times for their motion: import each alone"
            )
