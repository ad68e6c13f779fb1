"""`semcal import` of each data set in its real layout, with numbers that can be checked by hand."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from dataset_imports import PRINTED, check_import, complaint, imported, run_import, written_cloud
from dataset_trees import (
    CARLA_PLAIN_PLY,
    FORWARD,
    KITTI_360_DRIVE,
    P2,
    POINTS,
    QUARTER,
    RAW_D,
    RAW_SIZE,
    TREES,
    carla,
    moved,
    numbers,
    write,
    write_cloud,
    write_colors,
    write_ids,
    write_labels,
)

from semcal_cli.datasets.carla import pose_from_unreal
from semcal_cli.drive.document import read_drive

AS_F32 = 1e-3  # coordinates of some kilometres as f32, as KITTI-360 stores them


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


def test_kitti_360_raw_pictures_have_their_own_camera(tmp_path: Path) -> None:
    """Before R_rect, with K, D and S of the file, whose K ends in 0 0 0; labels are of the rectified pictures."""
    tree = TREES["kitti-360"](tmp_path / "tree")
    stderr = run_import("kitti-360", tree.root, "--raw", "--camera", "image_01", "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    expected = np.linalg.inv(QUARTER) @ tree.T_camera_lidar
    np.testing.assert_allclose(drive.T_camera_lidar, expected, atol=PRINTED)
    assert drive.camera.model == "plumb_bob"
    assert (drive.camera.width, drive.camera.height) == RAW_SIZE
    assert drive.camera.K == ((70.0, 0.0, 33.0), (0.0, 69.0, 17.0), (0.0, 0.0, 1.0))
    assert drive.camera.distortion == RAW_D
    assert drive.frames[0].image == f"../tree/data_2d_raw/{KITTI_360_DRIVE}/image_01/data_rgb/0000000250.png"
    assert drive.frames[0].image_labels is None
    assert (
        "note: data_2d_semantics labels rectified pictures: raw ones take theirs from --image-labels\n"
        in stderr
    )
    write_ids(tmp_path / "network/0000000250.png", *RAW_SIZE)
    run_import(
        "kitti-360", tree.root, "--raw", "--image-labels", tmp_path / "network", "-o", tmp_path / "drive"
    )
    assert read_drive(tmp_path / "drive").frames[0].image_labels == "../network/0000000250.png"
    assert written_cloud(read_drive(tmp_path / "drive"))[1].tolist() == [7, 26]


@pytest.mark.parametrize("camera", ["image_00", "image_01", "image_02"])
def test_kitti_360_pictures_are_the_usual_ones_unless_others_are_asked_for(
    tmp_path: Path, camera: str
) -> None:
    """Rectified for the pair; the fisheyes have none but raw ones."""
    tree = TREES["kitti-360"](tmp_path / "tree")
    usual = "--raw" if camera == "image_02" else "--rectified"
    for name, options in (("usual", []), ("named", [usual])):
        run_import("kitti-360", tree.root, "--camera", camera, *options, "-o", tmp_path / name)
    assert (tmp_path / "usual/drive.yaml").read_bytes() == (tmp_path / "named/drive.yaml").read_bytes()


def test_kitti_360_fisheyes_are_never_rectified(tmp_path: Path) -> None:
    tree = TREES["kitti-360"](tmp_path / "tree")
    options = ("--camera", "image_02", "--rectified", "-o", tmp_path / "drive")
    assert complaint("kitti-360", tree.root, *options) == (
        "--rectified: found camera image_02, whose pictures are all raw, needed image_00 or image_01"
    )
    assert not (tmp_path / "drive").exists()


@pytest.mark.parametrize(
    ("key", "values", "expected"),
    [
        ("K_00", "70 0 33 0 69 17 0 0 2", "K_00: found last row [0.0, 0.0, 2.0], needed [0, 0, 1]"),
        ("K_00", "70 0 33 0 69 17 0 0", "K_00: found a list of 8, needed 9 numbers"),
        ("K_00", "0 0 0 0 0 0 0 0 0", "K_00: found focal lengths 0.0 and 0.0, needed both above 0"),
        ("D_00", "-0.3 0.1 0 0", "D_00: found a list of 4, needed 5 numbers"),
        ("S_00", "64.5 32", "S_00: found 64.5, needed a whole number from 1 to 65535"),
    ],
)
def test_kitti_360_wrong_raw_cameras_are_named(tmp_path: Path, key: str, values: str, expected: str) -> None:
    tree = TREES["kitti-360"](tmp_path / "tree")
    path = tree.root / "calibration/perspective.txt"
    text = path.read_text()
    path.write_text(re.sub(rf"^{key}: .*$", f"{key}: {values}", text, flags=re.MULTILINE))
    assert complaint("kitti-360", tree.root, "--raw", "-o", tmp_path / "drive") == f"{path}: {expected}"
    run_import("kitti-360", tree.root, "-o", tmp_path / "drive")  # Rectified pictures need none of it.


def test_kitti_360_raw_pictures_that_are_not_there(tmp_path: Path) -> None:
    tree = TREES["kitti-360"](tmp_path / "tree")
    (tree.root / f"data_2d_raw/{KITTI_360_DRIVE}/image_00/data_rgb").rename(tmp_path / "elsewhere")
    assert complaint("kitti-360", tree.root, "--raw", "-o", tmp_path / "drive") == (
        f"{tree.root}: found no frame of {KITTI_360_DRIVE} with points, a pose and a picture of image_00/data_rgb"
    )


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
    instead = "`semcal calibrate` compares segments and edges instead"
    assert f"note: no labels of points: {instead}; --point-labels DIR takes those that you have\n" in stderr


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
