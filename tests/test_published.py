"""What the paper prints: our readers give its rows, and the table of a drive sets them beside its own."""

import re
from pathlib import Path

import numpy as np
import pytest
from dataset_imports import run_import
from dataset_trees import TREES, moved, write

from semcal_cli.drive.document import read_drive
from semcal_cli.experiments.published import PUBLISHED, PublishedRow, published_rows
from semcal_cli.experiments.table import MethodComparison, describe, markdown
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import rotation_error_deg, rotation_vector_deg
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.observations.reading import load_observations


def test_the_row_of_the_paper_is_the_rotation_vector(rellis3d: Path) -> None:
    """Jiang et al. (2021) print "roll pitch yaw" of RELLIS-3D's reference as these six numbers."""
    T = read_transform(rellis3d)
    assert np.round(rotation_vector_deg(T), 2).tolist() == [70.80, 67.78, -68.06]
    assert np.round(T[:3, 3], 2).tolist() == [-0.04, -0.17, -0.13]


CAM_TO_VELO = """0.04307104361 -0.08829286498 0.995162929 0.8043914418
-0.999004371 0.007784614041 0.04392796942 0.2993489574 -0.01162548558 -0.9960641394 -0.08786966659 -0.1770225824
"""
"""KITTI-360's own calib_cam_to_velo.txt."""
R_RECT_00 = "0.999974 -0.007141 -0.000089 0.007141 0.999969 -0.003247 0.000112 0.003247 0.999995"
"""That of its perspective.txt."""


def kitti_360_reference(root: Path, *arguments: str) -> Pose:
    """The reference of an import with the calibration of the data set itself."""
    tree = TREES["kitti-360"](root / "tree")
    write(tree.root / "calibration/calib_cam_to_velo.txt", CAM_TO_VELO)
    perspective = tree.root / "calibration/perspective.txt"
    write(perspective, re.sub("(R_rect_00: ).*", rf"\g<1>{R_RECT_00}", perspective.read_text()))
    run_import("kitti-360", tree.root, *arguments, "-o", root / "drive")
    return read_transform(root / "drive")


def test_the_row_of_kitti_360_is_that_of_raw_images(tmp_path: Path) -> None:
    """The paper prints its reference as 73.72, -71.37, 64.56: camera 0 before R_rect_00 turns it."""
    for T in (
        kitti_360_reference(tmp_path, "--raw"),
        read_transform(tmp_path / "tree/calibration/calib_cam_to_velo.txt"),
    ):
        assert np.round(rotation_vector_deg(T), 2).tolist() == [73.72, -71.37, 64.56]
        assert np.round(T[:3, 3], 2).tolist() == [0.26, -0.11, -0.83]


def test_rectification_turns_the_row_of_kitti_360(tmp_path: Path) -> None:
    T = kitti_360_reference(tmp_path)
    assert np.round(rotation_vector_deg(T), 2).tolist() == [74.17, -71.30, 64.76]
    published = PUBLISHED["KITTI-360"][0].T_camera_lidar
    assert rotation_error_deg(T, published) == pytest.approx(0.45, abs=0.005)


def test_a_drive_is_told_by_its_reference(tmp_path: Path) -> None:
    """KITTI-360's also if its images are rectified, by less than half of what is allowed."""
    for rows in PUBLISHED.values():
        T = rows[0].T_camera_lidar
        assert np.round(rotation_vector_deg(T), 2).tolist() == list(rows[0].rotation_vector_deg)
        assert published_rows(T) == rows
        assert published_rows(moved(T, 0.0, 0.0, 0.11)) == ()
        assert published_rows(T @ apply_twist(np.eye(4), np.radians([0, 0, 0, 0, 0, 1.1]))) == ()
    assert published_rows(kitti_360_reference(tmp_path)) == PUBLISHED["KITTI-360"]


def test_the_paper_stands_beside_the_reference(
    street: Path, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drive that is told to be the paper's: its row is measured as every other one, and says where it is from."""
    rounded = [np.round(v, 2).tolist() for v in (rotation_vector_deg(street_truth), street_truth[:3, 3])]
    row = PublishedRow("reference, published", *map(tuple, rounded), "that of the street")
    monkeypatch.setitem(PUBLISHED, "street", (row,))
    drive = read_drive(street)
    poses = {"reference": street_truth, "start": street_truth}
    comparison = MethodComparison(drive, load_observations(drive), poses, published_rows(street_truth))
    rows = describe(comparison)
    assert [row.method for row in rows] == ["reference", "reference, published", "start"]
    assert rows[1].cells[:2] == rows[0].cells[:2]
    assert 0.0 < rows[1].camera_center_error_cm < 1.0
    assert rows[1].mutual_information_nats == pytest.approx(rows[0].mutual_information_nats, rel=0.05)
    assert rows[1].mutual_information_nats != rows[0].mutual_information_nats
    table = markdown(comparison, rows)
    assert table.splitlines()[3].startswith("| reference, published | ")
    assert "\nReference, published: that of the street.\n" in table
