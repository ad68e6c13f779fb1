"""OpenCalib's road frames (PJLab-ADG/SensorsCalibration, lidar2camera): ROOT/1/calib.pcd, calib.txt, calib.png or .jpg.

In calib.txt, `T` is T_camera_lidar, 3 x 4 by rows, and `D` has four or five numbers in OpenCV's order.
"""

from __future__ import annotations

from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.formats.kitti_files import read_keyed
from semcal_cli.formats.node import checked_camera_block, pick
from semcal_cli.formats.pose import from_line
from semcal_cli.importing.dataset_tree import files_by_stem, folders, image_size, need_file
from semcal_cli.importing.recording import Recording, Request, SourceFrame


def read(request: Request) -> Recording:
    """Find the only frame of a folder.

    Raises:
        InputError: a file is missing or wrong.
    """
    folder = request.root
    if request.sequence is not None or not (folder / "calib.txt").exists():
        names = [name for name in folders(folder) if (folder / name / "calib.txt").exists()]
        folder /= pick(
            "sequence",
            request.sequence,
            names,
            folder,
            expected="folders such as 1 with calib.txt and calib.pcd",
        )
    lines, image = read_keyed(folder / "calib.txt"), files_by_stem(folder, ".png", ".jpg").get("calib")
    if image is None:
        raise InputError(f"{folder}: found neither calib.png nor calib.jpg")
    width, height = image_size(image)
    camera: dict[str, Any] = {"model": "plumb_bob", "width": width, "height": height}
    camera |= {"K": lines.at("K").matrix(3, 3).tolist(), "distortion": lines.at("D").numbers(4, 5)}
    return Recording(
        camera=checked_camera_block(lines.file, camera, {"distortion": "D"}),
        frames=[SourceFrame(name=folder.name, points=need_file(folder / "calib.pcd"), image=image)],
        T_camera_lidar=from_line(lines.at("T")),
    )
