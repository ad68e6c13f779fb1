"""KITTI odometry: velodyne, image_2, calib.txt and times.txt in ROOT/sequences/00, and ROOT/poses/00.txt."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from semcal_cli.datasets import kitti
from semcal_cli.datasets.files import files_by_stem, folders, numbered_files, pick
from semcal_cli.datasets.image_headers import image_size
from semcal_cli.datasets.recording import Recording, Request, SourceFrame
from semcal_cli.datasets.trajectory import KITTI_PERIOD_S, read_positions, speeds_mps
from semcal_cli.errors import InputError
from semcal_cli.files.reading import read_text
from semcal_cli.formats.values import parse_numbers, stamp_s

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
    return Recording(
        camera=block,
        lidar=kitti.LIDAR,
        frames=frames,
        T_camera_lidar=T_camera_lidar,
    )


def _frames(folder: Path, camera: str, poses: Path) -> list[SourceFrame]:
    clouds = numbered_files(folder / "velodyne", ".bin")
    images = files_by_stem(folder / camera, ".png", ".jpg")
    stamps = _stamps(folder / "times.txt")
    speeds = _speeds(poses)
    return [
        SourceFrame(
            name=number,
            points=cloud,
            image=images[number],
            points_stamp=stamps.get(int(number)),
            image_stamp=stamps.get(int(number)),
            speed_mps=speeds.get(int(number)),
        )
        for number, cloud in clouds.items()
        if number in images
    ]


def _stamps(path: Path) -> dict[int, float]:
    """Read the seconds since the first frame, one line a frame; the sweep triggers the image when it looks ahead."""
    if not path.exists():
        return {}
    lines = read_text(path).split()
    return {i: _stamp(path, f"line {i + 1}", line) for i, line in enumerate(lines)}


def _stamp(path: Path, key: str, line: str) -> float:
    return stamp_s(f"{path}: {key}", float(parse_numbers(path, key, line, 1)[0]))


def _speeds(path: Path) -> dict[int, float]:
    if not path.exists():
        return {}
    return dict(enumerate(np.ravel(speeds_mps(read_positions(path), KITTI_PERIOD_S)).tolist()))
