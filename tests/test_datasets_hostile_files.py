"""`semcal import` on paths, names and options that cannot be: one line says which, and no file is overwritten."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from camera_infos import ROS
from dataset_imports import Import, complaint, run_import
from dataset_trees import KITTI_360_DRIVE, TREES, own_data, write, write_cloud, write_labels

from semcal_cli.drive.document import read_drive


def a_file(path: Path) -> None:
    path.write_text("")


NO_FOLDER, NO_FILE, NO_REGULAR = (
    "found a file, expected a folder",
    "found a folder, expected a file",
    "found a special file, expected a file",
)
WINDOW = f"data_3d_semantics/train/{KITTI_360_DRIVE}/static/0000000002_0000000385.ply"


@pytest.mark.parametrize(
    ("name", "place", "make", "expected"),
    [
        *((name, "", a_file, NO_FOLDER) for name in TREES),
        ("kitti-odometry", "sequences", a_file, NO_FOLDER),
        ("kitti-odometry", "sequences/00/velodyne", a_file, NO_FOLDER),
        ("kitti-odometry", "sequences/00/velodyne/000000.bin", Path.mkdir, NO_FILE),
        ("nuscenes", "samples/LIDAR_TOP/a__LIDAR_TOP__1.pcd.bin", Path.mkdir, NO_FILE),
        ("kitti-odometry", "sequences/00/image_2/000000.png", os.mkfifo, NO_REGULAR),
        ("opencalib", "1/calib.pcd", os.mkfifo, NO_REGULAR),
        ("carla", "labels/000017.png", os.mkfifo, NO_REGULAR),
        ("carla", "lidar/000017.ply", os.mkfifo, NO_REGULAR),
        ("kitti-360", WINDOW, os.mkfifo, NO_REGULAR),
    ],
)
def test_what_is_no_file_or_no_folder(
    tmp_path: Path, name: str, place: str, make: Callable[[Path], None], expected: str
) -> None:
    of = Import(name, tmp_path)
    (of.root / place).rename(tmp_path / "elsewhere")
    make(of.root / place)
    assert of.complaint() == f"{'{root}' / Path(place)}: {expected}"


def test_a_camera_that_nobody_asked_for(tmp_path: Path) -> None:
    of = Import("nuscenes", tmp_path)
    for table in ("sensor", "calibrated_sensor"):
        write(of.root / f"v1.0-mini/{table}.json", "[]")
    assert of.complaint() == "{root}: found no camera, expected CAM_FRONT"


@pytest.mark.parametrize("name", ["kitti-odometry", "kitti-raw", "carla"])
def test_frames_are_named_by_plain_digits(tmp_path: Path, name: str) -> None:
    """A superscript is a digit, and no number."""
    of = Import(name, tmp_path)
    num_frames = len(of.run().frames)
    for path in sorted(of.root.rglob("*")):
        if path.is_file() and path.stem.isdecimal():
            for stem in ("²", "abc"):
                (path.parent / f"{stem}{path.suffix}").write_bytes(path.read_bytes())
    assert len(of.run().frames) == num_frames


def test_raw_sweeps_of_kitti_360_are_named_by_plain_digits(tmp_path: Path) -> None:
    of = Import("kitti-360", tmp_path)
    (of.root / "data_3d_semantics").rename(tmp_path / "elsewhere")
    write_cloud(of.root / f"data_3d_raw/{KITTI_360_DRIVE}/velodyne_points/data/abc.bin")
    images = of.root / f"data_2d_raw/{KITTI_360_DRIVE}/image_01/data_rect"
    (images / "0000000250.png").rename(images / "abc.png")
    assert of.complaint() == (
        f"{{root}}: found no frame of {KITTI_360_DRIVE} with points, a pose and an image of image_01"
    )


VERTICES = "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{}end_header\n"
COLUMNS = "".join(f"property float {name}\n" for name in ("x", "y", "z", "semantic", "visible"))


@pytest.mark.parametrize("count", [0, 2])
def test_frames_of_windows_without_points_are_left_out(tmp_path: Path, count: int) -> None:
    """Of no vertices, or of ones that are nowhere; a second window has points."""
    of = Import("kitti-360", tmp_path)
    static = of.root / f"data_3d_semantics/train/{KITTI_360_DRIVE}/static"
    poses = of.root / f"data_poses/{KITTI_360_DRIVE}/poses.txt"
    empty = static / "0000001000_0000001200.ply"
    vertices = np.zeros((count, 5), dtype="<f4")
    vertices[:, :3] = np.nan
    empty.write_bytes(VERTICES.format(count, COLUMNS).encode() + vertices.tobytes())
    rows = poses.read_text().split(maxsplit=1)[1]
    poses.write_text(f"1100 {rows}\n")
    for image in sorted(of.root.rglob("0000000250.png")):
        (image.parent / "0000001100.png").write_bytes(image.read_bytes())
    said = "found no points for any of 1 frame, expected some"
    assert of.complaint().removeprefix("{root}/").endswith(f"{empty.name}: {said}")
    poses.write_text(f"250 {rows}\n1100 {rows}\n")
    assert [frame.points for frame in of.run().frames] == ["points/0000000250.bin"]
    assert "1 frame, 1 cloud converted\n" in of.stderr
    assert "note: left out 1 frame without points\n" in of.stderr
    assert [path.name for path in (of.out / "points").iterdir()] == ["0000000250.bin"]


def test_own_files_whose_names_are_no_text(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    for kind, suffix in (("clouds", "bin"), ("clouds", "label"), ("labels", "png")):
        (tmp_path / f"own/{kind}/000002.{suffix}").rename(tmp_path / f"own/{kind}/\udcff.{suffix}")
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        rf"'{tmp_path}/own/clouds/\udcff.bin': found name '../own/clouds/\udcff.bin', expected UTF-8"
    )
    assert not (tmp_path / "drive").exists()


CLASSES = "ignore: []\nclasses: {car: {ids: [7]}}\n"
REFERENCE = f"semcal_transform: 1\nT_camera_lidar: {np.eye(4).tolist()}\n"


@pytest.mark.parametrize(
    ("option", "content"),
    [
        ("--camera-info", ROS),
        ("--reference", REFERENCE),
        ("--image-classes", CLASSES),
        ("--point-classes", CLASSES),
    ],
)
def test_own_files_that_are_read_are_not_overwritten(tmp_path: Path, option: str, content: str) -> None:
    arguments, own, linked = own_data(tmp_path / "own"), tmp_path / "own/read.yaml", tmp_path / "linked.yaml"
    write(own, content)
    linked.symlink_to(own)
    for output in (own, linked):
        assert complaint("folder", *arguments, option, own, "-o", output) == (
            f"{output}: found a file that this import reads; choose another name"
        )
    assert own.read_text() == content
    run_import("folder", *arguments, option, own, "-o", tmp_path / "drive")


@pytest.mark.parametrize(
    ("name", "arguments", "file"),
    [
        ("rellis-3d", [], "00000/transforms.yaml"),
        ("kitti-360", ["--camera", "image_02"], "calibration/image_02.yaml"),
    ],
)
def test_files_of_a_data_set_are_not_overwritten(
    tmp_path: Path, name: str, arguments: list[str], file: str
) -> None:
    of = Import(name, tmp_path)
    of.out = of.root / file
    before = of.out.read_bytes()
    said = f"{{root}}/{file}: found a file that this import reads; choose another name"
    assert of.complaint(*arguments) == said
    assert of.out.read_bytes() == before


def test_own_files_and_frames_that_differ_need_label_images(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    del arguments[4:6]
    assert complaint("folder", *arguments, "--spread", "-o", tmp_path / "drive") == (
        "--spread: found frames without label images; add --image-labels GLOB"
    )
    stderr = run_import("folder", *arguments, "-o", tmp_path / "drive")
    assert "note: no image labels: a network can make them; add your own with --image-labels" in stderr


def test_a_number_in_a_name_that_is_no_time(tmp_path: Path) -> None:
    """No drive takes seconds of so many digits; names are paired as names."""
    stem = "15816246631490.5"
    write_cloud(tmp_path / f"clouds/{stem}.bin")
    write_labels(tmp_path / f"labels/{stem}.label", [1, 2, 3])
    write(tmp_path / "camera.yaml", ROS)
    patterns = ("--points", tmp_path / "clouds/*", "--point-labels", tmp_path / "labels/*")
    run_import("folder", *patterns, "--camera-info", tmp_path / "camera.yaml", "-o", tmp_path / "drive")
    assert read_drive(tmp_path / "drive").frames[0].points_stamp is None
