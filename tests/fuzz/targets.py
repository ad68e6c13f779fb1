"""The documents that semcal reads, each with a check of what reading any bytes as this document may do.

A reader either gives a valid value or refuses the document by an `InputError` of one line that names the file. All else
is a finding: another exception, a warning, or a value that does not keep what it promises.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from dataset_trees import KITTI_360_DRIVE, KITTI_RAW_DRIVE, TREES
from stranger_targets import (
    check_answers,
    check_image_file,
    check_metadata,
    check_recording,
    write_recording_folder,
)

from semcal_cli.config import Limits
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.documents import document_text, output_format, parse_document
from semcal_cli.files.validation import StrictModel, validate
from semcal_cli.fleet.combination import combine_drives
from semcal_cli.fleet.fleet_drives import read_fleet_drives
from semcal_cli.formats import FORMATS, read_extrinsic, read_transform, write_transform
from semcal_cli.formats.camera_block import read_intrinsics
from semcal_cli.formats.format import Format, FormatOptions
from semcal_cli.geometry.arrays import Pose
from semcal_cli.importing import read_dataset
from semcal_cli.importing.kitti_360_windows import read_vertices
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.importing.recording import Request
from semcal_cli.labelling.card import read_card, read_classes
from semcal_cli.many.batch.records import SIGNED, read_outcome, write_summary
from semcal_cli.many.batch.tasks import Task, describe_result, find_drives
from semcal_cli.many.rig.rig_document import find_rig, read_rig
from semcal_cli.observations.motion import compensated
from semcal_cli.result.calibration_document import read_calibration

RIGID = 1e-9
"""Largest error of the rotation of a transform that was read."""
SAME_ROTATION, SAME_M = 1e-7, 1e-2
"""Largest difference of a transform that was written and read again. Angles lose half of their digits close to a pitch
of 90 degrees, and the arm may be as long as 100 km."""
OF_DRIVES = "expected each drive once"
"""End of the messages that name two drives of a fleet and no file."""
VERSION = b"VERSION"
"""Text in a stored record that stands for the version of semcal, which a record must name."""

RESULT = b"result\n"
"""Result that a stored record names."""


@dataclass(frozen=True)
class Target:
    """A document and the check of its reader."""

    read: Callable[[Path], object]
    """Reads the document at a path, and checks what it gives."""
    name: Callable[[bytes], str]
    """File name for a content."""
    prepare: Callable[[Path], object] = lambda folder: None
    """Writes what else the reader needs into the document's folder, once."""
    share: float = 1.0
    """Share of the runs of all documents: a reader may take longer."""
    max_bytes: int = 4096
    """Size of the largest content: short documents say all that long ones do."""


def check(target: Target, content: bytes, folder: Path) -> None:
    """Read a content as a document in a folder that `prepare` has seen, and check all that must hold."""
    path = folder / target.name(content)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    with warnings.catch_warnings(), refusing(folder):
        warnings.simplefilter("error")
        target.read(path)


@contextmanager
def refusing(folder: Path | None) -> Iterator[None]:
    """Accept that something is refused, in a line that names a file in the folder; None: of options, not of a file."""
    try:
        yield
    except InputError as error:
        line = str(error)
        assert line.isprintable(), f"a message that is no line of text: {line!r}"
        is_named = folder is None or str(folder) in line or line.endswith(OF_DRIVES)
        assert is_named, f"a message that names no file: {line!r}"
        assert len(line) < 2000, f"a message of {len(line)} characters"


def document_name(stem: str) -> Callable[[bytes], str]:
    """Name what begins as JSON does a JSON file, all else a YAML file."""
    return lambda content: f"{stem}.json" if content.startswith((b"{", b"[")) else f"{stem}.yaml"


def check_pose(T: Pose) -> None:
    """Check that a transform is finite and rigid."""
    assert T.shape == (4, 4)
    assert np.isfinite(T).all(), T
    assert np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() <= RIGID, T
    assert np.linalg.det(T[:3, :3]) > 0.0, T
    assert T[3].tolist() == [0.0, 0.0, 0.0, 1.0], T


def check_same(found: Pose, wanted: Pose) -> None:
    """Check that a transform that was written is read again."""
    off = np.abs(found - wanted)
    assert off[:3, :3].max() <= SAME_ROTATION, (found, wanted)
    assert off[:3, 3].max() <= SAME_M, (found, wanted)


def check_written_again(model: StrictModel, path: Path) -> None:
    """Check that a document that was read is written, and read again as the same."""
    format = output_format(path)
    text = document_text(model.model_dump(), format)
    again = validate(type(model), parse_document(text, path), path)
    assert document_text(again.model_dump(), format) == text


def check_drive(path: Path) -> None:
    """Check a drive."""
    drive = read_drive(path)
    check_written_again(drive, path)
    assert all(drive.files())
    if drive.T_camera_lidar is not None:
        check_pose(np.array(drive.T_camera_lidar))
    core_camera(drive.camera)


