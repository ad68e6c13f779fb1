"""What a report is about: a transform, what semcal wrote with it, and the frames to look at it with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semcal_cli.calibration import Calibration, Input, InputFrame
from semcal_cli.documents import listed
from semcal_cli.drive import Drive, Frame
from semcal_cli.formats import read_transform
from semcal_cli.formats.semcal import read_record
from semcal_cli.observations import Observations, load_observations
from semcal_cli.overlay import Overlays
from semcal_cli.poses import Pose
from semcal_cli.provenance import describe_input
from semcal_cli.selection import MAX_FRAMES, evenly_spaced, select_frames

MAX_PICTURES = 20
"""Of so many frames, evenly spaced, pictures are shown."""


@dataclass(frozen=True)
class Subject:
    """A transform and the frames that figures and pictures are of."""

    name: str
    """The transform's file."""
    T_camera_lidar: Pose
    record: Calibration | None
    """What semcal wrote with the transform; None if the file holds nothing else."""
    before: tuple[str, Pose] | None
    """Another transform to show beside it, under its caption."""
    drive: Drive
    observations: Observations
    input: Input
    """The frames, and the hashes of their files as they are now."""
    notices: tuple[str, ...]
    """What a reader has to know of where figures are from."""

    def overlays(self) -> Overlays:
        """Pictures of evenly spaced frames, before, if there is a transform to compare with, and after."""
        indices = evenly_spaced(range(len(self.drive.frames)), MAX_PICTURES)
        frames = tuple(self.drive.frames[index] for index in indices)
        before = {} if self.before is None else {self.before[0]: self.before[1]}
        return Overlays(
            self.drive.model_copy(update={"frames": frames}),
            self.observations.of_frames(indices),
            before | {self.name: self.T_camera_lidar},
        )


def read_subject(drive: Drive, calibration: Path, against: Path | None = None) -> Subject:
    """Read a transform of any known format and the frames it was computed from, or else those that differ most.

    Args:
        drive: Where frames are.
        calibration: A calibration of semcal's, or a transform of any known format.
        against: A transform to show beside it; None: the calibration's first stage, if it has another one.

    Raises:
        InputError: a file is missing, wrong, or leaves something open.
        CalibrationError: one side's labels carry a single class.
    """
    before = None if against is None else (str(against), read_transform(against))
    return make_subject(
        drive, str(calibration), read_transform(calibration), read_record(calibration), before
    )


def make_subject(
    drive: Drive,
    name: str,
    T_camera_lidar: Pose,
    record: Calibration | None,
    before: tuple[str, Pose] | None = None,
) -> Subject:
    """Read the frames that a transform was computed from, or else those that differ most.

    Args:
        drive: Where frames are.
        name: What to call the transform.
        T_camera_lidar: (4, 4).
        record: What is known beside it.
        before: A transform to show beside it, under its caption; None: the record's first stage, if it has another one.

    Raises:
        InputError: a file is missing or wrong.
        CalibrationError: one side's labels carry a single class.
    """
    if before is None and record is not None:
        before = _first_stage(record)
    frames = [] if record is None else _frames_of(drive, record)
    used = drive.model_copy(update={"frames": tuple(frames)}) if frames else select_frames(drive, MAX_FRAMES)
    found = describe_input(used, None, Path())
    return Subject(
        name=name,
        T_camera_lidar=T_camera_lidar,
        record=record,
        before=before,
        drive=used,
        observations=load_observations(used),
        input=found,
        notices=tuple(_notices(drive, used, record, found)),
    )


def _first_stage(record: Calibration) -> tuple[str, Pose] | None:
    name, stage = next(iter(record.stages.items()), (None, None))
    if name is None or stage is None or stage.T_camera_lidar == record.T_camera_lidar:
        return None
    return f"{name}: as the first stage left it", np.array(stage.T_camera_lidar)


def _frames_of(drive: Drive, record: Calibration) -> list[Frame]:
    """Those frames of a drive that a calibration was computed from."""
    names = {_key(frame) for frame in record.input.frames}
    return [frame for frame in drive.frames if _key(frame) in names]


def _key(frame: Frame | InputFrame) -> tuple[str | None, ...]:
    return frame.points, frame.point_labels, frame.image_labels


def _notices(drive: Drive, used: Drive, record: Calibration | None, found: Input) -> list[str]:
    """Say where the drive is not what the calibration was computed from."""
    if record is None:
        return []
    known = record.input.sha256
    num_used, num_known = len(used.frames), len(record.input.frames)
    if not _frames_of(drive, record):
        return [
            f"The calibration was computed from other frames, of {record.input.drive}; figures and pictures are of "
            f"{drive.path}."
        ]
    notices = []
    if num_used != num_known:
        notices.append(f"Of the {num_known} frames it was computed from, {num_used} are in {drive.path}.")
    changed = [name for name, digest in found.sha256.items() if known.get(name, digest) != digest]
    if changed:
        notices.append(f"Since it was computed, files were changed: {listed(changed)}.")
    return notices
