"""The drive of a recording: a drive.yaml that names the original files, and copies of converted clouds."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.config.point_files import PointForm
from semcal_cli.drive.document import Drive, output_drive_file, read_drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError, OccupiedError, counted
from semcal_cli.files.documents import document_text
from semcal_cli.files.image_files import holds_colors
from semcal_cli.files.output_files import remove_if_refused
from semcal_cli.files.validation import MAX_TRANSLATION_M, validate
from semcal_cli.formats.node import rigid
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, nearest_rigid, rotation_error_deg
from semcal_cli.importing.choice import FrameChoice, keep_labelled, narrow, relabel, select_varied
from semcal_cli.importing.dataset_tree import need_file, writable_name
from semcal_cli.importing.drive_odometry import drive_motion
from semcal_cli.importing.motion_agreement import compare_motions
from semcal_cli.importing.ontologies import Ontology
from semcal_cli.importing.recording import Conversion, Recording, SourceFrame, with_poses
from semcal_cli.importing.stamps import tum_text
from semcal_cli.importing.sweep_odometry import SIGMA, odometry_remark

UNWRITTEN = Path("the drive to be written")
"""File name for errors that no single file of the data set causes."""


@dataclass(frozen=True)
class WrittenDrive:
    """Summary of a written drive."""

    path: Path
    """The drive.yaml."""
    num_frames: int
    """Number of frames."""
    num_converted: int
    """Number of converted clouds that were written beside the drive.yaml."""
    remarks: tuple[str, ...]
    """Sentences that the user should read."""
    drive: Drive
    """The drive."""


def write_drive(
    recording: Recording, options: FrameChoice, out: Path, *, force: bool = False
) -> WrittenDrive:
    """Write a drive. The drive.yaml is written last, and each file as a whole or not at all; errors leave no new file.

    Args:
        recording: The sequence of the data set.
        options: The user's labels, classes and choice of frames.
        out: Folder of the drive, or its drive.yaml.
        force: Whether a drive.yaml of other data, or any other file in its place, is replaced.

    Raises:
        InputError: no frame is left, a file cannot be written, the recording makes no valid drive, or the drive.yaml is
            there and is not one of these data.
    """
    path = output_drive_file(out)
    tables = [Path(name) for name in (options.image_classes, options.point_classes) if name is not None]
    if os.path.realpath(path) in map(os.path.realpath, [*recording.read, *tables]):
        raise InputError(f"{path}: found a file that this import reads; choose another name")
    recording = relabel(recording, options)
    if not options.keeps_all:
        recording = keep_labelled(recording)
    if not force:
        known_files = {
            os.path.realpath(file)
            for frame in recording.frames
            if (file := _identifying_file(frame)) is not None
        }
        check_may_replace(path, lambda file, frame: os.path.realpath(file) in known_files)
    if options.odometry:
        recording = _with_odometry(recording, path)
    recording = narrow(recording, options)
    drive = validate(Drive, _document(recording, path), UNWRITTEN)
    drive._path = path
    chosen = select_varied(drive, recording, options)
    with remove_if_refused(path.parent) as write:
        frames = [frame for frame in chosen if _write_converted(frame, path.parent, write)]
        if not frames:
            file = next(frame.points.file for frame in chosen if isinstance(frame.points, Conversion))
            raise InputError(
                f"{file}: found no points for any of {counted(len(chosen), 'frame')}, expected some"
            )
        document = _document(replace(recording, frames=frames), path)
        drive = validate(Drive, document, UNWRITTEN)
        drive._path = path
        if recording.poses is not None:
            write(tum_text(recording.poses).encode(), path.parent / _poses_file(path))
        write(document_text(document, "yaml").encode(), path)
    remarks = [*recording.remarks]
    if left_out := len(chosen) - len(frames):
        remarks.append(f"left out {counted(left_out, 'frame')} without points")
    num_converted = sum(isinstance(frame.points, Conversion) for frame in frames)
    return WrittenDrive(path, len(frames), num_converted, (*remarks, *_motion_remarks(frames)), drive)


def check_may_replace(
    path: Path, is_known: Callable[[Path, Frame], bool], *, of_networks: bool = False
) -> None:
    """Check that a drive.yaml may be written: there is none, or one that an import of the same data wrote.

    Args:
        path: The drive.yaml.
        is_known: Whether a frame of the old drive belongs to the data, by its image, or its sweep without an image.
        of_networks: Whether a drive with labels of networks may be replaced, as its source has them, too.

    Raises:
        OccupiedError: there is another file.
    """
    if not path.is_file():
        return
    description = "a file that cannot be read as a drive"
    with suppress(InputError):
        old, description = read_drive(path), "a drive of other data"
        names = [frame.image or frame.image_labels or frame.points for frame in old.frames]
        if old.networks is not None and not of_networks:
            description = "a drive with labels of networks"
        elif any(is_known(old.resolve(name), frame) for name, frame in zip(names, old.frames, strict=True)):
            return
    raise OccupiedError(f"{path}: found {description}")


def _identifying_file(frame: SourceFrame) -> Path | None:
    """Choose the original file by which a frame is known again."""
    return frame.image or frame.image_labels or (frame.points if isinstance(frame.points, Path) else None)


def _document(recording: Recording, path: Path) -> dict[str, Any]:
    """Make the content of a drive.yaml at `path`."""
    lidar, T_camera_lidar, sigma_s = recording.lidar, _reference(recording), recording.time_offset_sigma_s
    motion = None if recording.motion is None else dict(recording.motion)
    if recording.poses is not None:
        motion = {"poses": _poses_file(path)} | (motion or {})
    return {
        "semcal_drive": 1,
        "camera": dict(recording.camera),
        **({} if lidar is None else {"lidar": dict(lidar)}),
        **({} if recording.frame_ids is None else {"frame_ids": dict(recording.frame_ids)}),
        "frames": [_frame_document(frame, path.parent) for frame in recording.frames],
        **_class_blocks(recording),
        **_point_keys(recording.point_form),
        **({} if motion is None else {"motion": motion}),
        **({} if recording.synchronization == "unknown" else {"synchronization": recording.synchronization}),
        **({} if recording.time_offset_s == 0.0 else {"time_offset_s": recording.time_offset_s}),
        **({} if sigma_s is None else {"time_offset_sigma_s": sigma_s}),
        **({} if T_camera_lidar is None else {"T_camera_lidar": T_camera_lidar.tolist()}),
    }


def _with_odometry(recording: Recording, path: Path) -> Recording:
    """Estimate the motion from the sweeps of all frames, or compare it with the stated one.

    Frames without poses are left out.
    """
    if converted := [frame.name for frame in recording.frames if isinstance(frame.points, Conversion)]:
        raise InputError(
            f"--odometry: found a converted cloud in frame {converted[0]!r}, expected sweeps as recorded"
        )
    drive = validate(Drive, _document(recording, path), UNWRITTEN)
    drive._path = path
    # The folder of the drive need not exist yet.
    frames = [
        frame.model_copy(update={"points": str(Path(str(source.points)).absolute())})
        for source, frame in zip(recording.frames, drive.frames, strict=True)
    ]
    motion = drive_motion(drive.model_copy(update={"frames": tuple(frames)}))
    if recording.poses is not None:
        moments_ns = [round((frame.image_stamp or 0.0) * NS) for frame in drive.frames]
        difference = compare_motions(recording.poses, motion.poses, moments_ns)
        remark = "the motion of the data set could not be compared with that of the sweeps"
        if difference is not None:
            remark = difference.describe("the motion of the data set")
        return replace(recording, remarks=(*recording.remarks, remark))
    uncovered = set(motion.uncovered)
    covered = [
        source
        for source, frame in zip(recording.frames, frames, strict=True)
        if frame.points not in uncovered
    ]
    if not covered:
        raise InputError(
            f"--odometry: found no frame with poses around it, needed {counted(3, 'consecutive sweep')}"
        )
    remark = f"{odometry_remark()}; the drive uses it"
    block = {"point_times": motion.point_times, "sigma": SIGMA}
    with_motion = with_poses(recording, covered, motion.poses, block, remark)
    return replace(with_motion, remarks=(*with_motion.remarks, *motion.assumption))


def _poses_file(path: Path) -> str:
    """Name the file of the poses, relative to the drive; it belongs to this drive alone."""
    return f"poses/{path.stem}.txt"


def _frame_document(frame: SourceFrame, folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = {}
    if isinstance(frame.points, Conversion):
        copies = dict(zip(("points", "point_labels"), _copies(frame.name), strict=True))
        document = copies if frame.points.has_labels else {"points": copies["points"]}
    for key in ("points", "point_labels", "image_labels", "image"):
        path = getattr(frame, key)
        if isinstance(path, Path):
            document[key] = _relative(path, folder)
    stamps = {"points_stamp": frame.points_stamp, "image_stamp": frame.image_stamp}
    return document | {key: float(stamp) for key, stamp in stamps.items() if stamp is not None}


def _class_blocks(recording: Recording) -> dict[str, Any]:
    """Make the `ignore:`, `classes:` and `palette:` blocks."""
    sides: dict[str, Ontology | None] = {"points": recording.point_classes, "image": recording.image_classes}
    label_image = next((f.image_labels for f in recording.frames if f.image_labels), None)
    palette = None
    if label_image and holds_colors(label_image):
        palette = recording.image_classes.palette() if recording.image_classes else {}
        if not palette:
            raise InputError(
                f"{label_image}: found colours, expected ids, or a class table with these colours with --image-classes"
            )
        del sides["image"]
    blocks: dict[str, Any] = {}
    if tables := {side: table for side, table in sides.items() if table}:
        blocks["ignore"] = {side: list(table.ignore) for side, table in tables.items()}
        blocks["classes"] = {side: table.ids() for side, table in tables.items()}
    return blocks | ({"palette": palette} if palette else {})


def _point_keys(form: PointForm) -> dict[str, Any]:
    """Make the keys of clouds whose columns or times are not the usual ones."""
    columns, unit = form.point_columns, form.time_unit
    return {
        **({} if columns is None else {"point_columns": list(columns), "point_type": form.point_type}),
        **({} if unit is None else {"time_unit": unit}),
    }


def _reference(recording: Recording) -> Pose | None:
    """Choose the transform of the recording, or the mean of its frames' transforms."""
    poses = _frame_poses(recording.frames)
    if not poses:
        return recording.T_camera_lidar
    where = "T_camera_lidar, the mean over the frames"
    return rigid(where, nearest_rigid(np.mean(poses, axis=0)), MAX_TRANSLATION_M)