def check_rig(path: Path) -> None:
    """Check a rig."""
    with refusing(path.parent):
        find_rig(path)
    rig = read_rig(path)
    check_written_again(rig, path)
    for a in rig.cameras:
        for b in rig.cameras:
            if (T := rig.reference(a, b)) is not None:
                check_pose(T)


def check_calibration(path: Path) -> None:
    """Check a calibration, as a result, as a transform and as a drive of a fleet."""
    calibration = read_calibration(path)
    check_pose(calibration.pose)
    check_pose(read_transform(path))
    check_written_again(calibration, path)
    widths = read_extrinsic(path).half_widths
    assert widths is None or np.isfinite(widths).all()
    core_camera(calibration.input.camera)
    read_fleet_drives([path])


def check_fleet(path: Path) -> None:
    """Check the result of a fleet, which is read as a transform with its intervals."""
    check_pose(read_transform(path))
    widths = read_extrinsic(path).half_widths
    assert widths is None or np.isfinite(widths).all()


def check_summary(path: Path) -> None:
    """Check the summary of a batch, which a fleet reads."""
    drives = read_fleet_drives([path.parent])
    for drive in drives:
        if drive.T_camera_lidar is not None:
            check_pose(drive.T_camera_lidar)
        if drive.covariance is not None:
            assert np.linalg.eigvalsh(drive.covariance).min() > 0.0
    with suppress(CalibrationError):
        check_pose(combine_drives(drives, Limits()).T_camera_lidar)


def write_result(folder: Path) -> None:
    """Write a result, which a record names by its hash."""
    (folder / "calibration.yaml").write_bytes(RESULT)


def task_of(folder: Path) -> Task:
    """Make the task whose record lies in a folder."""
    return Task("drive", "drive", str(folder), "calibrate")


def check_record(path: Path) -> None:
    """Check the record of a batch's drive, with the hash of itself that it needs: its outcome goes into the summary."""
    task = task_of(path.parent)
    assert read_outcome(task) is None, "an outcome of a record without its hash"
    body = path.read_bytes().rstrip().replace(VERSION, version("semcal").encode())
    digest = hashlib.sha256(body).hexdigest()
    path.write_bytes(body[:-1] + f'{SIGNED}{digest}"}}\n'.encode())
    outcome = read_outcome(task)
    if outcome is not None:
        write_summary([outcome], path.parent)
        if outcome.T_camera_lidar is not None:
            check_pose(np.array(outcome.T_camera_lidar))


def check_verification(path: Path) -> None:
    """Check the result of `verify`, whose outcome goes into the summary of a batch."""
    task = Task("drive", str(path.parent), str(path.parent), "verify")
    outcome = describe_result(task, 0)
    write_summary([outcome], path.parent)


def check_poses(path: Path) -> None:
    """Check a drive's poses in TUM's format."""
    camera = Camera(model="plumb_bob", width=8, height=8, K=((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)))
    drive = Drive.model_validate(
        {
            "semcal_drive": 1,
            "camera": camera,
            "frames": [{"points": "a.bin"}],
            "motion": Motion(poses=path.name),
        }
    )
    drive._path = path.with_name("drive.yaml")
    compensated(drive.model_copy(update={"frames": ()}), [])


def check_intrinsics(path: Path) -> None:
    """Check intrinsics, of the only camera or of one of several, with the model of the file or another one."""
    for camera, model in ((None, None), ("cam1", None), (None, "fisheye")):
        with refusing(None if model else path.parent):
            block = read_intrinsics(path, camera, model)
            core_camera(Camera.model_validate(block))


def check_ontology(path: Path) -> None:
    """Check a table of classes."""
    ontology = read_ontology(str(path))
    check_written_again(ontology, path)
    with refusing(None):
        ontology.in_red()


def check_card(path: Path) -> None:
    """Check a model card."""
    card = read_card(path)
    read_classes(card, path)
    check_written_again(card, path)


def check_list(path: Path) -> None:
    """Check a list of drives; patterns that leave the folder are not tried, since they could walk the whole disk."""
    text = path.read_bytes()
    if any(character in text for character in b"*?["):
        return
    for drive in find_drives([str(path)], None):
        assert drive


OPTIONS: dict[str, tuple[FormatOptions, ...]] = {
    "autoware": (
        FormatOptions(camera="camera0/camera_link"),
        FormatOptions(camera="camera1/camera_optical_link", lidar="velodyne_top_base_link"),
    ),
    "nuscenes": (FormatOptions(camera="a", lidar="b"),),
    "kalibr": (FormatOptions(), FormatOptions(camera="cam0")),
    "lidar2cam": (FormatOptions(camera="CAM_FRONT"),),
    "colmap": (FormatOptions(), FormatOptions(camera="right/")),
    "kitti-odometry": (FormatOptions(), FormatOptions(camera="P2")),
    "kitti-raw": (FormatOptions(), FormatOptions(camera="image_02")),
    "kitti-object": (FormatOptions(), FormatOptions(camera="P2")),
    "ros2-launch": (FormatOptions(lidar="l"), FormatOptions(frame="body")),
    "urdf": (
        FormatOptions(frame="body"),
        FormatOptions(camera="camera_link", lidar="velodyne", frame="body"),
    ),
}
"""Options with which files of a format are read."""
REPAIR = FormatOptions(on_repair=lambda line: None)


