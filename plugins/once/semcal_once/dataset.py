"""ONCE (One Million Scenes, Mao et al., arXiv 2106.11037): sequences such as ROOT/data/000076.

Sources: the devkit (once-for-auto-driving/once_devkit, once.py, and its issues), the documentation
(once-for-auto-driving.github.io), and another reader (tri3d, datasets/once.py).

cam_to_velo maps a camera to the LiDAR, whose x points left, y back and z up: T_camera_lidar = inv(cam_to_velo). The
devkit projects points by this and by K into images that cv2.undistort has undistorted by K and distortion, which is
k1 k2 p1 p2 k3. The documentation says that images are published undistorted; the devkit and tri3d take them as
recorded, as does this reader. A sweep and its images have one name, a time in milliseconds; frames are sampled at 2 Hz
from sweeps at 10 Hz, with gaps. Points have no times, and whether sweeps are compensated for the motion is not known.
pose is qx qy qz qw x y z of the LiDAR in a fixed frame. The devkit provides for frames without a pose; here, a
quaternion of zeros is none.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.errors import InputError
from semcal_cli.files.documents import parse_document
from semcal_cli.files.input_files import read_text
from semcal_cli.formats.node import MAX_WORLD_M, Node, checked_camera_block, pick, rigid, stamp_s
from semcal_cli.formats.pose import from_rows
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, pose_from_quaternion
from semcal_cli.importing.dataset_tree import folders, image_size, numbered_files
from semcal_cli.importing.recording import Recording, Request, join_frames, with_trajectory

DEFAULT_CAMERA = "cam01"
NS_PER_MS = 1_000_000
SWEEP_S = 0.1
"""Duration of a sweep. Which moment of it the stamp of the sweep is, is not stated."""
MOMENT_SIGMA_S = SWEEP_S / math.sqrt(12.0)
"""Standard deviation of the moment of an image, which may be any in a tenth of a second."""


def read(request: Request) -> Recording:
    """ONCE: ROOT/data/000076; by default cam01.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no sweep has an image and poses.
    """
    data = request.root / "data"
    folder = data / pick("sequence", request.sequence, folders(data), data, expected="folders such as 000076")
    path = folder / f"{folder.name}.json"
    document = Node(str(path), parse_document(read_text(path, limit=MAX_TABLE_BYTES), path))
    calibrations = document.at("calib")
    cameras = [*calibrations.mapping]
    camera = pick("camera", request.camera, cameras, calibrations.where, default=DEFAULT_CAMERA)
    calibration = calibrations.at(camera)
    sweeps, images = numbered_files(folder / "lidar_roof", ".bin"), numbered_files(folder / camera, ".jpg")
    stamps = {name: stamp_s(str(sweep), int(name) / 1_000) for name, sweep in sweeps.items()}
    frames = join_frames(
        sweeps,
        missing=f"{folder}: found no sweep with an image of {camera} of its name",
        image=images,
        points_stamp=stamps,
        image_stamp=stamps,
    )
    recording = Recording(
        camera=_camera(calibration, next(iter(images.values()))),
        frames=frames,
        T_camera_lidar=inverse(_mounting(calibration.at("cam_to_velo"))),
        # No trigger is known. Frames were dropped if a camera did not fit the LiDAR in time (issue 22).
        synchronization="stamps",
        time_offset_sigma_s=MOMENT_SIGMA_S,
    )
    if not (poses := _read_poses(document.at("frames"))):
        return recording
    return with_trajectory(recording, poses, path, point_times="relative", sweep_s=SWEEP_S)


def _camera(calibration: Node, image: Path) -> dict[str, Any]:
    """Make the camera block of the images as they are, which are not undistorted."""
    K, distortion = calibration.at("cam_intrinsic"), calibration.at("distortion")
    width, height = image_size(image)
    block = {"model": "plumb_bob", "width": width, "height": height}
    keys = {"K": K.key, "distortion": distortion.key}
    return checked_camera_block(
        calibration.file, block | {"K": K.value, "distortion": distortion.value}, keys
    )


def _mounting(node: Node) -> Pose:
    """Read T_lidar_camera (4, 4), metres."""
    rows = node.rows(4)
    if len(rows) != 4:
        raise node.mismatch("4 rows of 4 numbers")
    return from_rows(node.where, rows)


def _read_poses(frames: Node) -> dict[int, Pose]:
    """Read T_world_lidar (4, 4) by their times in nanoseconds, ascending, metres."""
    if not isinstance(frames.value, list):
        raise frames.mismatch("a list")
    poses = {}
    for index, item in enumerate(frames.value):
        frame = frames.child(index, item)
        pose = frame.at("pose")
        numbers = pose.numbers(7)
        if any(numbers[:4]):
            poses[_stamp_ns(frame.at("frame_id"))] = _pose(pose.where, numbers)
    return dict(sorted(poses.items()))


def _stamp_ns(frame_id: Node) -> int:
    """Read a time, which is a text or, in frames without annotations, a number (issue 9)."""
    if not re.fullmatch(r"[0-9]{1,13}", str(frame_id.value)):
        raise frame_id.mismatch("a time in whole milliseconds")
    return int(frame_id.value) * NS_PER_MS


def _pose(where: str, numbers: list[float]) -> Pose:
    try:
        T = pose_from_quaternion(numbers[:4], numbers[4:])
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    return rigid(where, T, MAX_WORLD_M)
