"""KITTI raw, synchronised and rectified: ROOT/2011_09_26/2011_09_26_drive_0001_sync and the day's calibration files.

calib_velo_to_cam.txt maps the LiDAR to the unrectified camera 0, so R_rect_00 is applied after it.
"""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

from semcal_cli.datasets import kitti
from semcal_cli.datasets.files import files_by_stem, folders, numbered_files, pick
from semcal_cli.datasets.recording import Recording, Request, SourceFrame
from semcal_cli.errors import InputError
from semcal_cli.files.reading import read_text
from semcal_cli.formats.values import numbers, parse_numbers, read_keyed, stamp_s
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
    path = day / "calib_cam_to_cam.txt"
    keyed = read_keyed(path)
    key = f"P_rect_{camera}"
    P = kitti.projection(path, keyed, key)
    R_rect = kitti.rotation(path, keyed, "R_rect_00")
    return Recording(
        camera=kitti.pinhole(path, key, P, *kitti.image_size(path, keyed, f"S_rect_{camera}")),
        lidar=kitti.LIDAR,
        frames=frames,
        T_camera_lidar=kitti.beside_camera0(path, key, P) @ R_rect @ _velodyne_to_camera0(day),
    )


def _velodyne_to_camera0(day: Path) -> Pose:
    path = day / "calib_velo_to_cam.txt"
    keyed = read_keyed(path)
    return kitti.translated(path, "T", numbers(path, keyed, "T", 3)) @ kitti.rotation(path, keyed, "R")


def _frames(folder: Path, camera: str) -> list[SourceFrame]:
    clouds = numbered_files(folder / "velodyne_points/data", ".bin")
    images = files_by_stem(folder / camera / "data", ".png", ".jpg")
    points_stamps, image_stamps = (
        read_stamps(folder / part / "timestamps.txt") for part in ("velodyne_points", camera)
    )
    return [
        SourceFrame(
            name=number,
            points=cloud,
            image=images[number],
            points_stamp=points_stamps.get(int(number)),
            image_stamp=image_stamps.get(int(number)),
            speed_mps=_speed(folder / "oxts/data" / f"{number}.txt"),
        )
        for number, cloud in clouds.items()
        if number in images
    ]


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
    return {index: parse_stamp(path, index + 1, line) for index, line in enumerate(lines) if line.strip()}


def parse_stamp(path: Path, number: int, line: str) -> float:
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


def _speed(path: Path) -> float | None:
    """Read the speed at a frame from its inertial packet, metres a second; None without a packet."""
    if not path.exists():
        return None
    values = read_text(path).split()
    if len(values) <= FORWARD_SPEED:
        raise InputError(f"{path}: found {len(values)} values, needed at least {FORWARD_SPEED + 1}")
    return abs(float(parse_numbers(path, f"value {FORWARD_SPEED + 1}", values[FORWARD_SPEED], 1)[0]))
