"""`semcal import` on paths, names and options that cannot be: one line says which, and no file is overwritten."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from camera_infos import ROS
from dataset_imports import complaint, imported, run_import
from dataset_trees import KITTI_360_DRIVE, KITTI_RAW_DRIVE, TREES, own_data, write, write_cloud, write_labels

from semcal_cli.drive.document import read_drive


def a_file(path: Path) -> None:
    path.write_text("")


def a_folder(path: Path) -> None:
    path.mkdir()


def a_pipe(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("name", "place", "make", "expected"),
    [
        *((name, "", a_file, "found a file, needed a folder") for name in TREES),
        ("kitti-odometry", "sequences", a_file, "found a file, needed a folder"),
        ("kitti-odometry", "sequences/00/velodyne", a_file, "found a file, needed a folder"),
        ("kitti-odometry", "sequences/00/velodyne/000000.bin", a_folder, "found a folder, needed a file"),
        ("kitti-odometry", "sequences/00/image_2/000000.png", a_pipe, "found no regular file, needed a file"),
        ("opencalib", "1/calib.pcd", a_pipe, "found no regular file, needed a file"),
        ("nuscenes", "samples/LIDAR_TOP/a__LIDAR_TOP__1.pcd.bin", a_folder, "found a folder, needed a file"),
        ("carla", "labels/000017.png", a_pipe, "found no regular file, needed a file"),
        ("carla", "lidar/000017.ply", a_pipe, "found no regular file, needed a file"),
        (
            "kitti-360",
            f"data_3d_semantics/train/{KITTI_360_DRIVE}/static/0000000002_0000000385.ply",
            a_pipe,
            "found no regular file, needed a file",
        ),
    ],
)
def test_what_is_no_file_or_no_folder(
    tmp_path: Path, name: str, place: str, make: Callable[[Path], None], expected: str
) -> None:
    tree = TREES[name](tmp_path / "tree")
    path = tree.root / place
    path.rename(tmp_path / "elsewhere")
    make(path)
    found = complaint(name, tree.root, *tree.arguments, "-o", tmp_path / "drive")
    assert found == f"{path}: {expected}"
    assert not (tmp_path / "drive").exists()


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        (
            "kitti-odometry",
            ["--camera", "image_x"],
            "{root}/sequences/00: camera: found 'image_x', needed image_2",
        ),
        ("kitti-odometry", ["--image-labels", "/dev/null"], "/dev/null: found a file, needed a folder"),
        (
            "kitti-odometry",
            ["--spread"],
            "--spread: found frames without label images, needed --image-labels DIR",
        ),
        ("kitti-odometry", ["--point-classes", "/dev"], "/dev: found a folder, needed a file"),
        (
            "carla",
            ["--version", "0.9.15", "--image-classes", "{root}/own.yaml"],
            "--image-classes: {root}/own.yaml: class 'far': found id 300, needed at most 255: it is a red",
        ),
        (
            "carla",
            ["--version", "0.9.15", "--point-classes", "{root}/twice.yaml"],
            "{root}/twice.yaml: classes: found color [1, 2, 3] under 'a' and 'b', needed it under one name",
        ),
    ],
)
def test_options_that_cannot_be(tmp_path: Path, name: str, arguments: list[str], expected: str) -> None:
    root = TREES[name](tmp_path / "tree").root
    if name == "kitti-odometry":
        (root / "sequences/00/image_2").rename(root / "sequences/00/image_x")
        (root / "sequences/00/image_2").symlink_to("image_x")
    write(root / "own.yaml", "ignore: []\nclasses: {far: {ids: [300]}}\n")
    color = "color: [1, 2, 3]"
    write(
        root / "twice.yaml", f"ignore: []\nclasses: {{a: {{ids: [1], {color}}}, b: {{ids: [2], {color}}}}}\n"
    )
    here = [argument.replace("{root}", str(root)) for argument in arguments]
    found = complaint(name, root, *here, "-o", tmp_path / "drive")
    assert found == expected.replace("{root}", str(root))


def test_a_camera_that_nobody_asked_for(tmp_path: Path) -> None:
    tree = TREES["nuscenes"](tmp_path / "tree")
    for table in ("sensor", "calibrated_sensor"):
        write(tree.root / f"v1.0-mini/{table}.json", "[]")
    assert complaint("nuscenes", tree.root, "-o", tmp_path / "drive") == (
        f"{tree.root}: found no camera, needed CAM_FRONT"
    )


@pytest.mark.parametrize("name", ["kitti-odometry", "kitti-raw", "carla"])
def test_frames_are_named_by_plain_digits(tmp_path: Path, name: str) -> None:
    """A superscript is a digit, and no number."""
    tree = TREES[name](tmp_path / "tree")
    before = imported(name, tree, tmp_path / "before")
    for path in sorted(tree.root.rglob("*")):
        if path.is_file() and path.stem.isdecimal():
            for stem in ("²", "abc"):
                (path.parent / f"{stem}{path.suffix}").write_bytes(path.read_bytes())
    assert len(imported(name, tree, tmp_path / "drive").frames) == len(before.frames)


def test_raw_sweeps_of_kitti_360_are_named_by_plain_digits(tmp_path: Path) -> None:
    tree = TREES["kitti-360"](tmp_path / "tree")
    (tree.root / "data_3d_semantics").rename(tmp_path / "elsewhere")
    write_cloud(tree.root / f"data_3d_raw/{KITTI_360_DRIVE}/velodyne_points/data/abc.bin")
    pictures = tree.root / f"data_2d_raw/{KITTI_360_DRIVE}/image_00/data_rect"
    (pictures / "0000000250.png").rename(pictures / "abc.png")
    assert complaint("kitti-360", tree.root, "-o", tmp_path / "drive") == (
        f"{tree.root}: found no frame of {KITTI_360_DRIVE} with points, a pose and a picture of image_00"
    )


def test_values_of_an_inertial_packet(tmp_path: Path) -> None:
    tree = TREES["kitti-raw"](tmp_path / "tree")
    packet = tree.root / KITTI_RAW_DRIVE / "oxts/data/0000000000.txt"
    for text, expected in (
        ("1 " * 8, "found 8 values, needed at least 9"),
        ("1 " * 8 + "fast", "value 9: found 'fast', needed a finite number"),
    ):
        write(packet, text)
        assert complaint("kitti-raw", tree.root, "-o", tmp_path / "drive") == f"{packet}: {expected}"


VERTICES = "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{}end_header\n"
COLUMNS = "".join(f"property float {name}\n" for name in ("x", "y", "z", "semantic", "visible"))


@pytest.mark.parametrize("count", [0, 2])
def test_frames_of_windows_without_points_are_left_out(tmp_path: Path, count: int) -> None:
    """Of no vertices, or of ones that are nowhere; a second window has points."""
    tree = TREES["kitti-360"](tmp_path / "tree")
    static = tree.root / f"data_3d_semantics/train/{KITTI_360_DRIVE}/static"
    poses = tree.root / f"data_poses/{KITTI_360_DRIVE}/poses.txt"
    empty = static / "0000001000_0000001200.ply"
    vertices = np.zeros((count, 5), dtype="<f4")
    vertices[:, :3] = np.nan
    empty.write_bytes(VERTICES.format(count, COLUMNS).encode() + vertices.tobytes())
    rows = poses.read_text().split(maxsplit=1)[1]
    poses.write_text(f"250 {rows}\n1100 {rows}\n")
    for picture in sorted(tree.root.rglob("0000000250.png")):
        (picture.parent / "0000001100.png").write_bytes(picture.read_bytes())
    stderr = run_import("kitti-360", tree.root, "-o", tmp_path / "drive")
    assert "1 frames, 1 clouds converted\nnote: 1 frames without points are left out\n" in stderr.replace(
        f"note: raw sweeps carry no labels: points are cut from the accumulated ones in {static}\n", ""
    )
    assert [frame.points for frame in read_drive(tmp_path / "drive").frames] == ["points/0000000250.bin"]
    assert [path.name for path in (tmp_path / "drive/points").iterdir()] == ["0000000250.bin"]
    poses.write_text(f"1100 {rows}\n")
    assert complaint("kitti-360", tree.root, "-o", tmp_path / "none") == (
        f"{empty}: found no points for any of 1 frames, needed some"
    )
    assert not (tmp_path / "none").exists()


def test_own_files_whose_names_are_no_text(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    for kind, suffix in (("clouds", "bin"), ("clouds", "label"), ("labels", "png")):
        (tmp_path / f"own/{kind}/000002.{suffix}").rename(tmp_path / f"own/{kind}/\udcff.{suffix}")
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        rf"'{tmp_path}/own/clouds/\udcff.bin': found name '../own/clouds/\udcff.bin', needed UTF-8"
    )
    assert not (tmp_path / "drive").exists()


@pytest.mark.parametrize("option", ["--camera-info", "--reference", "--image-classes", "--point-classes"])
def test_own_files_that_are_read_are_not_overwritten(tmp_path: Path, option: str) -> None:
    arguments = own_data(tmp_path / "own")
    run_import("folder", *arguments, "-o", tmp_path / "own/drive")
    own = tmp_path / "own/read.yaml"
    contents = {
        "--camera-info": ROS,
        "--reference": (tmp_path / "own/drive/drive.yaml").read_text()
        + f"T_camera_lidar: {np.eye(4).tolist()}\n",
        "--image-classes": "ignore: []\nclasses: {car: {ids: [7]}}\n",
        "--point-classes": "ignore: []\nclasses: {car: {ids: [7]}}\n",
    }
    write(own, contents[option])
    linked = tmp_path / "linked.yaml"
    linked.symlink_to(own)
    for output in (own, linked):
        assert complaint("folder", *arguments, option, own, "-o", output) == (
            f"{output}: found a file that this import reads, needed another name"
        )
    assert own.read_text() == contents[option]
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
    path = TREES[name](tmp_path / "tree").root / file
    before = path.read_bytes()
    assert complaint(name, tmp_path / "tree", *arguments, "-o", path) == (
        f"{path}: found a file that this import reads, needed another name"
    )
    assert path.read_bytes() == before


def test_own_files_and_frames_that_differ_need_label_images(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    del arguments[4:6]
    assert complaint("folder", *arguments, "--spread", "-o", tmp_path / "drive") == (
        "--spread: found frames without label images, needed --image-labels GLOB"
    )
    stderr = run_import("folder", *arguments, "-o", tmp_path / "drive")
    made = "`semcal label` makes them with a network"
    assert f"note: no labels of pictures: {made}; --image-labels GLOB takes those that you have\n" in stderr


def test_a_number_in_a_name_that_is_no_time(tmp_path: Path) -> None:
    """No drive takes seconds of so many digits; names are paired as names."""
    stem = "15816246631490.5"
    write_cloud(tmp_path / f"clouds/{stem}.bin")
    write_labels(tmp_path / f"labels/{stem}.label", [1, 2, 3])
    write(tmp_path / "camera.yaml", ROS)
    patterns = ("--points", tmp_path / "clouds/*", "--point-labels", tmp_path / "labels/*")
    run_import("folder", *patterns, "--camera-info", tmp_path / "camera.yaml", "-o", tmp_path / "drive")
    assert read_drive(tmp_path / "drive").frames[0].points_stamp is None
