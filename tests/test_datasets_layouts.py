"""`semcal import` of each data set in its real layout, with numbers that can be checked by hand."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from dataset_imports import PRINTED, Import, written_cloud
from dataset_trees import (
    CARLA_PLAIN_PLY,
    FORWARD,
    KITTI_360_DRIVE,
    P2,
    POINTS,
    QUARTER,
    RAW_D,
    RAW_SIZE,
    carla,
    moved,
    numbers,
    write,
    write_cloud,
    write_colors,
    write_ids,
    write_labels,
)

from semcal_cli.importing.carla import pose_from_unreal

AS_F32 = 1e-3  # coordinates of some kilometres as f32, as KITTI-360 stores them

# KITTI


def test_kitti_object_calibration_is_rectified_and_odometry_is_not(tmp_path: Path) -> None:
    """R0_rect takes back the quarter turn that Tr_velo_to_cam has and Tr has not."""
    of = Import("kitti-odometry", tmp_path)
    R0_rect = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    unrectified = R0_rect.T @ moved(FORWARD, 0.1, 0.2, 0.3)[:3]
    lines = f"P2: {numbers(P2)}\nR0_rect: {numbers(R0_rect)}\nTr_velo_to_cam: {numbers(unrectified)}\n"
    write(of.root / "sequences/00/calib.txt", lines)
    np.testing.assert_allclose(of.run().T_camera_lidar, of.tree.T_camera_lidar, atol=PRINTED)


def test_a_kitti_point_lands_where_the_projection_says(tmp_path: Path) -> None:
    """P_2 (Tr p), homogeneous, is what the devkit projects with; K and T_camera_lidar have to agree with it."""
    drive = Import("kitti-odometry", tmp_path).run()
    K, T = np.array(drive.camera.K), np.array(drive.T_camera_lidar)
    point = np.array([10.0, 1.0, 0.5, 1.0])
    expected = P2 @ moved(FORWARD, 0.1, 0.2, 0.3) @ point
    found = K @ (T @ point)[:3]
    np.testing.assert_allclose(found[:2] / found[2], expected[:2] / expected[2], atol=1e-7)


@pytest.mark.parametrize(
    ("name", "stamps"),
    [
        ("kitti-raw", [1317042145.5, 1317042145.75]),  # 2011-09-26 13:02:25 UTC
        ("semantickitti", [0.0, 0.1, 0.2]),
    ],
)
def test_kitti_stamps(tmp_path: Path, name: str, stamps: list[float]) -> None:
    frames = Import(name, tmp_path).run().frames
    assert [frame.image_stamp for frame in frames] == pytest.approx(stamps)
    assert [frame.points_stamp for frame in frames] == pytest.approx(stamps)


# KITTI-360


@pytest.fixture
def kitti_360(tmp_path: Path) -> Import:
    of = Import("kitti-360", tmp_path)
    write_labels(tmp_path / "network/0000000250.label", [1, 2, 3])
    return of


def test_kitti_360_points_are_cut_from_the_window_around_the_pose(kitti_360: Import) -> None:
    """Of the window in whose middle the frame is: near points that an image and the LiDAR see, in its frame.

    No file of labels has their number, and they have no scan pattern.
    """
    drive = kitti_360.run()
    points, labels = written_cloud(drive)
    np.testing.assert_allclose(points, POINTS[:2, :3], atol=AS_F32)
    assert labels.tolist() == [7, 26]
    assert drive.lidar is None
    network = kitti_360.out.parent / "network"
    assert kitti_360.complaint("--point-labels", network) == (
        f"--point-labels: {network}: found clouds that are cut from accumulated points together with their labels; "
        "expected sweeps, whose points are in the order of the labels"
    )


def test_kitti_360_raw_sweeps_where_there_are_no_windows(kitti_360: Import, tmp_path: Path) -> None:
    (kitti_360.root / "data_3d_semantics").rename(tmp_path / "elsewhere")
    write_cloud(kitti_360.root / f"data_3d_raw/{KITTI_360_DRIVE}/velodyne_points/data/0000000250.bin")
    frame = kitti_360.run("--point-labels", tmp_path / "network").frames[0]
    assert frame.points.endswith("velodyne_points/data/0000000250.bin")
    assert frame.point_labels == "../network/0000000250.label"
    assert "note: raw sweeps carry no labels\n" in kitti_360.stderr


def test_kitti_360_fisheye(kitti_360: Import) -> None:
    """It sees what the perspective pair does not; camera 0 is the inverse of the twelve numbers."""
    drive = kitti_360.run("--camera", "image_02")
    np.testing.assert_allclose(drive.T_camera_lidar, moved(FORWARD, 0.1, 0.2, 0.3), atol=PRINTED)
    assert drive.camera.parameters == {"xi": 2.213404750785489}
    assert drive.camera.distortion == (
        *(0.016798235660113681, 1.6548773243373522, 0.00042223943394772046, 0.00042462134260997584),
    )
    assert drive.camera.K[1] == (0.0, 1335.7883350012958, 705.76498308221585)
    assert written_cloud(drive)[1].tolist() == [7, 26, 26]


def test_kitti_360_raw_images_have_their_own_camera(kitti_360: Import, tmp_path: Path) -> None:
    """Before R_rect, with K, D and S of the file, whose K ends in 0 0 0; labels are of the rectified images."""
    drive = kitti_360.run("--raw", "--camera", "image_01")
    expected = np.linalg.inv(QUARTER) @ kitti_360.tree.T_camera_lidar
    np.testing.assert_allclose(drive.T_camera_lidar, expected, atol=PRINTED)
    assert (drive.camera.model, drive.camera.width, drive.camera.height) == ("plumb_bob", *RAW_SIZE)
    assert drive.camera.K == ((70.0, 0.0, 33.0), (0.0, 69.0, 17.0), (0.0, 0.0, 1.0))
    assert drive.camera.distortion == RAW_D
    assert drive.frames[0].image == f"../tree/data_2d_raw/{KITTI_360_DRIVE}/image_01/data_rgb/0000000250.png"
    assert drive.frames[0].image_labels is None
    said = "note: data_2d_semantics labels only rectified images: give labels of raw"
    assert said in kitti_360.stderr
    write_ids(tmp_path / "images/0000000250.png", *RAW_SIZE)
    drive = kitti_360.run("--raw", "--image-labels", tmp_path / "images")
    assert drive.frames[0].image_labels == "../images/0000000250.png"
    assert written_cloud(drive)[1].tolist() == [7, 26]


@pytest.mark.parametrize(("camera", "usual"), [("image_00", "--rectified"), ("image_02", "--raw")])
def test_kitti_360_images_are_the_usual_ones_unless_others_are_asked_for(
    kitti_360: Import, camera: str, usual: str
) -> None:
    """Rectified for the pair; the fisheyes have none but raw ones."""
    assert kitti_360.run("--camera", camera) == kitti_360.run("--camera", camera, usual)


def test_kitti_360_images_that_are_not_there(kitti_360: Import, tmp_path: Path) -> None:
    (kitti_360.root / f"data_2d_raw/{KITTI_360_DRIVE}/image_00/data_rgb").rename(tmp_path / "elsewhere")
    assert kitti_360.complaint("--raw", "--camera", "image_00") == (
        f"{{root}}: found no frame of {KITTI_360_DRIVE} with points, a pose and an image of image_00/data_rgb"
    )


# nuScenes


def test_nuscenes_reference_over_several_frames_is_their_mean(tmp_path: Path) -> None:
    """A second keyframe at which the vehicle stands: 0.2 m and 0 m of motion, 0.1 m on average."""
    of = Import("nuscenes", tmp_path)
    tables = of.root / "v1.0-mini"
    samples = json.loads((tables / "sample.json").read_text())
    rows = json.loads((tables / "sample_data.json").read_text())
    later = [row | {"token": f"{row['token']}b", "sample_token": "b", "ego_pose_token": "e1"} for row in rows]
    later = [row | {"timestamp": row["timestamp"] + 500_000} for row in later]
    write(tables / "sample.json", json.dumps([*samples, {"token": "b", "scene_token": "scene"}]))
    write(tables / "sample_data.json", json.dumps([*rows, *later]))
    (tables / "lidarseg.json").unlink()
    drive = of.run()
    np.testing.assert_allclose(drive.T_camera_lidar, moved(of.tree.T_camera_lidar, 0, 0, 0.1), atol=PRINTED)
    assert "from which they differ by up to 0.10 m and 0.00 deg" in of.stderr
    assert [frame.points_stamp for frame in drive.frames] == [1.5, 2.0]


def test_nuscenes_predictions_are_named_after_the_sweep(tmp_path: Path) -> None:
    """As the devkit wants them for a submission."""
    write_labels(tmp_path / "predicted/d0_lidarseg.bin", [1, 2, 3], "u1")
    drive = Import("nuscenes", tmp_path).run("--point-labels", tmp_path / "predicted")
    assert drive.frames[0].point_labels == "../predicted/d0_lidarseg.bin"


# CARLA

MIRRORED = [[10, 1, 0], [10, -1, 1], [5, 0, -1]]


def test_carla_clouds_are_mirrored(tmp_path: Path) -> None:
    points, labels = written_cloud(Import("carla", tmp_path).run())
    np.testing.assert_array_equal(points, MIRRORED)
    assert labels.tolist() == [1, 14, 24]


def test_carla_clouds_without_tags_name_no_labels(tmp_path: Path) -> None:
    of = Import("carla", tmp_path, partial(carla, semantic=False))
    of.check()
    assert not (of.out / "point_labels").exists()
    assert "no point labels: edges are compared instead; add your own with" in of.stderr


@pytest.mark.parametrize("semantic", [False, True])
def test_carla_labels_of_ones_own_go_before_tags(tmp_path: Path, semantic: bool) -> None:
    """A frame without a file is left out: its tags are of other classes."""
    of = Import("carla", tmp_path, partial(carla, semantic=semantic))
    write_labels(tmp_path / "network/000018.label", [7, 8, 9])
    drive = of.run("--point-labels", tmp_path / "network")
    assert [frame.points for frame in drive.frames] == ["points/000018.bin"]
    points, labels = written_cloud(drive)
    np.testing.assert_array_equal(points, MIRRORED)
    assert labels.tolist() == [7, 8, 9]
    assert not (of.out / "point_labels").exists()


def test_wrong_carla_rigs_and_clouds_are_named(tmp_path: Path) -> None:
    of = Import("carla", tmp_path)
    write(of.root / "lidar/000017.ply", CARLA_PLAIN_PLY)
    assert (
        of.complaint()
        == "{root}/lidar/000017.ply: frame '000017': found no labels, expected one label per point"
    )
    rig = json.loads((of.root / "sensors.json").read_text())
    rig[0]["id"] = "a" * 300
    write(of.root / "sensors.json", json.dumps(rig))
    assert of.complaint() == f"{{root}}/{'a' * 300}: file name too long"


def test_a_carla_yaw_turns_right_and_a_pitch_looks_up() -> None:
    forward = np.array([1.0, 0.0, 0.0, 0.0])
    yawed = pose_from_unreal(0, 0, 0, roll=0, pitch=0, yaw=90)
    pitched = pose_from_unreal(0, 0, 0, roll=0, pitch=90, yaw=0)
    np.testing.assert_allclose(yawed @ forward, [0, -1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(pitched @ forward, [0, 0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(pose_from_unreal(1, 2, 3, 0, 0, 0)[:3, 3], [1, -2, 3])


@pytest.mark.parametrize(
    ("release", "road", "sky"), [("0.9.10", 7, 13), ("0.9.13", 7, 13), ("0.9.14", 1, 11)]
)
def test_carla_tags_of_both_releases(tmp_path: Path, release: str, road: int, sky: int) -> None:
    drive = Import("carla", tmp_path).run("--version", release)
    assert drive.palette
    assert drive.classes
    assert (drive.palette["Road"], drive.palette["Sky"]) == ((road, 0, 0), (sky, 0, 0))
    assert drive.classes.points["Road"] == (road,)


def test_carlan_images_of_colours(tmp_path: Path) -> None:
    """One black image does not make the others raw."""
    of = Import("carla", tmp_path)
    for color in ((128, 64, 128), (0, 0, 0)):
        write_colors(of.root / "labels/000017.png", color)
        write_colors(of.root / "labels/000018.png", (128, 64, 128))
        palette = of.run().palette
        assert palette
        assert palette["Road"] == (128, 64, 128)


def test_a_class_table_is_turned_red_for_raw_carlan_images(tmp_path: Path) -> None:
    of, own = Import("carla", tmp_path), tmp_path / "own.yaml"
    palette = of.run("--image-classes", "carla").palette
    assert palette
    assert palette["Car"] == (14, 0, 0)
    for ids, found in (
        (
            "[14, 15]",
            "2 ids, expected one: the label images are colours, and a palette has one colour per class",
        ),
        ("[300]", "id 300, needed at most 255, the largest value of red"),
    ):
        write(own, f"ignore: []\nclasses: {{vehicle: {{ids: {ids}}}}}\n")
        said = f"--image-classes: {own}: class 'vehicle': found {found}"
        assert of.complaint("--image-classes", own) == said
    # label images of one's own are no tags
    write_colors(tmp_path / "network/000017.png", (0, 0, 142))
    palette = of.run("--image-labels", tmp_path / "network", "--image-classes", "carla").palette
    assert palette
    assert palette["Car"] == (0, 0, 142)


def test_carla_intrinsics(tmp_path: Path) -> None:
    """A right angle over 64 pixels; the axis meets the middle of the image, between two pixels."""
    K = Import("carla", tmp_path).run().camera.K
    np.testing.assert_allclose(K, [[32, 0, 31.5], [0, 32, 15.5], [0, 0, 1]], atol=1e-12)