def options_of(format: Format) -> tuple[FormatOptions, ...]:
    """List options with which files of a format are read."""
    if format.name in OPTIONS:
        return OPTIONS[format.name]
    if format.asks == ("direction",):
        return FormatOptions(direction="lidar-to-camera"), FormatOptions(direction="camera-to-lidar")
    if "frame" in format.asks:
        return FormatOptions(), FormatOptions(frame="body")
    return (FormatOptions(), REPAIR)


def check_transform(format: Format, path: Path) -> None:
    """Check a transform: recognised, and read as its format with all options; then written."""
    with refusing(path.parent):
        check_pose(read_transform(path))
    for options in options_of(format):
        with refusing(path.parent):
            T = read_transform(path, format.name, options)
            check_pose(T)
            _check_written(format, T, options, path)


def _check_written(format: Format, T: Pose, options: FormatOptions, path: Path) -> None:
    with refusing(None):
        content = write_transform(T, None, format.name, options)
        again = path.with_name(document_name("again")(content))
        again.write_bytes(content)
        check_same(read_transform(again, format.name, options), T)


def transform_target(format: Format) -> Target:
    """Make the target of a format of transforms."""
    name = {"kitti-360": lambda content: "calib_cam_to_velo.txt"}.get(format.name, document_name("transform"))
    return Target(lambda path: check_transform(format, path), name)


def write_drive(folder: Path) -> None:
    camera = {"model": "plumb_bob", "width": 8, "height": 8, "K": [[4, 0, 4], [0, 4, 4], [0, 0, 1]]}
    document = {"semcal_drive": 1, "camera": camera, "frames": [{"points": "a.bin", "points_stamp": 1.5}]}
    (folder / "drive.yaml").write_text(json.dumps(document))


IMPORTS: dict[str, tuple[str, str, dict[str, str]]] = {
    "carla": ("carla", "sensors.json", {"version": "0.9.15"}),
    "kitti-360": ("kitti-360", "calibration/perspective.txt", {"camera": "image_01"}),
    "kitti-360-poses": ("kitti-360", f"data_poses/{KITTI_360_DRIVE}/poses.txt", {}),
    "kitti-odometry": ("kitti-odometry", "sequences/00/calib.txt", {}),
    "kitti-odometry-poses": ("kitti-odometry", "poses/00.txt", {}),
    "kitti-raw": ("kitti-raw", "2011_09_26/calib_cam_to_cam.txt", {}),
    "kitti-raw-stamps": ("kitti-raw", f"{KITTI_RAW_DRIVE}/image_02/timestamps.txt", {}),
    "nuscenes": ("nuscenes", "v1.0-mini/calibrated_sensor.json", {}),
    "nuscenes-files": ("nuscenes", "v1.0-mini/sample_data.json", {}),
    "opencalib": ("opencalib", "1/calib.txt", {"sequence": "1"}),
}
"""Files of data sets: the data set, the file in its tree, and what is asked of it."""


def import_target(dataset: str, file: str, asked: dict[str, str]) -> Target:
    """Make the target of a file in the tree of a data set."""

    def read(path: Path) -> None:
        recording = read_dataset(dataset, Request(path.parents[file.count("/")], **asked))
        core_camera(Camera.model_validate(recording.camera))
        for T in (recording.T_camera_lidar, *(frame.T_camera_lidar for frame in recording.frames)):
            if T is not None:
                check_pose(T)

    return Target(read, lambda content: file, TREES[dataset])


TARGETS: dict[str, Target] = {
    "drive": Target(check_drive, document_name("drive")),
    "rig": Target(check_rig, document_name("rig")),
    "calibration": Target(check_calibration, document_name("calibration")),
    "fleet": Target(check_fleet, document_name("fleet")),
    "summary": Target(check_summary, lambda content: "summary.jsonl"),
    "record": Target(check_record, lambda content: "record.json", write_result),
    "verification": Target(check_verification, lambda content: "verification.json", write_drive),
    "poses": Target(check_poses, lambda content: "poses.txt"),
    "intrinsics": Target(check_intrinsics, document_name("camera")),
    "ontology": Target(check_ontology, document_name("classes")),
    "card": Target(check_card, document_name("card")),
    "list": Target(check_list, lambda content: "drives.txt"),
    "ply": Target(read_vertices, lambda content: "points.ply"),
    **{f"transform-{format.name}": transform_target(format) for format in FORMATS if format.has_transform},
    **{f"import-{name}": import_target(*asked) for name, asked in IMPORTS.items()},
    **{
        f"recording-{name}": Target(
            check_recording, lambda content, file=file: file, share=0.3, max_bytes=16384
        )
        for name, file in {"mcap": "a.mcap", "ros1": "a.bag", "sqlite": "a.db3"}.items()
    },
    "recording-metadata": Target(check_metadata, lambda content: "metadata.yaml", write_recording_folder),
    "image": Target(check_image_file, lambda content: "image.png"),
    "answers": Target(check_answers, lambda content: "answers.json"),
}
"""Every document that is read, by name."""
