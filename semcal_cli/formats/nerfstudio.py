"""Images with their poses for nerfstudio: transforms.json, docs.nerf.studio/quickstart/data_conventions.html.

The world is the frame of the LiDAR at the first image. Axes of a camera are OpenGL's: x right, y up, z back.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.drive.camera import CameraModel
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.formats.lenses import UnnamedLensError, check_lens, pixels_from_corner
from semcal_cli.formats.pose import rounded
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.observations.motion import displacements

LENSES: dict[CameraModel, tuple[str, tuple[str, ...]]] = {
    "plumb_bob": ("OPENCV", ("k1", "k2", "p1", "p2", "k3")),
    "fisheye": ("OPENCV_FISHEYE", ("k1", "k2", "k3", "k4")),
}
"""nerfstudio's `camera_model` of each lens, and its keys of the coefficients."""
T_OPTICAL_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""(4, 4) maps OpenGL's camera axes to those of the optical frame: x right, y down, z forward."""


def transforms_json(drive: Drive, T_camera_lidar: Pose, path: Path) -> bytes:
    """Make the content of a transforms.json.

    Args:
        drive: The drive, whose frames all have an image; the LiDAR has a pose at each, or there is one frame.
        T_camera_lidar: (4, 4), metres.
        path: File to write, whose folder the names of images are relative to.

    Raises:
        InputError: nerfstudio has no name for the lens, the drive has several frames and no poses, or a frame has no
            image, no stamp or no pose.
    """
    T_lidar_opengl, lens = inverse(T_camera_lidar) @ T_OPTICAL_OPENGL, _lens(drive)
    frames = []
    for frame, T_world_lidar in zip(drive.frames, _poses(drive), strict=True):
        if frame.image is None:
            raise InputError(f"{drive.path}: {frame.key('image')}: found nothing, expected an image")
        # Below a linked folder, .. leads out of the folder that is linked.
        image = os.path.relpath(drive.resolve(frame.image).resolve(), path.parent.resolve())
        matrix = rounded(T_world_lidar @ T_lidar_opengl)
        frames.append({"file_path": Path(image).as_posix(), "transform_matrix": matrix})
    return (json.dumps(lens | {"frames": frames}, indent=2) + "\n").encode()


def _poses(drive: Drive) -> list[Pose]:
    """Compute the pose of the LiDAR at each image, in its frame at the first."""
    first, *others = drive.frames
    if not others:
        return [np.eye(4)]
    if drive.motion is None or drive.motion.poses is None:
        raise InputError(
            f"{drive.path}: motion.poses: found nothing, expected the poses of the LiDAR for several frames; "
            "`semcal odometry DRIVE -o FILE` estimates them"
        )
    poses = [np.eye(4)]
    for frame, T in zip(others, displacements(drive, [(first, frame) for frame in others]), strict=True):
        if T is None:
            raise InputError(
                f"{drive.resolve(drive.motion.poses)}: found no pose, expected some before and after {frame.points}"
            )
        poses.append(T)
    return poses


def _lens(drive: Drive) -> dict[str, Any]:
    """Make the keys of the intrinsics, which all frames share.

    Raises:
        InputError: nerfstudio has no name for the lens, or K has a skew.
    """
    camera = drive.camera
    try:
        check_lens(f"{drive.path}: camera", camera, LENSES)
        pixels = pixels_from_corner(f"{drive.path}: camera", camera)
    except UnnamedLensError as error:
        raise InputError(f"{error}; undistort the images first") from None
    model, names = LENSES[camera.model]
    return {
        "camera_model": model,
        "w": camera.width,
        "h": camera.height,
        **dict(zip(("fl_x", "fl_y", "cx", "cy"), pixels, strict=True)),
        **dict(zip(names, camera.distortion, strict=False)),
    }