def _motion_remarks(frames: Sequence[SourceFrame]) -> list[str]:
    """Describe how far the transforms of the frames are from their mean."""
    poses = _frame_poses(frames)
    if len(poses) < 2:
        return []
    mean = nearest_rigid(np.mean(poses, axis=0))
    distance_m = max(float(np.linalg.norm(camera_center(T) - camera_center(mean))) for T in poses)
    angle_deg = max(rotation_error_deg(T, mean) for T in poses)
    return [
        "the rig moves between sweep and image: T_camera_lidar is the mean over the frames, "
        f"from which they differ by up to {distance_m:.2f} m and {angle_deg:.2f} deg"
    ]


def _frame_poses(frames: Sequence[SourceFrame]) -> list[Pose]:
    return [frame.T_camera_lidar for frame in frames if frame.T_camera_lidar is not None]


def _write_converted(frame: SourceFrame, folder: Path, write: Callable[[bytes, Path], None]) -> bool:
    """Write the converted cloud of a frame if it needs one; return whether the frame has points."""
    if not isinstance(frame.points, Conversion):
        return True
    cloud = frame.points.cloud()
    if not len(cloud.points):
        return False
    file, shape = frame.points.file, np.shape(cloud.points)
    if len(shape) != 2 or shape[1] != 4:
        raise InputError(f"{file}: frame {frame.name!r}: found points of shape {shape}, needed (N, 4)")
    points, labels = (folder / copy for copy in _copies(frame.name))
    if frame.points.has_labels:
        if cloud.labels is None or cloud.labels.shape != shape[:1]:
            description = "no labels" if cloud.labels is None else f"labels of shape {cloud.labels.shape}"
            raise InputError(
                f"{file}: frame {frame.name!r}: found {description}, expected one label per point"
            )
        write(cloud.labels.astype("<u4").tobytes(), labels)
    write(cloud.points.astype("<f4").tobytes(), points)
    return True


def _copies(name: str) -> tuple[str, str]:
    """Name the files of a frame's converted cloud and of its labels, which stay in the drive's folder.

    Raises:
        InputError: the name of the frame leads to another folder.
    """
    if Path(name).name != name:
        raise InputError(f"frame {name!r}: found the name of no file, expected one for its converted cloud")
    return f"points/{name}.bin", f"point_labels/{name}.label"


def _relative(path: Path, folder: Path) -> str:
    """Name a file relative to the drive's real folder, or absolutely if it is on another Windows drive."""
    real = Path(os.path.realpath(need_file(path).parent)) / path.name
    with suppress(ValueError):
        real = Path(os.path.relpath(real, os.path.realpath(folder)))
    return writable_name(path, real.as_posix())
