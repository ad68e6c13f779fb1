"""KITTI odometry: velodyne, image_2, calib.txt and times.txt in ROOT/sequences/00, and ROOT/poses/00.txt."""

from __future__ import annotations

import re
from pathlib import Path

from semcal_cli.datasets import kitti
from semcal_cli.datasets.files import files_by_stem, folders, image_size, numbered_files
from semcal_cli.datasets.recording import Recording, Request, SourceFrame, joined
from semcal_cli.datasets.trajectory import read_speeds
from semcal_cli.errors import InputError
from semcal_cli.files.reading import read_text
from semcal_cli.formats.node import parse_number, pick, stamp_s

USUAL_CAMERA = "image_2"


def read(request: Request) -> Recording:
    """Find the frames of a sequence that have a sweep and an image; the data set has no labels.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no frame is complete.
    """
    sequences = request.root / "sequences"
    sequence = pick("sequence", request.sequence, folders(sequences), sequences)
    folder = sequences / sequence
    cameras = [name for name in folders(folder) if re.fullmatch("image_[0-9]+", name)]
    camera = pick("camera", request.camera, cameras, folder, usual=USUAL_CAMERA)
    frames = _frames(folder, camera, request.root / "poses" / f"{sequence}.txt")
    if not frames:
        raise InputError(f"{folder}: found no frame with a sweep in velodyne and a picture in {camera}")
    image = frames[0].image
    assert image is not None
    number = int(camera.removeprefix("image_"))
    block, T_camera_lidar = kitti.calibration(folder / "calib.txt", number, *image_size(image))
    return Recording(camera=block, lidar=kitti.LIDAR, frames=frames, T_camera_lidar=T_camera_lidar)


def _frames(folder: Path, camera: str, poses: Path) -> list[SourceFrame]:
    clouds = numbered_files(folder / "velodyne", ".bin")
    stamps = _stamps(folder / "times.txt")
    return joined(
        clouds,
        image=files_by_stem(folder / camera, ".png", ".jpg"),
        points_stamp=stamps,
        image_stamp=stamps,
        speed_mps=dict(enumerate(read_speeds(poses))),
    )


def _stamps(path: Path) -> dict[int, float]:
    """Read the seconds since the first frame, one line a frame; the sweep triggers the image when it looks ahead."""
    lines = read_text(path).split() if path.exists() else []
    where = [f"{path}: line {index}" for index in range(1, len(lines) + 1)]
    stamps = (stamp_s(key, parse_number(key, line)) for key, line in zip(where, lines, strict=True))
    return dict(enumerate(stamps))
