"""`semcal import` of every data set: the drive it writes, its options, and what it says of what is not there."""

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from commands import invoke, unwrapped
from dataset_imports import Import, check_files
from dataset_trees import (
    CARLA_PLY,
    KITTI_RAW_DRIVE,
    TREES,
    kitti_odometry,
    moved,
    numbers,
    write,
    write_colors,
    write_ids,
    write_labels,
)

from semcal_cli.errors import InputError
from semcal_cli.importing import DATASETS
from semcal_cli.importing.kitti_360_windows import read_vertices
from semcal_cli.importing.ontologies import ontology_names, read_ontology


def test_every_data_set_has_a_tree() -> None:
    assert TREES.keys() == DATASETS.keys()


@pytest.mark.parametrize("name", TREES)
def test_every_import_writes_a_drive(tmp_path: Path, name: str) -> None:
    Import(name, tmp_path).check()


@pytest.mark.parametrize("name", [name for name in TREES if name != "kitti-360"])
def test_every_import_takes_labels_of_points_from_a_folder(tmp_path: Path, name: str) -> None:
    """Named as the clouds; the labels and classes of the data set are forgotten."""
    of = Import(name, tmp_path)
    clouds = [Path(frame.points) for frame in of.run().frames]
    labels = [f"{cloud.name.removesuffix('.bin').removesuffix('.pcd')}.label" for cloud in clouds]
    for label in labels:
        write_labels(tmp_path / "network" / label, [1, 2, 3])
    drive = of.run("--point-labels", tmp_path / "network")
    assert [frame.point_labels for frame in drive.frames] == [f"../network/{label}" for label in labels]
    assert not drive.classes or not drive.classes.points
    assert not drive.ignore or not drive.ignore.points
    check_files(drive)


def test_frames_of_one_calibration_make_a_drive(tmp_path: Path) -> None:
    """Those of most frames, or of the frame that is named; one file may be that of all frames."""
    of = Import("kitti-object", tmp_path)
    most = of.run()
    assert "the 2 frames with the calibration of 000000 are used; --sequence FRAME" in unwrapped(of.stderr, 6)
    assert "selects others: 000002 (1)" in unwrapped(of.stderr, 6)
    named = of.run("--sequence", "000002", "--force")
    assert [len(drive.frames) for drive in (most, named)] == [2, 1]
    assert [drive.camera.K[0][0] for drive in (most, named)] == [50.0, 60.0]
    folder = of.root / "training"
    (folder / "calib/000001.txt").rename(folder / "calib.txt")
    shutil.rmtree(folder / "calib")
    of.root = folder
    assert len(of.run().frames) == 3
    assert "--sequence" not in of.stderr


def test_several_sequences_make_one_drive(tmp_path: Path) -> None:
    of = Import("kitti-raw", tmp_path)
    first = of.root / KITTI_RAW_DRIVE
    second = first.with_name("2011_09_26_drive_0002_sync")
    shutil.copytree(first, second)
    sequences = "--sequence", first.name, "--sequence", second.name
    drive = of.run(*sequences)
    assert [first.name in frame.points for frame in drive.frames] == [True, True, False, False]
    check_files(drive)
    (tmp_path / "labels").mkdir()
    found = of.complaint(*sequences, "--point-labels", tmp_path / "labels", "--force")
    assert "--sequence: found frame 0000000000 in " in found
    assert "import each sequence alone, and use `semcal merge`" in found


# Options


def test_only_a_drive_of_the_same_data_is_replaced(tmp_path: Path) -> None:
    of = Import("kitti-odometry", tmp_path / "a")
    of.run()
    assert len(of.run("--max-frames", 1).frames) == 1
    path = of.out / "drive.yaml"
    whole = path.read_text()
    labelled = whole + "networks: {image: {name: net.onnx, sha256: {}}}\n"
    other = Import("kitti-object", tmp_path / "b")
    other.run()
    for content, found in (
        ("mine: 1\n", "a file that cannot be read as a drive"),
        (labelled, "a drive with labels of networks"),
        ((other.out / "drive.yaml").read_text(), "a drive of other data"),
    ):
        path.write_text(content)
        assert of.complaint() == f"{path}: found {found}; choose another -o, or --force"
        assert path.read_text() == content
    of.run("--max-frames", 1, "--force")
    assert path.read_text() == whole


def test_frames_are_chosen(tmp_path: Path) -> None:
    of = Import("kitti-odometry", tmp_path, partial(kitti_odometry, num_frames=11))

    def chosen(*arguments: object) -> list[int]:
        return [int(Path(frame.points).stem) for frame in of.run(*arguments).frames]

    assert chosen() == list(range(11))
    assert chosen("--frames", "2:9:3") == [2, 5, 8]
    assert chosen("--frames", "-2:") == [9, 10]
    assert chosen("--max-frames", 3) == [0, 5, 10]
    assert chosen("--max-frames", 1) == [0]


def test_spread_keeps_slow_frames_that_differ(tmp_path: Path) -> None:
    """Eight frames, of which the rig stands in the last five; of these two have label images of their own."""
    of = Import("kitti-odometry", tmp_path, partial(kitti_odometry, num_frames=8))
    poses = [numbers(moved(np.eye(4), 0, 0, z)[:3]) for z in (0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0)]
    write(of.root / "poses/00.txt", "\n".join(poses))
    for number in range(8):
        value = {0: 1, 1: 2, 5: 3, 7: 4}.get(number, 0)
        write_ids(tmp_path / f"labels/{number:06d}.png", value=value)
    drive = of.run("--image-labels", tmp_path / "labels", "--spread", "--max-frames", 3)
    assert [Path(frame.points).stem for frame in drive.frames] == ["000004", "000005", "000007"]


