"""OpenCalib's road frames (PJLab-ADG/SensorsCalibration, lidar2camera): ROOT/1/calib.pcd, calib.txt, calib.png or .jpg.

`T` of calib.txt is LiDAR to camera, 3 x 4 by rows; `D` is OpenCV's, four or five numbers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semcal_cli.datasets.files import folders, need, numbers, pick, read_keyed
from semcal_cli.datasets.pictures import picture_size
from semcal_cli.datasets.recording import Recording, Request, SourceFrame
from semcal_cli.datasets.trajectory import pose_from_rows
from semcal_cli.errors import InputError


def read(request: Request) -> Recording:
    """Find the one frame of a folder."""
    folder = _folder(request)
    calibration = folder / "calib.txt"
    keyed = read_keyed(calibration)
    image = _image(folder)
    K = numbers(calibration, keyed, "K", 9).reshape(3, 3)
    distortion = numbers(calibration, keyed, "D", 4, 5)
    width, height = picture_size(image)
    camera: dict[str, Any] = {"model": "plumb_bob", "width": width, "height": height}
    return Recording(
        camera={**camera, "K": K.tolist(), "distortion": distortion.tolist()},
        frames=[SourceFrame(name=folder.name, points=need(folder / "calib.pcd"), image=image)],
        T_camera_lidar=pose_from_rows(numbers(calibration, keyed, "T", 12)),
    )


def _folder(request: Request) -> Path:
    if request.sequence is None and (request.root / "calib.txt").exists():
        return request.root
    known = [name for name in folders(request.root) if (request.root / name / "calib.txt").exists()]
    return request.root / pick("sequence", request.sequence, known, request.root)


def _image(folder: Path) -> Path:
    for suffix in (".png", ".jpg"):
        if (folder / f"calib{suffix}").exists():
            return folder / f"calib{suffix}"
    raise InputError(f"{folder}: found neither calib.png nor calib.jpg, needed one of them")
