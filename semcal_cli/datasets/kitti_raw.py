"""KITTI raw, synchronised and rectified: ROOT/2011_09_26/2011_09_26_drive_0001_sync and the day's calibration files.

calib_velo_to_cam.txt maps the LiDAR to the unrectified camera 0, so R_rect_00 is applied after it.
"""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from semcal_cli.datasets import kitti
from semcal_cli.datasets.files import files_by_stem, folders, numbered_files
from semcal_cli.datasets.recording import Recording, Request, SourceFrame, joined
from semcal_cli.errors import InputError
from semcal_cli.files.reading import read_text
from semcal_cli.formats.kitti import beside_camera0, read_keyed
from semcal_cli.formats.node import parse_numbers, pick, rigid, stamp_s
from semcal_cli.formats.pose import rotation, transform
from semcal_cli.geometry.poses import Pose

USUAL_CAMERA = "image_02"
FORWARD_SPEED = 8
"""Column of the forward velocity in an oxts packet, metres a second (dataformat.txt)."""


def read(request: Request) -> Recording:
    """Find the frames of a drive that have a sweep and an image; the data set has no labels.

    Raises:
        InputError: the drive, the camera or a file is missing or wrong, or no frame is complete.
    """
    drives = sorted(path.name for path in request.root.glob("*/*_sync") if path.is_dir())
    drive = pick("sequence", request.sequence, drives, request.root)
    day = request.root / drive[: len("2011_09_26")]
    cameras = [name for name in folders(day / drive) if name.startswith("image_")]
    camera = pick("camera", request.camera, cameras, day / drive, usual=USUAL_CAMERA)
    frames = _frames(day / drive, camera)
    if not frames:
        raise InputError(f"{day / drive}: found no frame with a sweep and a picture in {camera}")
    return _calibrated(day, camera.removeprefix("image_"), frames)


def _calibrated(day: Path, camera: str, frames: list[SourceFrame]) -> Recording:
    keyed = read_keyed(day / "calib_cam_to_cam.txt")
    width, height = kitti.image_size(keyed.at(f"S_rect_{camera}"))
    return Recording(
        camera=kitti.pinhole(keyed.at(f"P_rect_{camera}"), width, height),
        lidar=kitti.LIDAR,
        frames=frames,
        T_camera_lidar=reference(day, camera),
    )


def reference(day: Path, camera: str) -> Pose:
    """Read T_camera_lidar (4, 4) of a rectified camera from a day's calibration files.

    Raises:
        InputError: a key is missing or wrong.
    """
    cameras, velo = (read_keyed(day / f"calib_{name}_to_cam.txt") for name in ("cam", "velo"))
    shift = velo.at("T")
    T_camera0_lidar = rigid(shift.where, transform(np.eye(3), shift.numbers(3))) @ rotation(velo.at("R"))
    T_camera_camera0 = beside_camera0(cameras.at(f"P_rect_{camera}")) @ rotation(cameras.at("R_rect_00"))
    return T_camera_camera0 @ T_camera0_lidar


def _frames(folder: Path, camera: str) -> list[SourceFrame]:
    clouds = numbered_files(folder / "velodyne_points/data", ".bin")
    packets = files_by_stem(folder / "oxts/data", ".txt") if (folder / "oxts/data").is_dir() else {}
    return joined(
        clouds,
        image=files_by_stem(folder / camera / "data", ".png", ".jpg"),
        points_stamp=read_stamps(folder / "velodyne_points/timestamps.txt"),
        image_stamp=read_stamps(folder / camera / "timestamps.txt"),
        speed_mps={name: _speed(path) for name, path in packets.items() if name in clouds},
    )


def read_stamps(path: Path) -> dict[int, float]:
    """Read Unix seconds from a file with one time a line; an empty line stands for a missing frame.

    Returns:
        Seconds by the index of the line; empty if the file does not exist.

    Raises:
        InputError: a line holds no time.
    """
    if not path.exists():
        return {}
    lines = read_text(path).splitlines()
    return {index: _stamp(path, index + 1, line) for index, line in enumerate(lines) if line.strip()}


def _stamp(path: Path, number: int, line: str) -> float:
    """Convert a line such as `2011-09-26 13:02:25.951199337`, taken as UTC, to Unix seconds.

    Raises:
        InputError: the line holds no time.
    """
    whole, _, fraction = line.strip().partition(".")
    try:
        moment = datetime.strptime(whole, "%Y-%m-%d %H:%M:%S").replace(tzinfo=timezone.utc)
        if fraction and not fraction.isdecimal():
            raise ValueError(fraction)
        seconds = moment.timestamp() + float(f"0.{fraction or 0}")
    except ValueError:
        raise InputError(
            f"{path}: line {number}: found {line[:40]!r}, needed a time as 2011-09-26 13:02:25.95"
        ) from None
    return stamp_s(f"{path}: line {number}", seconds)


def _speed(packet: Path) -> float:
    """Read the speed at a frame from its inertial packet, metres a second."""
    values = read_text(packet).split()
    if len(values) <= FORWARD_SPEED:
        raise InputError(f"{packet}: found {len(values)} values, needed at least {FORWARD_SPEED + 1}")
    return abs(float(parse_numbers(packet, f"value {FORWARD_SPEED + 1}", values[FORWARD_SPEED], 1)[0]))
