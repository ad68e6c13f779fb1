"""`semcal import` on real files, laid out as the data sets have them."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import real
from dataset_imports import run_import
from scipy.spatial.transform import Rotation

from semcal_cli import _core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.drive.reading import load_observations
from semcal_cli.formats import read_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.poses import Pose, inverse

SAME_NAMES_AT_REFERENCE = 0.75
"""The published transform of the RELLIS-3D frame, true to a degree, gives 0.77."""
SAME_NAMES_BACKWARDS = 0.5
PRINTED = 1e-9  # decimals of the reference in the drive.yaml of the real frame
LIDAR2CAM = 1e-6  # calib.json is of single precision


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


def quaternion_wxyz(T: Pose) -> list[float]:
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return [w, x, y, z]


def row(token: str, T: Pose, **others: object) -> dict[str, object]:
    return {"token": token, "translation": T[:3, 3].tolist(), "rotation": quaternion_wxyz(T)} | others


def pose(rotation_vector: list[float], translation: list[float]) -> Pose:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    T[:3, 3] = translation
    return T


def nuscenes_tree(source: Path, root: Path) -> dict[str, Pose]:
    """Lay the keyframe out natively: a vehicle that moved and turned between the sweep and each picture."""
    calibration = json.loads((source / "calib.json").read_text())
    sweep = next(source.glob("*LIDAR_TOP*"))
    T_ego_lidar = pose([0.0, 0.01, -1.57], [0.94, 0.0, 1.84])
    T_world_ego = pose([0.0, 0.0, -1.9], [411.3, 1180.9, 0.0])
    link(sweep, root / "samples/LIDAR_TOP" / sweep.name)
    tables: dict[str, list[dict[str, object]]] = {
        "scene": [{"token": "scene", "name": "scene-0061"}],
        "sample": [{"token": "sample", "scene_token": "scene"}],
        "sensor": [{"token": "s", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [row("c", T_ego_lidar, sensor_token="s", camera_intrinsic=[])],
        "ego_pose": [row("e", T_world_ego)],
        "sample_data": [keyframe("", f"samples/LIDAR_TOP/{sweep.name}")],
    }
    for k, (channel, entry) in enumerate(calibration.items(), start=1):
        T_world_later = T_world_ego @ pose([0.0, 0.0, 0.002 * k], [0.1 * k, 0.0, 0.0])
        T_ego_camera = inverse(T_world_later) @ T_world_ego @ T_ego_lidar @ np.linalg.inv(entry["lidar2cam"])
        link(source / entry["img"], root / "samples" / channel / entry["img"])
        tables["sensor"].append({"token": f"s{k}", "channel": channel})
        tables["calibrated_sensor"].append(
            row(f"c{k}", T_ego_camera, sensor_token=f"s{k}", camera_intrinsic=entry["K"])
        )
        tables["ego_pose"].append(row(f"e{k}", T_world_later))
        tables["sample_data"].append(keyframe(str(k), f"samples/{channel}/{entry['img']}"))
    for name, rows in tables.items():
        path = root / f"v1.0-mini/{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(rows))
    return {channel: np.array(entry["lidar2cam"]) for channel, entry in calibration.items()}


def keyframe(suffix: str, filename: str) -> dict[str, object]:
    return {
        "token": f"d{suffix}",
        "sample_token": "sample",
        "calibrated_sensor_token": f"c{suffix}",
        "ego_pose_token": f"e{suffix}",
        "filename": filename,
        "timestamp": int(filename.split("__")[-1].split(".")[0]),
        "is_key_frame": True,
        "width": 1600,
        "height": 900,
    }


def test_nuscenes(tmp_path: Path) -> None:
    lidar2cam = nuscenes_tree(real("nuscenes_keyframe"), tmp_path / "nuscenes")
    assert len(lidar2cam) == 6
    for channel, expected in lidar2cam.items():
        run_import("nuscenes", tmp_path / "nuscenes", "--camera", channel, "-o", tmp_path / channel)
        drive: Drive = read_drive(tmp_path / channel)
        np.testing.assert_allclose(drive.T_camera_lidar, expected, atol=LIDAR2CAM)
        assert drive.resolve(drive.frames[0].points).stat().st_size % 20 == 0
        assert drive.resolve(str(drive.frames[0].image)).is_file()
    assert read_drive(tmp_path / "CAM_FRONT").frames[0].image_stamp == pytest.approx(1532402927.612460)
