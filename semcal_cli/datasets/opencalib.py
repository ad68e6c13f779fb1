"""OpenCalib's road frames (PJLab-ADG/SensorsCalibration, lidar2camera): ROOT/1/calib.pcd, calib.txt, calib.png or .jpg.

In calib.txt, `T` is T_camera_lidar, 3 x 4 by rows, and `D` has four or five numbers in OpenCV's order.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semcal_cli.datasets.files import folders, image_size, need_file
from semcal_cli.datasets.recording import Recording, Request, SourceFrame
from semcal_cli.errors import InputError
from semcal_cli.formats.kitti import read_keyed
from semcal_cli.formats.node import camera_block, pick
from semcal_cli.formats.pose import from_line


def read(request: Request) -> Recording:
    """Find the only frame of a folder.

    Raises:
        InputError: a file is missing or wrong.
    """
    folder = _folder(request)
    keyed, image = read_keyed(folder / "calib.txt"), _image(folder)
    width, height = image_size(image)
    camera: dict[str, Any] = {"model": "plumb_bob", "width": width, "height": height}
    camera |= {"K": keyed.at("K").matrix(3, 3).tolist(), "distortion": keyed.at("D").numbers(4, 5)}
    return Recording(
        camera=camera_block(keyed.file, camera, {"distortion": "D"}),
        frames=[SourceFrame(name=folder.name, points=need_file(folder / "calib.pcd"), image=image)],
        T_camera_lidar=from_line(keyed.at("T")),
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
