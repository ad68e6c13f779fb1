"""Zenseact Open Dataset: ROOT/sequences/000000 and ROOT/drives/000000 (zod, data_classes/ and utils/).

Files are named after their times in UTC. Sweeps are as measured: the times of points count from that of their file, in
microseconds. Poses map the vehicle to a fixed frame, extrinsics each sensor to the vehicle:
T_camera_lidar = inv(T_ego_camera) T_ego_lidar. The lens is that of Kannala and Brandt.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.config.nanoseconds import NS
from semcal_cli.config.point_files import PointForm
from semcal_cli.errors import InputError
from semcal_cli.files.documents import parse_document, read_document
from semcal_cli.files.input_files import read_text
from semcal_cli.formats.node import (
    MAX_MOUNT_M,
    MAX_STAMP_S,
    MAX_WORLD_M,
    Node,
    checked_camera_block,
    image_side,
    number,
    pick,
)
from semcal_cli.formats.pose import from_rows
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing.dataset_tree import files_by_stem, folders
from semcal_cli.importing.file_pairing import by_time, pairs, stamps_s
from semcal_cli.importing.recording import Recording, Request, SourceFrame, with_trajectory

KINDS = ("sequences", "drives")
"""Folders of what has a course of time. The frames in single_frames have one image each, and a calibration each."""
CAMERA_FOLDER = "camera_"
DEFAULT_CAMERA = "front_blur"
MAX_GAP_S = 0.05
"""Longest time between a sweep and its image: half the time between two sweeps."""
SWEEP_S = 0.1
"""Duration of a sweep."""
MOTION = "ego_motion.json"


def read(request: Request) -> Recording:
    """Zenseact Open Dataset: ROOT/sequences/000000 or ROOT/drives/000000; by default front_blur.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no sweep has an image and poses.
    """
    root = request.root
    names = [f"{kind}/{name}" for kind in KINDS if (root / kind).is_dir() for name in folders(root / kind)]
    folder = root / pick(
        "sequence", request.sequence, names, root, expected="folders such as sequences/000000"
    )
    cameras = [name.removeprefix(CAMERA_FOLDER) for name in folders(folder) if name.startswith(CAMERA_FOLDER)]
    camera = pick("camera", request.camera, cameras, folder, default=DEFAULT_CAMERA)
    calibration = Node(str(folder / "calibration.json"), read_document(folder / "calibration.json")).at("FC")
    T_ego_lidar, T_ego_camera = (_pose(calibration.at(key)) for key in ("lidar_extrinsics", "extrinsics"))
    poses = {stamp_ns: T @ T_ego_lidar for stamp_ns, T in _read_poses(folder / MOTION).items()}
    recording = Recording(
        camera=_camera(calibration),
        frames=_find_frames(folder, camera),
        T_camera_lidar=inverse(T_ego_camera) @ T_ego_lidar,
        point_form=PointForm(time_unit="us"),
        synchronization="stamps",
    )
    return with_trajectory(recording, poses, folder / MOTION, point_times="relative", sweep_s=SWEEP_S)


def _pose(node: Node, farthest_m: float = MAX_MOUNT_M) -> Pose:
    """Read T_ego_sensor or T_world_ego (4, 4), metres."""
    rows = node.rows(4)
    if len(rows) != 4:
        raise node.mismatch("4 rows of 4 numbers")
    return from_rows(node.where, rows, farthest_m=farthest_m)


def _read_poses(path: Path) -> dict[int, Pose]:
    """Read T_world_ego (4, 4) by their Unix times in nanoseconds, ascending, metres."""
    motion = Node(str(path), parse_document(read_text(path, limit=MAX_TABLE_BYTES), path))
    stamps, poses = motion.at("timestamps"), motion.at("poses")
    if not isinstance(poses.value, list) or len(poses.value) != len(stamps.numbers()):
        raise poses.mismatch(f"{len(stamps.numbers()):,} poses, one for each of the timestamps")
    by_stamp = {
        round(number(stamps.where, stamp, 0.0, MAX_STAMP_S) * NS): _pose(poses.child(index, T), MAX_WORLD_M)
        for index, (stamp, T) in enumerate(zip(stamps.numbers(), poses.value, strict=True))
    }
    return {stamp_ns: by_stamp[stamp_ns] for stamp_ns in sorted(by_stamp)}


def _camera(calibration: Node) -> dict[str, Any]:
    """Make the camera block of the images as they are, which are not undistorted."""
    size = calibration.at("image_dimensions")
    width, height = (image_side(size.where, pixels) for pixels in size.numbers(2))
    block = {
        "model": "fisheye",
        "width": width,
        "height": height,
        "K": [row[:3] for row in calibration.at("intrinsics").rows(3, 4)],
        "distortion": calibration.at("distortion").numbers(4),
    }
    keys = {"K": "FC.intrinsics", "distortion": "FC.distortion"}
    return checked_camera_block(calibration.file, block, keys)


def _find_frames(folder: Path, camera: str) -> list[SourceFrame]:
    """Pair sweeps and images that are nearest to one another in time."""
    sweeps, images = (
        [*files_by_stem(folder / name, suffix).values()]
        for name, suffix in (("lidar_velodyne", ".npy"), (f"{CAMERA_FOLDER}{camera}", ".jpg"))
    )
    if not (sweeps and images and by_time(sweeps, images)):
        raise InputError(f"{folder}: expected sweeps and images of {camera}, all with a time in their names")
    if not (paired := pairs(sweeps, images, MAX_GAP_S)):
        raise InputError(f"{folder}: found no sweep with an image of {camera} within {MAX_GAP_S} s")
    stamps = stamps_s([*sweeps, *images])
    return [
        SourceFrame(
            name=sweep.stem,
            points=sweep,
            image=image,
            points_stamp=stamps[sweep],
            image_stamp=stamps[image],
        )
        for sweep, image in paired.items()
    ]
