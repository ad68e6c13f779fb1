"""`semcal import`, on tiny trees of each data set's real layout, with numbers that can be checked by hand."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import documents
from dataset_trees import (
    CARLA_PLAIN_PLY,
    CARLA_PLY,
    FORWARD,
    KITTI_360_DRIVE,
    P2,
    POINTS,
    TREES,
    Tree,
    carla,
    moved,
    numbers,
    write,
    write_cloud,
    write_colors,
    write_ids,
    write_labels,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from semcal_cli.cli import semcal
from semcal_cli.datasets import DATASETS
from semcal_cli.datasets.carla import pose_from_unreal
from semcal_cli.datasets.ontologies import ontology_names, read_ontology
from semcal_cli.datasets.ply import read_vertices
from semcal_cli.drive.document import Drive, Frame, read_drive
from semcal_cli.errors import InputError

PRINTED = 1e-9  # digits of the generated calibration files
AS_F32 = 1e-3  # coordinates of some kilometres as f32, as KITTI-360 stores them


def run_import(name: str, *arguments: object) -> str:
    """Run the command; what it writes to standard error."""
    result = CliRunner().invoke(semcal, ["import", name, *map(str, arguments)])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stderr


def imported(name: str, tree: Tree, folder: Path, *arguments: object) -> Drive:
    run_import(name, tree.root, *tree.arguments, *arguments, "-o", folder)
    return read_drive(folder)


def test_every_data_set_has_a_tree() -> None:
    assert TREES.keys() == DATASETS.keys()


@pytest.mark.parametrize("name", TREES)
def test_every_import_writes_a_drive(tmp_path: Path, name: str) -> None:
    check_import(name, TREES[name](tmp_path / "tree"), tmp_path / "drives/a")


def check_import(name: str, tree: Tree, folder: Path) -> Drive:
    drive = imported(name, tree, folder)
    np.testing.assert_allclose(drive.T_camera_lidar, tree.T_camera_lidar, atol=PRINTED)
    assert drive.camera.K[0][0] > 0.0
    for frame in drive.frames:
        assert [file for file in named_files(frame) if Path(file).is_absolute()] == []
        assert frame.image_labels or frame.image
    check_files(drive)
    points, image = (drive.classes.points, drive.classes.image) if drive.classes else ({}, {})
    assert {key: list(points[key]) for key in tree.points} == tree.points
    assert {key: list(image[key]) for key in tree.image} == tree.image
    assert (list(drive.ignore.points), list(drive.ignore.image)) == tree.ignored
    return drive


def named_files(frame: Frame) -> list[str]:
    named = (frame.points, frame.point_labels, frame.image_labels, frame.image)
    return [file for file in named if file]


def check_files(drive: Drive) -> None:
    """What a drive names is there."""
    files = [file for frame in drive.frames for file in named_files(frame)]
    assert [file for file in files if not drive.resolve(file).is_file()] == []


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


def written_cloud(drive: Drive, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) and labels (N,) of a converted cloud."""
    points = np.fromfile(drive.resolve(drive.frames[frame].points), dtype="<f4").reshape(-1, 4)
    return points[:, :3], np.fromfile(drive.resolve(str(drive.frames[frame].point_labels)), dtype="<u4")


def complaint(name: str, *arguments: object) -> str:
    with pytest.raises(InputError) as error:
        run_import(name, *arguments)
    return str(error.value)


# KITTI


def test_kitti_object_calibration_is_rectified_and_odometry_is_not(tmp_path: Path) -> None:
    """R0_rect takes back the quarter turn that Tr_velo_to_cam has and Tr has not."""
    tree = TREES["kitti-odometry"](tmp_path / "tree")
    R0_rect = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    unrectified = R0_rect.T @ moved(FORWARD, 0.1, 0.2, 0.3)[:3]
    lines = f"P2: {numbers(P2)}\nR0_rect: {numbers(R0_rect)}\nTr_velo_to_cam: {numbers(unrectified)}\n"
    write(tree.root / "sequences/00/calib.txt", lines)
    drive = imported("kitti-odometry", tree, tmp_path / "drive")
    np.testing.assert_allclose(drive.T_camera_lidar, tree.T_camera_lidar, atol=PRINTED)


