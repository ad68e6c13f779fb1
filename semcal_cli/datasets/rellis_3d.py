"""RELLIS-3D: ROOT/00000/os1_cloud_node_kitti_bin and the folders beside it (README of unmannedlab/RELLIS-3D).

Sweep 000104 belongs to image frame000104-1581624663_149, whose name ends with its time in seconds and milliseconds.
`transforms.yaml` maps the camera to the LiDAR and is inverted; see `RELLIS_3D` in `formats/entries.py`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.datasets.files import files_by_stem, folders
from semcal_cli.datasets.ontologies import read_ontology
from semcal_cli.datasets.recording import Recording, Request, SourceFrame, joined
from semcal_cli.datasets.trajectory import read_speeds
from semcal_cli.errors import InputError
from semcal_cli.files.reading import read_text
from semcal_cli.formats import read_transform
from semcal_cli.formats.node import camera_block, parse_numbers, pick, rigid
from semcal_cli.geometry.poses import Pose

CAMERA = "pylon_camera_node"
WIDTH, HEIGHT = 1920, 1200
DISTORTION = [-0.134313, -0.025905, 0.002181, 0.00084, 0.0]
"""Distortion k1 k2 p1 p2 k3 from the project's own projection (utils/lidar2img.ipynb); camera_info.txt has none."""
LIDAR = {"channels": 64, "columns": 2048, "fov_up_deg": 16.6, "fov_down_deg": -16.6}
"""Scan pattern of the Ouster OS1-64, first generation."""
IMAGE_NAME = re.compile(r"frame([0-9]{6})-([0-9]{1,10})_([0-9]{3})")


def read(request: Request) -> Recording:
    """Find the frames of a sequence that have a sweep and an image or a label image.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no frame is complete.
    """
    sequences = [name for name in folders(request.root) if re.fullmatch("[0-9]{5}", name)]
    folder = request.root / pick("sequence", request.sequence, sequences, request.root)
    pick("camera", request.camera, [CAMERA], folder)
    ontology = read_ontology("rellis-3d")
    frames = _frames(folder)
    if not frames:
        raise InputError(f"{folder}: found no frame with a sweep and a picture or its labels")
    transforms = folder / "transforms.yaml"
    return Recording(
        camera=_camera(folder / "camera_info.txt"),
        lidar=LIDAR,
        frames=frames,
        T_camera_lidar=_reference(transforms),
        point_classes=ontology,
        image_classes=ontology,
        read=(transforms,),
    )


def _reference(path: Path) -> Pose:
    with np.errstate(all="ignore"):
        return rigid(f"{path}", read_transform(path))


def _camera(path: Path) -> dict[str, Any]:
    fx, fy, cx, cy = parse_numbers(path, "intrinsics", read_text(path), 4).tolist()
    block = {
        "model": "plumb_bob",
        "width": WIDTH,
        "height": HEIGHT,
        "K": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
        "distortion": DISTORTION,
    }
    return camera_block(path, block, {"K": "intrinsics"})


def _frames(folder: Path) -> list[SourceFrame]:
    clouds = files_by_stem(folder / "os1_cloud_node_kitti_bin", ".bin")
    images = _by_number(_optional(folder / CAMERA, ".jpg", ".png"))
    image_labels = _by_number(_optional(folder / f"{CAMERA}_label_id", ".png"))
    return joined(
        clouds,
        needs=("image", "image_labels"),
        point_labels=_optional(folder / "os1_cloud_node_semantickitti_label_id", ".label"),
        image_labels=image_labels,
        image=images,
        image_stamp={number: _stamp(path) for number, path in (image_labels | images).items()},
        # The poses have a line for each sweep.
        speed_mps=dict(zip(clouds, read_speeds(folder / "poses.txt"), strict=False)),
    )


def _optional(folder: Path, *suffixes: str) -> dict[str, Path]:
    return files_by_stem(folder, *suffixes) if folder.is_dir() else {}


def _by_number(files: dict[str, Path]) -> dict[str, Path]:
    """Key images by the six digits of their names, which are the names of the sweeps."""
    return {_parse(path).group(1): path for path in files.values()}


def _stamp(image: Path) -> float:
    _, seconds, milliseconds = _parse(image).groups()
    return int(seconds) + int(milliseconds) / 1000.0


def _parse(image: Path) -> re.Match[str]:
    found = IMAGE_NAME.fullmatch(image.stem)
    if not found:
        raise InputError(f"{image}: found name {image.stem!r}, needed one as frame000104-1581624663_149")
    return found
