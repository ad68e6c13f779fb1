"""The input of a report: a transform, what semcal wrote with it, and the frames that show it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.config import AUTO, MAX_FRAMES, RefinementConfig
from semcal_cli.config.directions import Direction
from semcal_cli.config.setting import check_settings
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError, listed
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.formats import read_reference
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.cues.cue_table import choose_cues, choose_frames, load_cues, policy_of
from semcal_cli.observations.frame_selection import evenly_spaced, with_frames
from semcal_cli.observations.motion import unrolled
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.skew import Skew
from semcal_cli.report.colors import first_coloring
from semcal_cli.report.overlays import Overlays
from semcal_cli.result.applied import apply_result, as_begun, cues_applied, seen_as
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.provenance import hash_input
from semcal_cli.result.sections import InputFrame


class ComparedTransform(NamedTuple):
    """Another transform to compare with."""

    caption: str
    T_camera_lidar: Pose
    drive: Drive
    """The drive with the camera and the clock that the transform belongs to."""
    changes: tuple[tuple[str, str], ...] = ()
    """Where these differ from the drive's own: `camera` or `clock`, and a line that says how."""


@dataclass(frozen=True)
class ReportInput:
    """A transform and the frames that the figures and images of a report show."""

    name: str
    """Name of the transform's file."""
    T_camera_lidar: Pose
    record: CalibrationDocument | None
    """Calibration that semcal wrote with the transform; None if the file holds nothing else."""
    before: ComparedTransform | None
    """Another transform to compare with."""
    drive: Drive
    """The drive of the frames, with the camera and the clock that were estimated together with the transform."""
    changes: tuple[tuple[str, str], ...]
    """Where these and those of the other transform differ from the drive's own: `camera` or `clock`, and a line that
    says how."""
    observations: Observations
    """Points and images; with a rolling shutter, each point at the moment of its line at the transform."""
    is_of_record: bool
    """Whether the calibration was computed from these frames and this camera."""
    notices: tuple[str, ...]
    """Sentences for the reader about the origin of the figures."""

    def overlays(self, max_frames: int) -> Overlays:
        """Return the images of evenly spaced frames: before, if there is a transform to compare with, and after."""
        indices = evenly_spaced(range(len(self.drive.frames)), max_frames)
        poses, others = {}, {}
        if self.before is not None:
            poses[self.before.caption] = self.before.T_camera_lidar
            others[self.before.caption] = self.observed_by(self.before.drive).of_frames(indices)
        return Overlays(
            with_frames(self.drive, indices),
            self.observations.of_frames(indices),
            poses | {self.name: self.T_camera_lidar},
            first_coloring(self.observations),
            others,
        )

    def observed_by(self, other: Drive) -> Observations:
        """Return the observations as the camera and the clock of another copy of the drive see them."""
        return seen_as(self.observations, self.drive, other)


def read_report_input(
    drive: Drive, calibration: Path, against: Path | None = None, direction: Direction | None = None
) -> ReportInput:
    """Read a transform in any known format, and the frames it was computed from, or else those that differ most.

    Args:
        drive: Drive whose frames are shown.
        calibration: A calibration by semcal, or a transform in any known format.
        against: A transform to compare with; None takes the first stage of the calibration, if that is another pose.
        direction: Direction of a transform whose file does not state it.

    Raises:
        InputError: a file is missing, wrong or ambiguous.
        CalibrationError: one side's labels carry a single class.
    """
    before = None
    if against is not None:
        other = read_reference(against, direction)
        applied = apply_result(other.record, drive, str(against))
        before = ComparedTransform(str(against), other.T_camera_lidar, *applied)
    extrinsic = read_reference(calibration, direction)
    return make_report_input(drive, str(calibration), extrinsic.T_camera_lidar, extrinsic.record, before)


