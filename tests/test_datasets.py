"""`semcal import` of every data set: the drive it writes, its options, and what it says of a wrong file."""

import json
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import documents
from dataset_imports import check_files, check_import, complaint, imported, run_import
from dataset_trees import (
    CARLA_PLY,
    TREES,
    Tree,
    moved,
    numbers,
    write,
    write_colors,
    write_ids,
    write_labels,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from semcal_cli.cli import semcal
from semcal_cli.datasets import DATASETS
from semcal_cli.datasets.kitti_360_windows import read_vertices
from semcal_cli.datasets.ontologies import ontology_names, read_ontology
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError


def test_every_data_set_has_a_tree() -> None:
    assert TREES.keys() == DATASETS.keys()


@pytest.mark.parametrize("name", TREES)
def test_every_import_writes_a_drive(tmp_path: Path, name: str) -> None:
    check_import(name, TREES[name](tmp_path / "tree"), tmp_path / "drives/a")


@pytest.mark.parametrize("name", [name for name in TREES if name != "kitti-360"])
def test_every_import_takes_labels_of_points_from_a_folder(tmp_path: Path, name: str) -> None:
    """Named as the clouds; the labels and classes of the data set are forgotten."""
    tree = TREES[name](tmp_path / "tree")
    clouds = [Path(frame.points) for frame in imported(name, tree, tmp_path / "drive").frames]
    labels = [f"{cloud.name.removesuffix('.bin').removesuffix('.pcd')}.label" for cloud in clouds]
    for label in labels:
        write_labels(tmp_path / "network" / label, [1, 2, 3])
    drive = imported(name, tree, tmp_path / "drive", "--point-labels", tmp_path / "network")
    assert [frame.point_labels for frame in drive.frames] == [f"../network/{label}" for label in labels]
    assert not drive.classes or not drive.classes.points
    assert not drive.ignore or not drive.ignore.points
    check_files(drive)


def test_frames_of_one_calibration_make_a_drive(tmp_path: Path) -> None:
    """Those of most frames, or of the frame that is named; one file may be that of all frames."""
    tree = TREES["kitti-object"](tmp_path / "tree")
    said = run_import("kitti-object", tree.root, "-o", tmp_path / "most")
    assert "the 2 frames with the calibration of 000000 are taken; others by --sequence" in said
    assert "which names a frame: 000002 (1)" in said
    run_import("kitti-object", tree.root, "--sequence", "000002", "-o", tmp_path / "named")
    most, named = (read_drive(tmp_path / name) for name in ("most", "named"))
    assert [len(drive.frames) for drive in (most, named)] == [2, 1]
    assert [drive.camera.K[0][0] for drive in (most, named)] == [50.0, 60.0]
    folder = tree.root / "training"
    (folder / "calib/000001.txt").rename(folder / "calib.txt")
    shutil.rmtree(folder / "calib")
    said = run_import("kitti-object", folder, "-o", tmp_path / "all")
    assert "--sequence" not in said
    assert len(read_drive(tmp_path / "all").frames) == 3


# Options


def test_frames_are_chosen(tmp_path: Path) -> None:
    tree = TREES["kitti-odometry"](tmp_path / "tree", num_frames=11)

    def chosen(*arguments: object) -> list[int]:
        drive = imported("kitti-odometry", tree, tmp_path / "drive", *arguments)
        return [int(Path(frame.points).stem) for frame in drive.frames]

    assert chosen() == list(range(11))
    assert chosen("--frames", "2:9:3") == [2, 5, 8]
    assert chosen("--frames", "-2:") == [9, 10]
    assert chosen("--max-frames", 3) == [0, 5, 10]
    assert chosen("--max-frames", 1) == [0]


def test_spread_keeps_slow_frames_that_differ(tmp_path: Path) -> None:
    """Eight frames, of which the rig stands in the last five; of these two have label images of their own."""
    tree = TREES["kitti-odometry"](tmp_path / "tree", num_frames=8)
    positions = [0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0]
    poses = [numbers(moved(np.eye(4), 0, 0, z)[:3]) for z in positions]
    write(tree.root / "poses/00.txt", "\n".join(poses))
    for number in range(8):
        value = {0: 1, 1: 2, 5: 3, 7: 4}.get(number, 0)
        write_ids(tmp_path / f"labels/{number:06d}.png", value=value)
    labels = ("--image-labels", tmp_path / "labels")
    drive = imported("kitti-odometry", tree, tmp_path / "drive", *labels, "--spread", "--max-frames", 3)
    assert [Path(frame.points).stem for frame in drive.frames] == ["000004", "000005", "000007"]


def test_labels_of_ones_own_networks(tmp_path: Path) -> None:
    """Frames that lack a label are left out and counted; classes are those that are named."""
    tree = TREES["rellis-3d"](tmp_path / "tree")
    for name in ("frame000104-1581624663_149", "000106"):  # as the picture, or as the frame
        write_ids(tmp_path / f"image/{name}.png", 1920, 1200)
    for number in (104, 105, 106):
        write_labels(tmp_path / f"points/{number:06d}.label", [1, 2, 3])
    folders = ("--image-labels", tmp_path / "image", "--point-labels", tmp_path / "points")
    named = (*folders, "--image-classes", "cityscapes-train")
    stderr = run_import("rellis-3d", tree.root, *named, "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert "note: 1 frames without labels of pictures are left out" in stderr
    assert [Path(frame.points).stem for frame in drive.frames] == ["000104", "000106"]
    assert drive.frames[0].point_labels == "../points/000104.label"
    assert drive.classes
    assert drive.classes.points == {}
    assert drive.classes.image["road"] == (0,)
    assert drive.ignore.image == (255,)


def test_labels_that_no_frame_has_on_both_sides(tmp_path: Path) -> None:
    tree = TREES["kitti-odometry"](tmp_path / "tree")
    write_labels(tmp_path / "points/000000.label", [1, 2, 3])
    write_ids(tmp_path / "image/000001.png")
    folders = ("--image-labels", tmp_path / "image", "--point-labels", tmp_path / "points")
    assert complaint("kitti-odometry", tree.root, *folders, "-o", tmp_path / "drive") == (
        "found 1 frames with labels of points and 1 with labels of pictures, none of 3 with both, "
        "needed at least one"
    )


def test_colour_coded_labels_need_a_table_with_colours(tmp_path: Path) -> None:
    tree = TREES["kitti-odometry"](tmp_path / "tree", num_frames=1)
    write_colors(tmp_path / "labels/000000.png", (128, 64, 128))
    arguments = (tree.root, "--image-labels", tmp_path / "labels", "-o", tmp_path / "drive")
    assert complaint("kitti-odometry", *arguments) == (
        f"{tmp_path}/labels/000000.png: found colours, needed ids, or a table of their colours by --image-classes"
    )
    run_import("kitti-odometry", *arguments, "--image-classes", "cityscapes")
    palette = read_drive(tmp_path / "drive").palette
    assert palette
    assert palette["road"] == (128, 64, 128)


def test_pairs_far_apart_in_time_are_left_out(tmp_path: Path) -> None:
    tree = TREES["nuscenes"](tmp_path / "tree")
    run_import("nuscenes", tree.root, "--max-gap-s", "0.026", "-o", tmp_path / "drive")
    assert complaint("nuscenes", tree.root, "--max-gap-s", "0.024", "-o", tmp_path / "drive") == (
        "--max-gap-s: found 1 pairs, none within 0.024 s, needed at least one"
    )
    assert complaint("nuscenes", tree.root, "--frames", "1:", "-o", tmp_path / "drive") == (
        "--frames: found 1 frames, none of those asked for, needed at least one"
    )


def test_a_failed_import_leaves_the_drive_as_it_was(tmp_path: Path) -> None:
    tree = TREES["carla"](tmp_path / "tree")
    imported("carla", tree, tmp_path / "drive")
    before = (tmp_path / "drive/drive.yaml").read_bytes()
    write(tree.root / "lidar/000018.ply", CARLA_PLY[:-30])
    message = complaint("carla", tree.root, *tree.arguments, "--frames", "1:", "-o", tmp_path / "drive")
    assert message == f"{tree.root}/lidar/000018.ply: point 1: found too few values"
    assert (tmp_path / "drive/drive.yaml").read_bytes() == before


@pytest.mark.parametrize("frames", ["5", "0:9:0", "0:9:-1", "a:b", "1:2:3:4", "9" * 5000 + ":"])
def test_frames_that_are_no_slice_are_wrong_usage(tmp_path: Path, frames: str) -> None:
    result = CliRunner().invoke(semcal, ["import", "carla", ".", "-o", str(tmp_path), "--frames", frames])
    assert result.exit_code == 2
    assert "needed START:STOP or START:STOP:STEP, with a step of at least 1" in result.stderr


@pytest.mark.parametrize("name", ontology_names())
def test_class_tables(name: str) -> None:
    """No id has two names, none is both named and ignored, and no two classes share a colour."""
    table = read_ontology(name)
    ids = [id_ for named in table.classes.values() for id_ in named.ids]
    assert len(set(ids)) == len(ids)
    assert not set(ids) & set(table.ignore)
    colors = list(map(tuple, table.palette().values()))
    assert len(set(colors)) == len(colors)


# Complaints


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("rellis-3d", ["--sequence", "00007"], ": sequence: found '00007', needed 00000"),
        ("opencalib", [], ": sequence: none given, needed one of: 1, 3"),
        ("opencalib", ["--sequence", "2"], ": sequence: found '2', needed one of: 1, 3"),
        (
            "kitti-object",
            ["--sequence", "7"],
            "/training: sequence: found '7', needed one of: 000000, 000001, 000002",
        ),
        ("kitti-odometry", ["--camera", "image_3"], "/sequences/00: camera: found 'image_3', needed image_2"),
        ("nuscenes", ["--camera", "CAM_LEFT"], ": camera: found 'CAM_LEFT', needed CAM_FRONT"),
        ("nuscenes", ["--sequence", "scene-1"], ": sequence: found 'scene-1', needed scene-0061"),
        (
            "kitti-360",
            ["--camera", "left"],
            ": camera: found 'left', needed one of: image_00, image_01, image_02, image_03",
        ),
        (
            "carla",
            [],
            "--version: none given, needed CARLA's release as 0.9.15: its tags changed at 0.9.14",
        ),
        (
            "rellis-3d",
            ["--point-classes", "kitti"],
            "found class table 'kitti', needed a file or one of: " + ", ".join(ontology_names()),
        ),
    ],
)
def test_what_is_not_there_is_named_with_what_is(
    tmp_path: Path, name: str, arguments: list[str], expected: str
) -> None:
    tree = TREES[name](tmp_path / "tree")
    found = complaint(name, tree.root, *arguments, "-o", tmp_path / "drive")
    assert found == (f"{tree.root}{expected}" if expected[0] in ":/" else expected)
    assert not (tmp_path / "drive").exists()


