"""KITTI odometry, SemanticKITTI, KITTI object and KITTI raw, and the cameras of their calibration files.

Geiger, Lenz, Stiller, Urtasun, *Vision meets Robotics: The KITTI Dataset*, 2013, eqs. 3 to 8: a LiDAR point projects to
`P_k R_rect T_camera0_lidar p` with `P_k = K [I | inv(K) P_k[:, 3]]`.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.config.synchronization import Synchronization
from semcal_cli.errors import InputError, listed
from semcal_cli.files.input_files import is_folder, read_text
from semcal_cli.formats.kitti_files import (
    OBJECT_KEY,
    ODOMETRY_KEY,
    camera0_pose,
    offset_from_camera0,
    raw_pose,
    read_keyed,
)
from semcal_cli.formats.node import Node, checked_camera_block, image_side, pick, stamp_s
from semcal_cli.geometry.arrays import Pose, TwistVector
from semcal_cli.geometry.twists import adjoint
from semcal_cli.importing.dataset_tree import (
    KITTI_PERIOD_S,
    files_by_stem,
    folders,
    image_size,
    numbered_files,
    read_number_rows,
    read_speeds,
)
from semcal_cli.importing.joined_sequences import clock_shifts_s, later
from semcal_cli.importing.kitti_motion import (
    MOMENT_SIGMA_S,
    SPIN,
    imu_in_lidar,
    poses_along,
    read_packet,
    triggered,
    with_motion,
)
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.importing.recording import Recording, Request, SourceFrame, join_frames

LIDAR = {"channels": 64, "columns": 2048, "fov_up_deg": 3.0, "fov_down_deg": -25.0}
"""Scan pattern of the Velodyne HDL-64E at 10 turns per second."""
SPINNING = LIDAR | {"spin": SPIN}
"""The same for sweeps that are skewed; those of KITTI odometry are deskewed."""
SYNCHRONIZATION: Synchronization = "hardware"
"""The Velodyne triggers the cameras when it faces forward (Geiger et al., *Vision meets Robotics*, IJRR 2013)."""
IMAGES = (".png", ".jpg")
MISSING = "{}: found no frame with a sweep in velodyne and an image in {}"


def read_odometry(request: Request, *, has_labels: bool = False) -> Recording:
    """Find the frames of velodyne, image_2, calib.txt and times.txt in ROOT/sequences/00, and ROOT/poses/00.txt.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no frame is complete.
    """
    sequences = request.root / "sequences"
    folder = sequences / pick("sequence", request.sequence, folders(sequences), sequences)
    camera = _camera(folder, request)
    # One line per frame; the sweep triggers the image when it faces forward.
    stamps = {
        i: stamp_s(where, float(row[0]))
        for i, (where, row) in enumerate(read_number_rows(folder / "times.txt", 1))
    }
    frames = join_frames(
        numbered_files(folder / "velodyne", ".bin"),
        point_labels=files_by_stem(folder / "labels", ".label") if has_labels else {},
        image=files_by_stem(folder / camera, *IMAGES),
        points_stamp=stamps,
        image_stamp=stamps,
        speed_mps=dict(enumerate(read_speeds(request.root / f"poses/{folder.name}.txt"))),
        missing=MISSING.format(folder, camera),
    )
    return _recording(folder / "calib.txt", camera, frames, LIDAR)


def read_semantickitti(request: Request) -> Recording:
    """Find the frames of KITTI odometry, with point labels in ROOT/sequences/00/labels (www.semantic-kitti.org).

    A label has 32 bits: the class in the lower 16, the instance in the upper 16.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no frame is complete.
    """
    return replace(read_odometry(request, has_labels=True), point_classes=read_ontology("semantickitti"))


def read_object(request: Request) -> Recording:
    """Find frames of velodyne, image_2 and calib in ROOT/training or ROOT itself; one calib.txt may serve all.

    Frames come from many drives, in random order. Those with identical calibration files come from one rig on one day
    and form one drive. The sequence is the name of a frame with the wanted calibration; without one, the calibration
    that most frames share is used.

    Raises:
        InputError: the frame, the camera or a file is missing or wrong, or no frame is complete.
    """
    folder = request.root / "training" if is_folder(request.root / "training") else request.root
    camera = _camera(folder, request)
    clouds, images = numbered_files(folder / "velodyne", ".bin"), files_by_stem(folder / camera, *IMAGES)
    frames = {
        frame.name: frame
        for frame in join_frames(clouds, image=images, missing=MISSING.format(folder, camera))
    }
    has_own = is_folder(folder / "calib")
    files = {name: folder / (f"calib/{name}.txt" if has_own else "calib.txt") for name in frames}
    groups = defaultdict[str, list[str]](list)
    for name, file in files.items():
        groups[read_text(file)].append(name)
    group = max(groups.values(), key=len)
    if request.sequence is not None:
        name = pick("sequence", request.sequence, list(frames), folder)
        group = next(names for names in groups.values() if name in names)
    recording = _recording(files[group[0]], camera, [frames[name] for name in group], SPINNING)
    recording = triggered(recording, MOMENT_SIGMA_S)
    others = [f"{names[0]} ({len(names):,})" for names in groups.values() if names is not group]
    if not others:
        return recording
    remark = (
        f"the {len(group):,} frames with the calibration of {group[0]} are used; --sequence FRAME selects others: "
        f"{listed(others)}"
    )
    return replace(recording, remarks=(remark,))


def _camera(folder: Path, request: Request) -> str:
    cameras = [name for name in folders(folder) if re.fullmatch("image_[0-9]+", name)]
    return pick("camera", request.camera, cameras, folder, default="image_2")


def _recording(file: Path, camera: str, frames: list[SourceFrame], lidar: Mapping[str, Any]) -> Recording:
    image = frames[0].image
    assert image is not None
    block, T_camera_lidar = calibration(file, int(camera.removeprefix("image_")), *image_size(image))
    return Recording(
        camera=block,
        lidar=lidar,
        frames=frames,
        T_camera_lidar=T_camera_lidar,
        synchronization=SYNCHRONIZATION,
    )


def read_raw(request: Request) -> Recording:
    """Find the synchronised, rectified frames of ROOT/2011_09_26/2011_09_26_drive_0001_sync.

    The sequence may also be a day, such as 2011_09_26, for all its drives: they have one calibration.

    Raises:
        InputError: the drive, the camera or a file is missing or wrong, or no frame is complete.
    """
    drives = sorted(path.parent for path in request.root.glob("*/*_sync/velodyne_points"))
    days = {
        folder.parent.name: [drive for drive in drives if drive.parent == folder.parent] for folder in drives
    }
    choices = {drive.name: [drive] for drive in drives}
    choices |= {day: drives_of_day for day, drives_of_day in days.items() if len(drives_of_day) > 1}
    chosen = choices[
        pick(
            "sequence",
            request.sequence,
            list(choices),
            request.root,
            expected="2011_09_26/2011_09_26_drive_0001_sync/velodyne_points in ROOT",
        )
    ]
    day = request.root / chosen[0].name[: len("2011_09_26")]
    cameras = [name for name in folders(chosen[0]) if name.startswith("image_")]
    camera = pick("camera", request.camera, cameras, chosen[0], default="image_02")
    frames, twists_imu = list[SourceFrame](), list[tuple[float, TwistVector]]()
    drives_of_day = [_raw_frames(folder, camera) for folder in chosen]
    # Drives without timestamps all begin at 0 s.
    shifts_s = clock_shifts_s(
        [
            [frame.points_stamp for frame in drive_frames if frame.points_stamp is not None]
            for drive_frames, _ in drives_of_day
        ]
    )
    for (drive_frames, drive_twists), shift_s in zip(drives_of_day, shifts_s, strict=True):
        frames += [replace(frame, points_stamp=later(frame.points_stamp, shift_s)) for frame in drive_frames]
        twists_imu += [(stamp_s + shift_s, twist) for stamp_s, twist in drive_twists]
    velo, lines = (read_keyed(day / f"calib_{name}_to_cam.txt") for name in ("velo", "cam"))
    number = camera.removeprefix("image_")
    recording = Recording(
        camera=pinhole(lines.at(f"P_rect_{number}"), *image_sides(lines.at(f"S_rect_{number}"))),
        lidar=SPINNING,
        frames=frames,
        T_camera_lidar=raw_pose(velo, lines, camera),
        synchronization=SYNCHRONIZATION,
    )
    recording = triggered(recording, MOMENT_SIGMA_S)
    if not twists_imu:
        return recording
    T_lidar_imu, remarks = imu_in_lidar(day)
    stamps_s, twists = zip(*twists_imu, strict=True)
    poses = poses_along(stamps_s, [adjoint(T_lidar_imu) @ twist for twist in twists])
    return with_motion(replace(recording, remarks=remarks), poses, "oxts")


def _raw_frames(folder: Path, camera: str) -> tuple[list[SourceFrame], list[tuple[float, TwistVector]]]:
    """Find the frames of a drive, and the stamps and twists of its inertial unit at its sweeps.

    Without timestamps, the first sweep is at 0 s.
    """
    clouds = numbered_files(folder / "velodyne_points/data", ".bin")
    files = files_by_stem(folder / "oxts/data", ".txt", is_needed=False)
    twists = {name: read_packet(files[name]) for name in clouds if name in files}
    recorded = read_stamps(folder / "velodyne_points/timestamps.txt")
    stamps = {name: recorded[int(name)] for name in clouds if int(name) in recorded}
    if not recorded:
        first = int(next(iter(clouds), 0))
        stamps = {name: round(KITTI_PERIOD_S * (int(name) - first), 9) for name in clouds}
    frames = join_frames(
        clouds,
        image=files_by_stem(folder / camera / "data", *IMAGES),
        points_stamp=stamps,
        image_stamp=read_stamps(folder / camera / "timestamps.txt"),
        speed_mps={name: float(np.linalg.norm(twist[:3])) for name, twist in twists.items()},
        missing=f"{folder}: found no frame with a sweep and an image in {camera}",
    )
    return frames, [(stamps[name], twist) for name, twist in twists.items() if name in stamps]


def read_stamps(path: Path) -> dict[int, float]:
    """Read Unix seconds from a file with one UTC time per line, such as `2011-09-26 13:02:25.951199337`.

    Returns:
        Seconds by the index of the line, without empty lines; none if the file does not exist.

    Raises:
        InputError: a line is not a time.
    """
    stamps = {}
    for index, line in enumerate(read_text(path).splitlines() if path.exists() else []):
        if not line.strip():
            continue
        date_time, _, fraction = line.strip().partition(".")
        where = f"{path}: line {index + 1}"
        try:
            moment = datetime.strptime(date_time, "%Y-%m-%d %H:%M:%S").replace(tzinfo=timezone.utc)
            if fraction and not fraction.isdecimal():
                raise ValueError(fraction)
            seconds = moment.timestamp() + float(f"0.{fraction or 0}")
        except ValueError:
            raise InputError(
                f"{where}: found {line[:40]!r}, expected a time such as 2011-09-26 13:02:25.95"
            ) from None
        stamps[index] = stamp_s(where, seconds)
    return stamps


def calibration(path: Path, camera: int, width: int, height: int) -> tuple[dict[str, Any], Pose]:
    """Read a calib.txt of KITTI odometry (`Tr`), or of KITTI object (`R0_rect` and `Tr_velo_to_cam`).

    Args:
        path: The file.
        camera: Number k of the camera.
        width: Columns of its images.
        height: Rows of its images.

    Returns:
        The `camera:` block of camera k, and its T_camera_lidar (4, 4), metres.

    Raises:
        InputError: a key is missing or wrong.
    """
    lines = read_keyed(path)
    key = next((key for key in (ODOMETRY_KEY, OBJECT_KEY) if key in lines.mapping), None)
    if key is None:
        problem = f"found keys {listed(lines.mapping)}"
        raise InputError(f"{path}: {problem}, expected Tr, or R0_rect and Tr_velo_to_cam")
    T_camera0_lidar, projection = camera0_pose(lines, key), lines.at(f"P{camera}")
    return pinhole(projection, width, height), offset_from_camera0(projection) @ T_camera0_lidar


def pinhole(projection: Node, width: int, height: int) -> dict[str, Any]:
    """Make the camera block of a rectified camera from its projection matrix.

    Raises:
        InputError: the left 3 x 3 of the matrix is not an intrinsic matrix.
    """
    K = projection.matrix(3, 4)[:, :3]
    block = {"model": "plumb_bob", "width": width, "height": height, "K": K.tolist()}
    return checked_camera_block(projection.file, block, {"K": projection.key})


def raw_camera(lines: Node, camera: str) -> dict[str, Any]:
    """Read the camera block of a camera's raw images: K, D (k1 k2 p1 p2 k3) and S before rectification.

    Args:
        lines: The file.
        camera: Number of the camera, such as 00.

    Raises:
        InputError: a key is missing or wrong.
    """
    key, distortion = f"K_{camera}", f"D_{camera}"
    K = lines.at(key).matrix(3, 3)
    if not K[2].any():
        # KITTI-360's own perspective.txt prints the last row as 0 0 0.
        K[2, 2] = 1.0
    width, height = image_sides(lines.at(f"S_{camera}"))
    block = {"model": "plumb_bob", "width": width, "height": height, "K": K.tolist()}
    block["distortion"] = lines.at(distortion).numbers(5)
    return checked_camera_block(lines.file, block, {"K": key, "distortion": distortion})


def image_sides(sides: Node) -> tuple[int, int]:
    """Read the width and height of images, in pixels.

    Raises:
        InputError: the values are not whole numbers of pixels.
    """
    width, height = (image_side(sides.where, side) for side in sides.numbers(2))
    return width, height
