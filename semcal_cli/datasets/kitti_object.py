"""KITTI object: velodyne, image_2 and calib in ROOT/training or in ROOT itself; one calib.txt may serve all frames.

Frames are of many drives in a random order. Those whose calibration files are alike are of one rig on one day, and make
a drive together.
"""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

from semcal_cli.datasets import kitti
from semcal_cli.datasets.files import files_by_stem, folders, image_size, numbered_files
from semcal_cli.datasets.recording import Recording, Request, SourceFrame, joined
from semcal_cli.errors import InputError, listed
from semcal_cli.files.reading import is_folder, read_text
from semcal_cli.formats.node import pick

USUAL_CAMERA = "image_2"


def read(request: Request) -> Recording:
    """Find the frames of one calibration that have a sweep and an image; the data set has no labels of either.

    The sequence is the name of a frame of that calibration; without one, the calibration of most frames is taken.

    Raises:
        InputError: the frame, the camera or a file is missing or wrong, or no frame is complete.
    """
    folder = request.root / "training" if is_folder(request.root / "training") else request.root
    cameras = [name for name in folders(folder) if re.fullmatch("image_[0-9]+", name)]
    camera = pick("camera", request.camera, cameras, folder, usual=USUAL_CAMERA)
    images = files_by_stem(folder / camera, ".png", ".jpg")
    frames = {
        frame.name: frame for frame in joined(numbered_files(folder / "velodyne", ".bin"), image=images)
    }
    if not frames:
        raise InputError(f"{folder}: found no frame with a sweep in velodyne and a picture in {camera}")
    groups = _by_calibration(folder, list(frames))
    group = max(groups, key=len)
    if request.sequence is not None:
        name = pick("sequence", request.sequence, list(frames), folder)
        group = next(each for each in groups if name in each)
    return _recording(_calibration(folder, group[0]), camera, [frames[name] for name in group], groups)


def _calibration(folder: Path, name: str) -> Path:
    """Locate the calibration file of a frame."""
    return folder / "calib" / f"{name}.txt" if is_folder(folder / "calib") else folder / "calib.txt"


def _by_calibration(folder: Path, names: list[str]) -> list[list[str]]:
    """Take the names of frames apart by the contents of their calibration files, in the order of the frames."""
    groups = defaultdict[str, list[str]](list)
    for name in names:
        groups[read_text(_calibration(folder, name))].append(name)
    return list(groups.values())


def _recording(path: Path, camera: str, frames: list[SourceFrame], groups: list[list[str]]) -> Recording:
    image = frames[0].image
    assert image is not None
    number = int(camera.removeprefix("image_"))
    block, T_camera_lidar = kitti.calibration(path, number, *image_size(image))
    others = [f"{group[0]} ({len(group):,})" for group in groups if group[0] != frames[0].name]
    remarks = (
        f"the {len(frames):,} frames with the calibration of {frames[0].name} are taken; others by --sequence, which "
        f"names a frame: {listed(others)}"
    )
    return Recording(
        camera=block,
        lidar=kitti.LIDAR,
        frames=frames,
        T_camera_lidar=T_camera_lidar,
        remarks=(remarks,) if others else (),
    )
