"""KITTI odometry: ROOT/sequences/00 with velodyne, image_2, calib.txt, times.txt; ROOT/poses/00.txt."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semcal_cli.datasets import kitti
from semcal_cli.datasets.files import files_by_stem, folders, need, parse_numbers, pick
from semcal_cli.datasets.pictures import picture_size
from semcal_cli.datasets.recording import Recording, Request, SourceFrame
from semcal_cli.datasets.trajectory import KITTI_PERIOD_S, read_poses, speeds_mps
from semcal_cli.documents import read_text
from semcal_cli.errors import InputError

USUAL_CAMERA = "image_2"


def read(request: Request) -> Recording:
    """Find the frames of a sequence that have a sweep and a picture; they have no labels."""
    sequences = request.root / "sequences"
    sequence = pick("sequence", request.sequence, folders(sequences), sequences)
    folder = sequences / sequence
    cameras = [name for name in folders(folder) if name.startswith("image_")]
    camera = pick("camera", request.camera or USUAL_CAMERA, cameras, folder)
    frames = _frames(folder, camera, request.root / "poses" / f"{sequence}.txt")
    if not frames:
        raise InputError(f"{folder}: found no frame with a sweep in velodyne and a picture in {camera}")
    image = frames[0].image
    assert image is not None
    K, T_camera_lidar = kitti.calibration(need(folder / "calib.txt"), int(camera.removeprefix("image_")))
    return Recording(
        camera=kitti.pinhole(K, *picture_size(image)),
        lidar=kitti.LIDAR,
        frames=frames,
        T_camera_lidar=T_camera_lidar,
    )


def _frames(folder: Path, camera: str, poses: Path) -> list[SourceFrame]:
    clouds = files_by_stem(folder / "velodyne", ".bin")
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
        if number in images and number.isdigit()
    ]


def _stamps(path: Path) -> dict[int, float]:
    """Seconds since the first frame, a line each; the pictures are triggered when the sweep looks ahead."""
    if not path.exists():
        return {}
    lines = read_text(path).split()
    return {i: float(parse_numbers(path, f"line {i + 1}", line, 1)[0]) for i, line in enumerate(lines)}


def _speeds(path: Path) -> dict[int, float]:
    if not path.exists():
        return {}
    return dict(enumerate(np.ravel(speeds_mps(read_poses(path)[:, :3, 3], KITTI_PERIOD_S)).tolist()))
