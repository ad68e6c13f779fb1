"""KITTI-360: accumulated points of ROOT/data_3d_semantics cut around each pose, or the raw sweeps.

calib_cam_to_velo.txt maps camera 0 to the LiDAR, calib_cam_to_pose.txt each camera to the vehicle, poses.txt the
vehicle to the world. T_camera_lidar of camera k is inv(T_pose_camera_k) T_pose_camera_0 inv(T_velo_camera_0), for its
raw images. The rectified images of the perspective pair are those of a camera that R_rect has turned, so R_rect is
applied last (autonomousvision/kitti360Scripts: kitti360scripts/helpers/project.py, devkits/commons/loadCalibration.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError
from semcal_cli.files.input_files import read_text
from semcal_cli.formats.camera_block import read_intrinsics
from semcal_cli.formats.kitti_files import read_keyed, unrectified_camera0_pose
from semcal_cli.formats.node import MAX_WORLD_M, pick
from semcal_cli.formats.pose import from_line, from_rows, rotation
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing import kitti
from semcal_cli.importing.dataset_tree import (
    KITTI_PERIOD_S,
    files_by_stem,
    folders,
    numbered_files,
    read_number_rows,
    speeds_mps,
)
from semcal_cli.importing.kitti_360_windows import Windows
from semcal_cli.importing.kitti_motion import MOMENT_360_SIGMA_S, triggered, with_motion
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.importing.recording import Recording, Request, SourceFrame, join_frames

DEFAULT_CAMERA = "image_00"
PERSPECTIVE = ("image_00", "image_01")
"""The pair that looks forward. Its rectified images are in data_rect, its raw images in data_rgb."""
FISHEYES = ("image_02", "image_03")
"""Cameras that look to the sides. Their images are always raw, in data_rgb."""
PARTS = ("train", "test")
MAX_FRAME = 10**9
ONTOLOGY = "kitti-360"
"""Name of the table of its classes."""
RAW_PAIR_REMARK = (
    "data_2d_semantics labels only rectified images: give labels of raw images with --image-labels"
)


def read(request: Request) -> Recording:
    """Find the frames of a drive, with labelled points from the accumulated windows if they exist.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no frame is complete.
    """
    root, sequence = request.root, _chosen_sequence(request)
    camera = pick("camera", request.camera, [*PERSPECTIVE, *FISHEYES], root, default=DEFAULT_CAMERA)
    rectified = _is_rectified(camera, request.rectified)
    block, T_camera_camera0 = _camera(root / "calibration", camera, rectified)
    to_velo = root / "calibration/calib_cam_to_velo.txt"
    T_camera0_lidar = unrectified_camera0_pose(to_velo, read_text(to_velo))
    is_raw_pair = camera in PERSPECTIVE and not rectified
    folder_name = f"{camera}/data_rgb" if is_raw_pair else camera
    fields = {
        "needs": ("image", "image_labels"),
        "missing": f"{root}: found no frame of {sequence} with points, a pose and an image of {folder_name}",
        **_images(root, sequence, camera, rectified),
    }
    without_frames = Recording(
        camera=block,
        frames=(),
        T_camera_lidar=T_camera_camera0 @ T_camera0_lidar,
        # Like KITTI, its drives (named `_sync`) have one image of each camera for every turn of the Velodyne.
        synchronization="hardware",
        remarks=(RAW_PAIR_REMARK,) if is_raw_pair else (),
        read=(_fisheye(root / "calibration", camera),),
    )
    poses_file = root / "data_poses" / sequence / "poses.txt"
    T_pose_lidar = _camera_to_pose(root / "calibration", DEFAULT_CAMERA) @ T_camera0_lidar
    folders_of_windows = (root / "data_3d_semantics" / part / sequence / "static" for part in PARTS)
    folder = next((folder for folder in folders_of_windows if folder.is_dir()), None)
    if folder is None:
        sweeps = root / "data_3d_raw" / sequence / "velodyne_points"
        return _with_raw_sweeps(without_frames, fields, sweeps, poses_file, T_pose_lidar)
    windows = Windows(folder, visible_only=camera in PERSPECTIVE)
    return _with_windows(without_frames, fields, windows, poses_file, T_pose_lidar)


def _with_raw_sweeps(
    recording: Recording, fields: Mapping[str, Any], sweeps: Path, poses_file: Path, T_pose_lidar: Pose
) -> Recording:
    """Add frames with the raw sweeps in a folder, and their motion if there are poses."""
    clouds = numbered_files(sweeps / "data", ".bin")
    stamps = kitti.read_stamps(sweeps / "timestamps.txt")
    if not stamps:
        stamps = {int(name): round(KITTI_PERIOD_S * int(name), 9) for name in clouds}
    frames = join_frames(clouds, points_stamp=stamps, **fields)
    recording = replace(_with_frames(recording, frames, "raw sweeps carry no labels"), lidar=kitti.SPINNING)
    recording = triggered(recording, MOMENT_360_SIGMA_S)
    if not poses_file.exists():
        return recording
    poses_lidar = {
        round(stamps[number] * NS): T_world_pose @ T_pose_lidar
        for number, T_world_pose in _read_poses(poses_file).items()
        if number in stamps
    }
    return with_motion(recording, poses_lidar, poses_file.name)


def _with_windows(
    recording: Recording, fields: Mapping[str, Any], windows: Windows, poses_file: Path, T_pose_lidar: Pose
) -> Recording:
    """Add frames with the labelled points that are cut around each pose."""
    poses = _read_poses(poses_file)
    cuts = {
        f"{number:010d}": windows.around(number, T_world_pose @ T_pose_lidar)
        for number, T_world_pose in poses.items()
        if number in windows
    }
    frames = join_frames(cuts, speed_mps=_speeds(poses), **fields)
    remark = f"raw sweeps carry no labels: points are cut from the accumulated ones in {windows.folder}"
    return replace(_with_frames(recording, frames, remark), point_classes=read_ontology(ONTOLOGY))


def _with_frames(recording: Recording, frames: Sequence[SourceFrame], remark: str) -> Recording:
    is_labelled = any(frame.image_labels for frame in frames)
    return replace(
        recording,
        frames=frames,
        image_classes=read_ontology(ONTOLOGY) if is_labelled else None,
        remarks=(remark, *recording.remarks),
    )


def _chosen_sequence(request: Request) -> str:
    root = request.root
    return pick(
        "sequence",
        request.sequence,
        sorted({*_sequences(root / "data_3d_raw"), *_sequences(root / "data_3d_semantics")}),
        root,
        expected="folders such as data_3d_raw/2013_05_28_drive_0000_sync in ROOT",
    )


def _sequences(folder: Path) -> list[str]:
    """List the drives in a folder and in its parts."""
    names = folders(folder) if folder.is_dir() else []
    inner = [name for part in PARTS if part in names for name in folders(folder / part)]
    return [name for name in names + inner if name.endswith("_sync")]


def _is_rectified(camera: str, rectified: bool | None) -> bool:
    """Decide whether the images are rectified: those of the perspective pair are, unless raw ones are requested."""
    if camera in PERSPECTIVE:
        return rectified is not False
    if rectified:
        raise InputError(
            f"--rectified: found camera {camera}, whose images are all raw, expected {' or '.join(PERSPECTIVE)}"
        )
    return False


def _camera(folder: Path, camera: str, rectified: bool) -> tuple[dict[str, Any], Pose]:
    """Read the camera block and T_camera_camera0, where camera 0 is not rectified."""
    T = inverse(_camera_to_pose(folder, camera)) @ _camera_to_pose(folder, DEFAULT_CAMERA)
    if camera in FISHEYES:
        return read_intrinsics(_fisheye(folder, camera)), T
    lines, number = read_keyed(folder / "perspective.txt"), camera.removeprefix("image_")
    if not rectified:
        return kitti.raw_camera(lines, number), T
    # The baseline is in calib_cam_to_pose.txt already; the last column of P_rect would add it twice.
    block = kitti.pinhole(lines.at(f"P_rect_{number}"), *kitti.image_sides(lines.at(f"S_rect_{number}")))
    return block, rotation(lines.at(f"R_rect_{number}")) @ T


def _fisheye(folder: Path, camera: str) -> Path:
    return folder / f"{camera}.yaml"


def _camera_to_pose(folder: Path, camera: str) -> Pose:
    return from_line(read_keyed(folder / "calib_cam_to_pose.txt").at(camera))


def _images(root: Path, sequence: str, camera: str, rectified: bool) -> dict[str, Any]:
    """Find the images, their label images and their stamps. Raw images of the perspective pair have no labels."""
    folder = root / "data_2d_raw" / sequence / camera
    images = folder / ("data_rect" if rectified else "data_rgb")
    parts = PARTS if rectified or camera in FISHEYES else ()
    semantics = [root / "data_2d_semantics" / part / sequence / camera / "semantic" for part in parts]
    return {
        "image": files_by_stem(images, ".png", is_needed=False),
        "image_labels": next((files_by_stem(labels, ".png") for labels in semantics if labels.is_dir()), {}),
        "image_stamp": kitti.read_stamps(folder / "timestamps.txt"),
    }


def _read_poses(path: Path) -> dict[int, Pose]:
    """Read T_world_pose of each frame that has one; a line holds the frame number and 12 numbers."""
    poses = {}
    for where, (frame, *rows) in read_number_rows(path, 13, is_needed=True):
        if not frame.is_integer() or not 0 <= frame <= MAX_FRAME:
            raise InputError(f"{where}: found frame {frame:g}, expected a whole number from 0 to {MAX_FRAME}")
        poses[int(frame)] = from_rows(where, rows, farthest_m=MAX_WORLD_M)
    return poses


def _speeds(poses: dict[int, Pose]) -> dict[int, float]:
    positions = np.array([pose[:3, 3] for pose in poses.values()]).reshape(-1, 3)
    periods = np.diff(list(poses)) * KITTI_PERIOD_S
    return dict(zip(poses, speeds_mps(positions, periods), strict=True))