VERTEX = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty uchar label\nend_header\n"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", "found no PLY header, needed one"),
        ("ply\nformat ascii 1.0\n", "found no PLY header, needed one"),
        (
            VERTEX.format("binary", 0),
            "found format binary, needed one of: binary_little_endian, binary_big_endian",
        ),
        (
            VERTEX.format("binary_big_endian", "-1"),
            "found first element vertex -1, needed vertex and its number",
        ),
        (
            VERTEX.format("binary_big_endian", 10**12) + "1 2\n",
            "found 4 bytes after the header, needed 1,000,000,000,000 vertices",
        ),
        (
            VERTEX.format("binary_little_endian", 2) + "123456789",
            "found 9 bytes after the header, needed 2 vertices",
        ),
        (
            VERTEX.format("binary_big_endian", 1).replace("float x", "list uchar int x"),
            "found vertices without properties or with lists, needed plain numbers",
        ),
        (
            VERTEX.format("binary_big_endian", 1).replace("label", "x"),
            "found a property twice in x, x, needed each once",
        ),
    ],
)
def test_wrong_ply(tmp_path: Path, content: str, expected: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(content.encode())
    with pytest.raises(InputError) as error:
        read_vertices(path)
    assert str(error.value) == f"{path}: {expected}"


@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian"])
def test_ply_of_every_format(tmp_path: Path, form: str) -> None:
    vertices = np.array([(1.5, 7), (-2.0, 255)], dtype=[("x", "<f4"), ("label", "u1")])
    swapped = vertices.astype([("x", ">f4"), ("label", "u1")]) if "big" in form else vertices
    (tmp_path / "a.ply").write_bytes(VERTEX.format(form, 2).encode() + swapped.tobytes())
    assert read_vertices(tmp_path / "a.ply").tolist() == vertices.tolist()


TEXTS = {".txt", ".json", ".yaml", ".ply"}


@pytest.mark.parametrize("name", TREES)
@settings(max_examples=30)
@given(data=st.data())
def test_a_damaged_file_is_one_line_of_input_error(
    tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    tree = damaged_tree(name, str(tmp_path_factory.getbasetemp() / f"damaged_{name}"))
    path = data.draw(st.sampled_from(sorted(p for p in tree.root.rglob("*") if p.suffix in TEXTS)))
    whole = path.read_bytes()
    try:
        path.write_bytes(data.draw(damage(path, whole)))
        run_import(name, tree.root, *tree.arguments, "-o", tree.root.parent / "drive")
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017
    finally:
        path.write_bytes(whole)


@cache
def damaged_tree(name: str, root: str) -> Tree:
    return TREES[name](Path(root) / "tree")


@st.composite
def damage(draw: st.DrawFn, path: Path, whole: bytes) -> bytes:
    """Cut something out, put something in, or replace a value of JSON by anything."""
    if path.suffix == ".json" and draw(st.booleans()):
        return json.dumps(near_miss(draw, json.loads(whole))).encode()
    at = draw(st.integers(0, len(whole)))
    inserted = draw(
        st.sampled_from([b"", b"nan ", b"-", b"1e999 ", b"[", b"\xff", b"\n"]) | st.binary(max_size=4)
    )
    return whole[:at] + inserted + whole[at + draw(st.integers(0, 12)) :]


def near_miss(draw: st.DrawFn, document: Any) -> Any:
    node = document
    while True:
        key = draw(st.sampled_from(list(node) if isinstance(node, dict) else range(len(node))))
        if not isinstance(node[key], dict | list) or not node[key] or draw(st.booleans()):
            node[key] = draw(documents)
            return document
        node = node[key]