def make_report_input(
    drive: Drive,
    name: str,
    T_camera_lidar: Pose,
    record: CalibrationDocument | None,
    before: ComparedTransform | None = None,
) -> ReportInput:
    """Read the frames that a transform was computed from, or else those that differ most.

    Args:
        drive: Drive whose frames are shown.
        name: Name of the transform.
        T_camera_lidar: (4, 4).
        record: CalibrationDocument that semcal wrote with the transform, if there is one.
        before: Transform to compare with; None takes the first stage of the record, if that is another pose.

    Raises:
        InputError: a file is missing or wrong.
        CalibrationError: one side's labels carry a single class.
    """
    if before is None and record is not None:
        stage = next(iter(record.stages.values()), None)
        if stage is not None and stage.T_camera_lidar != record.rows_camera_lidar:
            before = ComparedTransform(
                "the first stage", np.array(stage.T_camera_lidar), as_begun(record, drive)
            )
    drive, changes = apply_result(record, drive, name)
    used_drive, notices = (None, []) if record is None else _find_frames(drive, record)
    differences = apply_result(record, drive, name).sentences
    is_of_record = used_drive is not None and not differences
    notices += differences
    if before is not None:
        notices += [
            f"In the images of {before.caption}, the {label} is {line}." for label, line in before.changes
        ]
        changes = (*before.changes, *changes)
    # Only the first cue that refined the pose is read: pixels of one cue share no information with points of another.
    sweeps = SweepCache()
    cues = cues_applied(record, AUTO, drive, with_features=True)
    cues = policy_of(choose_cues(cues, drive, sweeps)).refined[:1]
    used_drive = used_drive or choose_frames(drive, cues, MAX_FRAMES)
    observations = _with_settings(load_cues(used_drive, cues, sweeps), record)
    if is_of_record and record is not None:
        observations = Skew.undone(observations, used_drive, record.T_camera_lidar, record.deskewed_m_s)
    return ReportInput(
        name=name,
        T_camera_lidar=T_camera_lidar,
        record=record,
        before=before,
        drive=used_drive,
        changes=changes,
        observations=unrolled(observations.along_scans(T_camera_lidar), T_camera_lidar),
        is_of_record=is_of_record,
        notices=tuple(notices),
    )


def _with_settings(observations: Observations, record: CalibrationDocument | None) -> Observations:
    """Use the maximum baseline and the edge band that a calibration records, unless it has none or they are wrong."""
    polish = None if record is None else record.settings.options.get("polish")
    known: dict[str, Any] = {}
    if isinstance(polish, dict):
        known = {name: polish[name] for name in observations.shared_settings if name in polish}
    with suppress(InputError):
        check_settings(RefinementConfig(**known))
        return replace(observations, **known)
    return observations


def _find_frames(drive: Drive, record: CalibrationDocument) -> tuple[Drive | None, list[str]]:
    """Find the frames that a calibration was computed from, if the drive has them, and name what has changed."""
    keys = [
        key
        for key in InputFrame.model_fields
        if any(getattr(files_of_frame, key) for files_of_frame in record.input.frames)
    ]

    def files(frame: Frame | InputFrame) -> tuple[str | None, ...]:
        return tuple(getattr(frame, key) for key in keys)

    names = {files(frame) for frame in record.input.frames}
    frames: dict[tuple[str | None, ...], Frame] = {}  # a frame that is listed twice is read once
    for frame in drive.frames:
        if files(frame) in names:
            frames.setdefault(files(frame), frame)
    used_drive, recorded_hashes = (
        drive.model_copy(update={"frames": tuple(frames.values())}),
        record.input.sha256,
    )
    hashes = hash_input(used_drive, keys)
    changed = {name for name, digest in hashes.items() if recorded_hashes.get(name, digest) != digest}
    if all(changed & set(filter(None, files_of_frame)) for files_of_frame in frames):
        notice = (
            f"The calibration was computed from other frames, those of {record.input.drive}; figures and images show "
            f"{drive.path}."
        )
        return None, [notice]
    notices = []
    if len(frames) != len(names):
        notices.append(f"Of the {len(names)} frames it was computed from, {len(frames)} are in {drive.path}.")
    if changed:
        notices.append(f"Files have changed since it was computed: {listed(sorted(changed))}.")
    return used_drive, notices
