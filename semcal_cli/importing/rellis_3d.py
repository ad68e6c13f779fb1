"""RELLIS-3D: ROOT/00000/os1_cloud_node_kitti_bin and the folders beside it (README of unmannedlab/RELLIS-3D).

Sweep 000104 belongs to image frame000104-1581624663_149, whose name ends with its time in seconds and milliseconds.
`transforms.yaml` maps the camera to the LiDAR and is inverted; see `RELLIS_3D` in `formats/document_formats.py`.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.files.input_files import read_text
from semcal_cli.formats import WITHOUT_OPTIONS, read_transform
from semcal_cli.formats.lenses import intrinsic_matrix
from semcal_cli.formats.node import checked_camera_block, parse_numbers, pick, rigid
from semcal_cli.importing.dataset_tree import files_by_stem, folders, read_speeds
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.importing.recording import Recording, Request, join_frames

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
    folder = request.root / pick(
        "sequence",
        request.sequence,
        sequences,
        request.root,
        expected="folders such as 00000/os1_cloud_node_kitti_bin in ROOT",
    )
    pick("camera", request.camera, [CAMERA], folder)
    clouds = files_by_stem(folder / "os1_cloud_node_kitti_bin", ".bin")
    images = _by_number(folder / CAMERA, ".jpg", ".png")
    label_images = _by_number(folder / f"{CAMERA}_label_id", ".png")
    frames = join_frames(
        clouds,
        needs=("image", "image_labels"),
        point_labels=files_by_stem(
            folder / "os1_cloud_node_semantickitti_label_id", ".label", is_needed=False
        ),
        image_labels={number: path for number, (path, _) in label_images.items()},
        image={number: path for number, (path, _) in images.items()},
        image_stamp={number: stamp for number, (_, stamp) in (label_images | images).items()},
        # There is one pose per sweep.
        speed_mps=dict(zip(clouds, read_speeds(folder / "poses.txt"), strict=False)),
        missing=f"{folder}: found no frame with a sweep and an image or its labels",
    )
    info, transforms = folder / "camera_info.txt", folder / "transforms.yaml"
    K = intrinsic_matrix(*parse_numbers(info, "intrinsics", read_text(info), 4).tolist())
    camera = {"model": "plumb_bob", "width": WIDTH, "height": HEIGHT, "K": K, "distortion": DISTORTION}
    with np.errstate(all="ignore"):
        T_camera_lidar = rigid(f"{transforms}", read_transform(transforms, options=WITHOUT_OPTIONS))
    ontology = read_ontology("rellis-3d")
    return Recording(
        camera=checked_camera_block(info, camera, {"K": "intrinsics"}),
        lidar=LIDAR,
        frames=frames,
        T_camera_lidar=T_camera_lidar,
        point_classes=ontology,
        image_classes=ontology,
        # The README of the data set mentions no trigger: its pairs were chosen by their stamps.
        synchronization="stamps",
        read=(transforms,),
    )


def _by_number(folder: Path, *suffixes: str) -> dict[str, tuple[Path, float]]:
    """List images and their stamps, seconds, by the six digits of their names, which are the names of the sweeps."""
    files = {}
    for path in files_by_stem(folder, *suffixes, is_needed=False).values():
        match = IMAGE_NAME.fullmatch(path.stem)
        if not match:
            raise InputError(
                f"{path}: found name {path.stem!r}, expected one such as frame000104-1581624663_149"
            )
        number, seconds, milliseconds = match.groups()
        files[number] = path, int(seconds) + int(milliseconds) / 1000.0
    return files
