"""Several sequences of a data set as one recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Pose
from semcal_cli.importing.recording import Conversion, Recording
from semcal_cli.importing.stamps import MAX_GAP_NS

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
BETWEEN_DRIVES_S = 10.0
"""Time from the end of a drive to the start of the next one whose clock began anew, whatever it was."""
SPACED = f"the clocks of the {{}} begin anew: each is placed {BETWEEN_DRIVES_S:g} s after the one before"
"""Remark on drives that are moved in time."""
SHARED_CLOCK_S = 1e9
"""Stamps from here on are times since 1970 (of September 2001), on one clock for all drives."""


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
    recordings, is_spaced = _spaced(recordings)
    poses = _joined_poses(recordings)
    if by_odometry or poses is not None:
        _check_times(recordings)
    (first_name, first), *others = recordings.items()
    frames, remarks = list(first.frames), list(first.remarks)
    if is_spaced:
        remarks.append(SPACED.format("sequences"))
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


def clock_shifts_s(
    sweeps_s: Sequence[Sequence[float]], poses_s: Sequence[Sequence[float]] | None = None
) -> list[float]:
    """Find by how much to move drives in time whose clocks begin anew, so that they follow one another.

    Args:
        sweeps_s: Stamps of the sweeps of each drive, seconds.
        poses_s: Stamps of its poses, which may begin before its sweeps and end after them.

    Returns:
        Seconds to add to the stamps of each drive; zeros if no two drives overlap in time. A drive on the shared clock
        stays where it is.
    """
    poses_s = poses_s or [()] * len(sweeps_s)
    known = [index for index, stamps in enumerate(sweeps_s) if stamps]
    spans = {i: (min(all_s), max(all_s)) for i in known if (all_s := (*sweeps_s[i], *poses_s[i]))}
    shifts_s = [0.0] * len(sweeps_s)
    begins_anew = {index: end_s < SHARED_CLOCK_S for index, (_, end_s) in spans.items()}
    do_overlap = any(end_s >= start_s for (_, end_s), (start_s, _) in pairwise(sorted(spans.values())))
    if not do_overlap and len({*begins_anew.values()}) < 2:
        return shifts_s
    for before, index in pairwise(known):
        if begins_anew[index]:
            after_sweeps_s = max(sweeps_s[before]) + BETWEEN_DRIVES_S - min(sweeps_s[index])
            # Poses reach beyond the sweeps where only some frames of a drive are kept.
            after_poses_s = spans[before][1] + 2.0 * MAX_GAP_NS / NS - spans[index][0]
            shifts_s[index] = round(shifts_s[before] + max(after_sweeps_s, after_poses_s), 9)
    return shifts_s


def _spaced(recordings: Mapping[str, Recording]) -> tuple[dict[str, Recording], bool]:
    """Move sequences whose clocks begin anew after one another; and whether any had to be moved."""
    if any((recording.motion or {}).get("point_times") == "absolute" for recording in recordings.values()):
        return dict(recordings), False
    shifts_s = clock_shifts_s(
        [
            [frame.points_stamp for frame in recording.frames if frame.points_stamp is not None]
            for recording in recordings.values()
        ],
        [[stamp_ns / NS for stamp_ns in recording.poses or ()] for recording in recordings.values()],
    )
    moved = zip(recordings.items(), shifts_s, strict=True)
    return {name: _later(recording, shift_s) for (name, recording), shift_s in moved}, any(shifts_s)


def _later(recording: Recording, shift_s: float) -> Recording:
    """Add a time to all stamps of a recording."""
    if shift_s == 0.0:
        return recording
    frames = [
        replace(
            frame,
            points_stamp=later(frame.points_stamp, shift_s),
            image_stamp=later(frame.image_stamp, shift_s),
        )
        for frame in recording.frames
    ]
    poses = recording.poses
    if poses is not None:
        poses = {stamp_ns + round(shift_s * NS): T for stamp_ns, T in poses.items()}
    return replace(recording, frames=frames, poses=poses)


def later(stamp_s: float | None, shift_s: float) -> float | None:
    """Add a time to a stamp, if there is one, to the nanosecond."""
    return None if stamp_s is None else round(stamp_s + shift_s, 9)


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
    joined = {stamp_ns: T for sequence_poses in poses.values() for stamp_ns, T in sequence_poses.items()}
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
