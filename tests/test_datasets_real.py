"""`semcal import` on real files, laid out as the data sets have them."""

from pathlib import Path

import numpy as np
import pytest
from conftest import real
from dataset_imports import run_import

from semcal_cli import _core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.drive.reading import load_observations
from semcal_cli.formats import read_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.poses import Pose, inverse

SAME_NAMES_AT_REFERENCE = 0.75
"""The published transform of the RELLIS-3D frame, true to a degree, gives 0.77."""
SAME_NAMES_BACKWARDS = 0.5
PRINTED = 1e-9  # decimals of the reference in the drive.yaml of the real frame


def link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.symlink_to(source)


def rellis_tree(source: Path, root: Path) -> Path:
    folder = root / "00000"
    link(source / "000104.bin", folder / "os1_cloud_node_kitti_bin/000104.bin")
    link(source / "000104.label", folder / "os1_cloud_node_semantickitti_label_id/000104.label")
    picture = "frame000104-1581624663_149"
    link(source / f"{picture}.jpg", folder / f"pylon_camera_node/{picture}.jpg")
    link(source / f"{picture}.png", folder / f"pylon_camera_node_label_id/{picture}.png")
    for name in ("camera_info.txt", "transforms.yaml"):
        link(source / name, folder / name)
    return root


def test_rellis3d(tmp_path: Path) -> None:
    source = real("rellis3d_000104")
    run_import("rellis-3d", rellis_tree(source, tmp_path / "Rellis-3D"), "-o", tmp_path / "drive")
    drive, by_hand = read_drive(tmp_path / "drive"), read_drive(source)
    assert drive.camera == by_hand.camera
    T_camera_lidar = read_transform(tmp_path / "drive")
    np.testing.assert_allclose(T_camera_lidar, read_transform(source), atol=PRINTED)
    observations = load_observations(drive)
    assert {"grass", "tree", "bush"} <= set(observations.point_class_names)
    assert same_names(observations, T_camera_lidar) > SAME_NAMES_AT_REFERENCE
    assert same_names(observations, inverse(T_camera_lidar)) < SAME_NAMES_BACKWARDS


def same_names(observations: Observations, T_camera_lidar: Pose) -> float:
    """Share of the labelled points in the picture that land on a pixel of a class of the same name."""
    camera, points = core_camera(observations.camera), observations.clouds[0].points
    pixels = _core.project_points(camera, points, T_camera_lidar).pixels
    inside = np.isfinite(pixels).all(axis=1)
    u, v = pixels[inside].round().astype(int).T
    on_points, on_image = observations.clouds[0].classes[inside], observations.images[0].classes[v, u]
    labelled = (on_points != NO_CLASS) & (on_image != NO_CLASS)
    names_points = np.array(observations.point_class_names)[on_points[labelled]]
    return float(np.mean(names_points == np.array(observations.image_class_names)[on_image[labelled]]))


def test_kitti_object(tmp_path: Path) -> None:
    """The 14 frames have one calibration, which is read as `convert` reads it."""
    source = real("kitti_object")
    labels = ("--image-labels", source / "image_labels", "--image-classes", "cityscapes-train")
    run_import("kitti-object", source, *labels, "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert (len(drive.frames), drive.camera.width, drive.camera.height) == (14, 1242, 375)
    published = read_transform(source / "calib.txt", options=FormatOptions(camera="P2"))
    np.testing.assert_allclose(np.array(drive.T_camera_lidar), published, atol=PRINTED)


@pytest.mark.parametrize(("sequence", "count"), [("1", 4), ("2", 4), ("3", 5)])
def test_opencalib(tmp_path: Path, sequence: str, count: int) -> None:
    source = real("opencalib_road")
    run_import("opencalib", source, "--sequence", sequence, "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert len(drive.camera.distortion) == count
    assert (drive.camera.width, drive.camera.height) == (1920, 1200)
    words = (source / sequence / "calib.txt").read_text().split("T:")[1].split()
    # nearest rotation to six printed digits
    np.testing.assert_allclose(np.array(drive.T_camera_lidar)[:3].ravel(), np.array(words, float), atol=1e-5)
    assert all(
        drive.resolve(str(file)).is_file() for frame in drive.frames for file in (frame.points, frame.image)
    )