def test_labels_of_ones_own_networks(tmp_path: Path) -> None:
    """Frames that lack a label are left out and counted; classes are those that are named."""
    of = Import("rellis-3d", tmp_path)
    for name in ("frame000104-1581624663_149", "000106"):  # as the image, or as the frame
        write_ids(tmp_path / f"image/{name}.png", 1920, 1200)
    for number in (104, 105, 106):
        write_labels(tmp_path / f"points/{number:06d}.label", [1, 2, 3])
    folders = ("--image-labels", tmp_path / "image", "--point-labels", tmp_path / "points")
    drive = of.run(*folders, "--image-classes", "cityscapes-train")
    assert "note: left out 1 frame without image labels" in of.stderr
    assert [Path(frame.points).stem for frame in drive.frames] == ["000104", "000106"]
    assert drive.frames[0].point_labels == "../points/000104.label"
    assert drive.classes
    assert (drive.classes.points, drive.classes.image["road"], drive.ignore.image) == ({}, (0,), (255,))


def test_labels_that_no_frame_has_on_both_sides(tmp_path: Path) -> None:
    write_labels(tmp_path / "points/000000.label", [1, 2, 3])
    write_ids(tmp_path / "image/000001.png")
    folders = ("--image-labels", tmp_path / "image", "--point-labels", tmp_path / "points")
    assert Import("kitti-odometry", tmp_path).complaint(*folders) == (
        "found 1 frame with point labels and 1 with image labels, none of 3 with both, needed at least one"
    )


def test_colour_coded_labels_need_a_table_with_colours(tmp_path: Path) -> None:
    of = Import("kitti-odometry", tmp_path)
    file = tmp_path / "labels/000000.png"
    write_colors(file, (128, 64, 128))
    assert of.complaint("--image-labels", file.parent) == (
        f"{file}: found colours, expected ids, or a class table with these colours with --image-classes"
    )
    palette = of.run("--image-labels", file.parent, "--image-classes", "cityscapes").palette
    assert palette
    assert palette["road"] == (128, 64, 128)


def test_a_failed_import_leaves_the_drive_as_it_was(tmp_path: Path) -> None:
    of = Import("carla", tmp_path)
    of.run()
    before = (of.out / "drive.yaml").read_bytes()
    write(of.root / "lidar/000018.ply", CARLA_PLY[:-30])
    assert of.complaint("--frames", "1:") == "{root}/lidar/000018.ply: point 1: found too few values"
    assert (of.out / "drive.yaml").read_bytes() == before


@pytest.mark.parametrize("frames", ["5", "0:9:0", "a:b", "1:2:3:4", "9" * 5000 + ":"])
def test_frames_that_are_no_slice_are_wrong_usage(tmp_path: Path, frames: str) -> None:
    result = invoke("import", "carla", ".", "-o", tmp_path, "--frames", frames)
    assert result.exit_code == 2
    assert "expected START:STOP or START:STOP:STEP, with a step of at least 1" in result.stderr


@pytest.mark.parametrize("name", ontology_names())
def test_class_tables(name: str) -> None:
    """No id has two names, none is both named and ignored, and no two classes share a colour."""
    table = read_ontology(name)
    ids = [id_ for named in table.classes.values() for id_ in named.ids]
    colors = list(map(tuple, table.palette().values()))
    assert (len(set(ids)), len(set(colors))) == (len(ids), len(colors))
    assert not set(ids) & set(table.ignore)


# PLY

VERTEX = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty uchar label\nend_header\n"
LITTLE, BIG = "binary_little_endian", "binary_big_endian"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("ply\nformat ascii 1.0\n", "found no PLY header"),
        (VERTEX.format("binary", 0), f"found format binary, expected one of: {LITTLE}, {BIG}"),
        (VERTEX.format(BIG, "-1"), "found first element vertex -1, expected vertex and a count"),
        (
            VERTEX.format(BIG, 10**12) + "1 2\n",
            "found 4 bytes after the header, needed 1,000,000,000,000 vertices",
        ),
        (
            VERTEX.format(BIG, 1).replace("float x", "list uchar int x"),
            "found vertices without properties or with lists, expected plain numbers",
        ),
        (VERTEX.format(BIG, 1).replace("label", "x"), "found a property twice in x, x, expected each once"),
    ],
)
def test_wrong_ply(tmp_path: Path, content: str, expected: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(content.encode())
    with pytest.raises(InputError) as error:
        read_vertices(path)
    assert str(error.value) == f"{path}: {expected}"


@pytest.mark.parametrize(("form", "sign"), [(LITTLE, "<"), (BIG, ">")])
def test_ply_of_every_format(tmp_path: Path, form: str, sign: str) -> None:
    vertices = np.array([(1.5, 7), (-2.0, 255)], dtype=[("x", f"{sign}f4"), ("label", "u1")])
    (tmp_path / "a.ply").write_bytes(VERTEX.format(form, 2).encode() + vertices.tobytes())
    assert read_vertices(tmp_path / "a.ply").tolist() == vertices.tolist()