def test_a_kitti_point_lands_where_the_projection_says(tmp_path: Path) -> None:
    """P_2 (Tr p), homogeneous, is what the devkit projects with; K and T_camera_lidar have to agree with it."""
    drive = imported("kitti-odometry", TREES["kitti-odometry"](tmp_path / "tree"), tmp_path / "drive")
    K, T = np.array(drive.camera.K), np.array(drive.T_camera_lidar)
    point = np.array([10.0, 1.0, 0.5, 1.0])
    expected = P2 @ moved(FORWARD, 0.1, 0.2, 0.3) @ point
    found = K @ (T @ point)[:3]
    np.testing.assert_allclose(found[:2] / found[2], expected[:2] / expected[2], atol=1e-7)


def test_kitti_stamps_and_speeds(tmp_path: Path) -> None:
    tree = TREES["kitti-raw"](tmp_path / "tree")
    drive = imported("kitti-raw", tree, tmp_path / "drive")
    # 2011-09-26 13:02:25 UTC
    assert [frame.image_stamp for frame in drive.frames] == [1317042145.5, 1317042145.75]
    drive = imported("semantickitti", TREES["semantickitti"](tmp_path / "odometry"), tmp_path / "drive")
    assert [frame.points_stamp for frame in drive.frames] == pytest.approx([0.0, 0.1, 0.2])


# KITTI-360


def test_kitti_360_points_are_cut_from_the_window_around_the_pose(tmp_path: Path) -> None:
    """Of the window in whose middle the frame is: near points that a picture and the LiDAR see, in its frame."""
    tree = TREES["kitti-360"](tmp_path / "tree")
    drive = imported("kitti-360", tree, tmp_path / "drive")
    points, labels = written_cloud(drive)
    np.testing.assert_allclose(points, POINTS[:2, :3], atol=AS_F32)
    assert labels.tolist() == [7, 26]
    assert drive.lidar is None  # accumulated points have no scan pattern


def test_kitti_360_camera_0_is_the_inverse_of_the_twelve_numbers(tmp_path: Path) -> None:
    tree = TREES["kitti-360"](tmp_path / "tree")
    run_import("kitti-360", tree.root, "-o", tmp_path / "drive")
    expected = moved(FORWARD, 0.1, 0.2, 0.3)
    np.testing.assert_allclose(read_drive(tmp_path / "drive").T_camera_lidar, expected, atol=PRINTED)


def test_kitti_360_raw_sweeps_where_there_are_no_windows(tmp_path: Path) -> None:
    tree = TREES["kitti-360"](tmp_path / "tree")
    (tree.root / "data_3d_semantics").rename(tmp_path / "elsewhere")
    write_cloud(tree.root / f"data_3d_raw/{KITTI_360_DRIVE}/velodyne_points/data/0000000250.bin")
    stderr = run_import("kitti-360", tree.root, "-o", tmp_path / "drive")
    frame = read_drive(tmp_path / "drive").frames[0]
    assert frame.points.endswith("velodyne_points/data/0000000250.bin")
    assert "note: raw sweeps carry no labels\n" in stderr
    write_labels(tmp_path / "network/0000000250.label", [1, 2, 3])
    run_import("kitti-360", tree.root, "--point-labels", tmp_path / "network", "-o", tmp_path / "drive")
    assert read_drive(tmp_path / "drive").frames[0].point_labels == "../network/0000000250.label"


def test_kitti_360_points_cut_from_windows_take_no_labels(tmp_path: Path) -> None:
    """No file of labels has their number."""
    tree = TREES["kitti-360"](tmp_path / "tree")
    write_labels(tmp_path / "network/0000000250.label", [1, 2, 3])
    found = complaint(
        "kitti-360", tree.root, "--point-labels", tmp_path / "network", "-o", tmp_path / "drive"
    )
    assert found == (
        f"--point-labels: {tmp_path}/network: found clouds that are cut from accumulated points, with their "
        "labels; needed sweeps, whose points are in the order of the labels"
    )
    assert not (tmp_path / "drive").exists()


def test_kitti_360_fisheye(tmp_path: Path) -> None:
    tree = TREES["kitti-360"](tmp_path / "tree")
    run_import("kitti-360", tree.root, "--camera", "image_02", "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    np.testing.assert_allclose(drive.T_camera_lidar, moved(FORWARD, 0.1, 0.2, 0.3), atol=PRINTED)
    assert drive.camera.parameters == {"xi": 2.213404750785489}
    assert drive.camera.distortion == (
        0.016798235660113681,
        1.6548773243373522,
        0.00042223943394772046,
        0.00042462134260997584,
    )
    assert drive.camera.K[1] == (0.0, 1335.7883350012958, 705.76498308221585)
    # the fisheyes see what the perspective pair does not
    assert written_cloud(drive)[1].tolist() == [7, 26, 26]


# nuScenes


def test_nuscenes_reference_over_several_frames_is_their_mean(tmp_path: Path) -> None:
    """A second keyframe at which the vehicle stands: 0.2 m and 0 m of motion, 0.1 m on average."""
    tree = TREES["nuscenes"](tmp_path / "tree")
    tables = tree.root / "v1.0-mini"
    samples = json.loads((tables / "sample.json").read_text())
    rows = json.loads((tables / "sample_data.json").read_text())
    later = [row | {"token": f"{row['token']}b", "sample_token": "b", "ego_pose_token": "e1"} for row in rows]
    later = [row | {"timestamp": row["timestamp"] + 500_000} for row in later]
    write(tables / "sample.json", json.dumps([*samples, {"token": "b", "scene_token": "scene"}]))
    write(tables / "sample_data.json", json.dumps([*rows, *later]))
    (tables / "lidarseg.json").unlink()
    stderr = run_import("nuscenes", tree.root, "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    np.testing.assert_allclose(drive.T_camera_lidar, moved(tree.T_camera_lidar, 0, 0, 0.1), atol=PRINTED)
    assert "from which they differ by up to 0.10 m and 0.00 deg" in stderr
    assert [frame.points_stamp for frame in drive.frames] == [1.5, 2.0]


def test_nuscenes_predictions_are_named_after_the_sweep(tmp_path: Path) -> None:
    """As the devkit wants them for a submission."""
    tree = TREES["nuscenes"](tmp_path / "tree")
    write_labels(tmp_path / "predicted/d0_lidarseg.bin", [1, 2, 3], "u1")
    drive = imported("nuscenes", tree, tmp_path / "drive", "--point-labels", tmp_path / "predicted")
    assert drive.frames[0].point_labels == "../predicted/d0_lidarseg.bin"


# CARLA


def test_carla_clouds_are_mirrored(tmp_path: Path) -> None:
    tree = TREES["carla"](tmp_path / "tree")
    points, labels = written_cloud(imported("carla", tree, tmp_path / "drive"))
    np.testing.assert_array_equal(points, [[10, 1, 0], [10, -1, 1], [5, 0, -1]])
    assert labels.tolist() == [1, 14, 24]


def test_carla_clouds_without_tags_name_no_labels(tmp_path: Path) -> None:
    tree = carla(tmp_path / "tree", semantic=False)
    drive = check_import("carla", tree, tmp_path / "drive")
    assert [frame.point_labels for frame in drive.frames] == [None, None]
    assert not (tmp_path / "drive/point_labels").exists()
    stderr = run_import("carla", tree.root, *tree.arguments, "-o", tmp_path / "drive")
    assert "note: no labels of points: a calibration needs them, see --point-labels DIR\n" in stderr


@pytest.mark.parametrize("semantic", [False, True])
def test_carla_labels_of_ones_own_go_before_tags(tmp_path: Path, semantic: bool) -> None:
    """A frame without a file is left out: its tags are of other classes."""
    tree = carla(tmp_path / "tree", semantic=semantic)
    write_labels(tmp_path / "network/000018.label", [7, 8, 9])
    drive = imported("carla", tree, tmp_path / "drive", "--point-labels", tmp_path / "network")
    assert [frame.points for frame in drive.frames] == ["points/000018.bin"]
    points, labels = written_cloud(drive)
    np.testing.assert_array_equal(points, [[10, 1, 0], [10, -1, 1], [5, 0, -1]])
    assert labels.tolist() == [7, 8, 9]
    assert not (tmp_path / "drive/point_labels").exists()


def test_a_semantic_carla_cloud_needs_tags(tmp_path: Path) -> None:
    tree = TREES["carla"](tmp_path / "tree")
    write(tree.root / "lidar/000017.ply", CARLA_PLAIN_PLY)
    assert complaint("carla", tree.root, *tree.arguments, "-o", tmp_path / "drive") == (
        f"{tree.root}/lidar/000017.ply: found points without labels, needed a label each"
    )


def test_a_carla_sensor_whose_name_is_too_long_for_a_folder(tmp_path: Path) -> None:
    tree = TREES["carla"](tmp_path / "tree")
    rig = json.loads((tree.root / "sensors.json").read_text())
    rig[0]["id"] = "a" * 300
    write(tree.root / "sensors.json", json.dumps(rig))
    found = complaint("carla", tree.root, *tree.arguments, "-o", tmp_path / "drive")
    assert found == f"{tree.root}/{'a' * 300}: file name too long"


def test_a_carla_yaw_turns_right_and_a_pitch_looks_up() -> None:
    forward = np.array([1.0, 0.0, 0.0, 0.0])
    yawed = pose_from_unreal(0, 0, 0, roll=0, pitch=0, yaw=90)
    pitched = pose_from_unreal(0, 0, 0, roll=0, pitch=90, yaw=0)
    np.testing.assert_allclose(yawed @ forward, [0, -1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(pitched @ forward, [0, 0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(pose_from_unreal(1, 2, 3, 0, 0, 0)[:3, 3], [1, -2, 3])


def test_carla_tags_of_both_releases_and_both_kinds_of_pictures(tmp_path: Path) -> None:
    tree = TREES["carla"](tmp_path / "tree")
    found = {}
    for release in ("0.9.13", "0.9.14"):
        drive = imported("carla", tree, tmp_path / release, "--version", release)
        assert drive.palette
        assert drive.classes
        found[release] = (drive.classes.points["Road"], drive.palette["Road"], drive.palette["Sky"])
    assert found == {"0.9.13": ((7,), (7, 0, 0), (13, 0, 0)), "0.9.14": ((1,), (1, 0, 0), (11, 0, 0))}
    for number in (17, 18):
        write_colors(tree.root / f"labels/{number:06d}.png", (128, 64, 128))
    drive = imported("carla", tree, tmp_path / "colors")
    assert drive.palette
    assert drive.palette["Road"] == (128, 64, 128)
    # one black picture does not make the others raw
    write_colors(tree.root / "labels/000017.png", (0, 0, 0))
    assert imported("carla", tree, tmp_path / "black").palette == drive.palette


def test_a_class_table_is_turned_red_for_raw_carla_pictures(tmp_path: Path) -> None:
    tree = TREES["carla"](tmp_path / "tree")
    palette = imported("carla", tree, tmp_path / "drive", "--image-classes", "carla").palette
    assert palette
    assert palette["Car"] == (14, 0, 0)
    write(tmp_path / "own.yaml", "ignore: []\nclasses: {vehicle: {ids: [14, 15]}}\n")
    arguments = (*tree.arguments, "--image-classes", tmp_path / "own.yaml", "-o", tmp_path / "own")
    assert complaint("carla", tree.root, *arguments) == (
        f"--image-classes: {tmp_path}/own.yaml: class 'vehicle': found 2 ids, needed one: the label images are "
        "colours, and a palette has one colour a class"
    )
    # label images of one's own are no tags
    write_colors(tmp_path / "network/000017.png", (0, 0, 142))
    own = ("--image-labels", tmp_path / "network", "--image-classes", "carla")
    palette = imported("carla", tree, tmp_path / "drive", *own).palette
    assert palette
    assert palette["Car"] == (0, 0, 142)


def test_carla_releases_before_the_known_tables_are_refused(tmp_path: Path) -> None:
    tree = TREES["carla"](tmp_path / "tree")
    for release in ("0.9.9", "0.9.5", "0.8.20"):
        assert complaint("carla", tree.root, "--version", release, "-o", tmp_path / "drive") == (
            f"--version: found {release!r}, needed 0.9.10 or later: earlier tags are not known"
        )
    run_import("carla", tree.root, "--version", "0.9.10", "-o", tmp_path / "drive")


def test_carla_intrinsics(tmp_path: Path) -> None:
    """A right angle over 64 pixels; the axis meets the middle of the picture, between two pixels."""
    camera = imported("carla", TREES["carla"](tmp_path / "tree"), tmp_path / "drive").camera
    np.testing.assert_allclose(camera.K, [[32, 0, 31.5], [0, 32, 15.5], [0, 0, 1]], atol=1e-12)


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


@pytest.mark.parametrize(
    ("name", "file", "content", "expected"),
    [
        ("rellis-3d", "00000/camera_info.txt", "1 2 3", "intrinsics: found 3 numbers, needed 4, all finite"),
        ("rellis-3d", "00000/transforms.yaml", None, "no such file or folder"),
        ("opencalib", "1/calib.txt", "K: 1 2\nD: 1 2 3 4", "K: found 2 numbers, needed 9, all finite"),
        ("opencalib", "1/calib.txt", "D: 1 2 3 4\nT: 1", "found no key 'K', needed one of: D, T"),
        (
            "kitti-odometry",
            "sequences/00/calib.txt",
            "P2: 1",
            "found keys P2, needed Tr, or R0_rect and Tr_velo_to_cam",
        ),
        (
            "kitti-odometry",
            "sequences/00/times.txt",
            "0 x",
            "line 2: found 'x', needed 1 numbers, all finite",
        ),
        (
            "kitti-raw",
            "2011_09_26/2011_09_26_drive_0001_sync/image_02/timestamps.txt",
            "13:02",
            "line 1: found '13:02', needed a time as 2011-09-26 13:02:25.95",
        ),
        (
            "kitti-360",
            "calibration/calib_cam_to_velo.txt",
            "1 2",
            "camera 0 to LiDAR: found 2 numbers, needed 12, all finite",
        ),
        ("nuscenes", "v1.0-mini/ego_pose.json", "[]", "found no row with token 'e0', needed one"),
        ("nuscenes", "v1.0-mini/scene.json", "{}", "found a mapping, needed a list of mappings"),
        ("nuscenes", "samples/LIDAR_TOP/a__LIDAR_TOP__1.pcd.bin", None, "no such file or folder"),
        (
            "carla",
            "sensors.json",
            '[{"type": "sensor.lidar.ray_cast", "id": "a"}]',
            "sensor 'a': x: found nothing, needed a number",
        ),
    ],
)
def test_a_wrong_file_is_named(
    tmp_path: Path, name: str, file: str, content: str | None, expected: str
) -> None:
    tree = TREES[name](tmp_path / "tree")
    path = tree.root / file
    path.unlink()
    if content is not None:
        path.write_text(content)
    assert complaint(name, tree.root, *tree.arguments, "-o", tmp_path / "drive") == f"{path}: {expected}"


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
