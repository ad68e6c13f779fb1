"""Files that data sets' own projects made are read the right way round, by `semcal import` and by formats.

What is then seen on their images tells: where there are labels, they agree. Where there are none, points at the near
side of a jump in range, along a ring, lie where the image changes sideways (after Levinson and Thrun, *Automatic
online calibration of cameras and lasers*, 2013).
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from commands import invoke
from conftest import real
from dataset_imports import run_import
from scipy.spatial.transform import Rotation

from semcal_cli import core
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.files.image_files import read_image
from semcal_cli.formats import read_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.observations.reading import load_observations

PRINTED = 1e-9  # decimals of the reference in the drive.yaml of the real frame
TURN_DEG = 4.0
"""A file that is read right puts points so much nearer to where they belong that turning it so far shows."""
BETTER = 0.03
"""Edges are on stronger edges of the image by so much of its pixels: 0.77 and 0.78 here, 0.59 to 0.70 turned."""
LEAST_POINTS = 20

View: TypeAlias = tuple[Path, Path, Camera, Pose]
"""A cloud, an image, its camera and T_camera_lidar."""


def turned(T: Pose, axis: int, angle_deg: float) -> Pose:
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec(np.radians(angle_deg) * np.eye(3)[axis]).as_matrix()
    return turn @ T


def link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.symlink_to(source)


def test_rellis3d(tmp_path: Path) -> None:
    """Labels agree by both of its files, and only in the stated direction; the import is that made by hand."""
    source, folder, image = (
        real("rellis3d_000104"),
        tmp_path / "Rellis-3D/00000",
        "frame000104-1581624663_149",
    )
    link(source / "000104.bin", folder / "os1_cloud_node_kitti_bin/000104.bin")
    link(source / "000104.label", folder / "os1_cloud_node_semantickitti_label_id/000104.label")
    link(source / f"{image}.jpg", folder / f"pylon_camera_node/{image}.jpg")
    link(source / f"{image}.png", folder / f"pylon_camera_node_label_id/{image}.png")
    for name in ("camera_info.txt", "transforms.yaml"):
        link(source / name, folder / name)
    run_import("rellis-3d", folder.parent, "-o", tmp_path / "drive")
    assert read_drive(tmp_path / "drive").camera == read_drive(source).camera
    np.testing.assert_allclose(read_transform(tmp_path / "drive"), read_transform(source), atol=PRINTED)
    observations = load_observations(read_drive(tmp_path / "drive"))
    assert {"grass", "tree", "bush"} <= set(observations.point_class_names)

    def information(T: Pose) -> float:
        found = core.agreement(observations.core, T)
        return found.mutual_information - found.bias

    now, older = (read_transform(source / name) for name in ("transforms.yaml", "transforms_older.yaml"))
    # The older one is 1.7 degrees and 0.24 m away, and still far better than what is read the wrong way.
    assert information(now) > information(older) > 0.6
    assert max(information(inverse(now)), information(inverse(older))) < 0.01
    for axis in range(3):
        for angle_deg in (-2.0 * TURN_DEG, 2.0 * TURN_DEG):
            assert information(turned(now, axis, angle_deg)) < information(now) - BETTER


def test_kitti_object(tmp_path: Path) -> None:
    """The 14 frames have one calibration, which is read as `convert` reads it."""
    source = real("kitti_object")
    labels = ("--image-labels", source / "image_labels", "--image-classes", "cityscapes-train")
    run_import("kitti-object", source, *labels, "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert (len(drive.frames), drive.camera.width, drive.camera.height) == (14, 1242, 375)
    published = read_transform(source / "calib.txt", options=FormatOptions(camera="P2"))
    np.testing.assert_allclose(np.array(drive.T_camera_lidar), published, atol=PRINTED)


def test_kitti_raw_of_the_right_camera(tmp_path: Path) -> None:
    """Its drives lie beside a folder of labels that has theirs, too; the calibration is read as `convert` reads it."""
    day = real("kitti_raw_right") / "2011_09_26"
    sequence = ("--sequence", "2011_09_26_drive_0009_sync", "--camera", "image_03")
    run_import("kitti-raw", day.parent, *sequence, "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert len(drive.frames) == 5
    published = read_transform(day / "calib_velo_to_cam.txt", options=FormatOptions(camera="image_03"))
    np.testing.assert_allclose(np.array(drive.T_camera_lidar), published, atol=PRINTED)


def test_listed_drives_of_kitti_raw_are_those_of_their_day(tmp_path: Path) -> None:
    """Their clocks all begin at 0 s: listed, merged or as a day, they follow one another."""
    root, names = (
        real("kitti_raw_right"),
        [f"2011_09_26_drive_00{number}_sync" for number in ("09", "48", "64")],
    )
    asked = {name: ("--sequence", name) for name in ("2011_09_26", *names)}
    asked["listed"] = tuple(word for name in names for word in asked[name])
    for name, sequences in asked.items():
        run_import("kitti-raw", root, *sequences, "--camera", "image_03", "-o", tmp_path / name)
    result = invoke("merge", *(tmp_path / name for name in names), "-o", tmp_path / "merged")
    assert result.exit_code == 0, result.output
    for name in ("drive.yaml", "poses/drive.txt"):
        of_day, *others = ((tmp_path / d / name).read_bytes() for d in ("2011_09_26", "listed", "merged"))
        assert others == [of_day, of_day]


def edge_points(path: Path) -> npt.NDArray[np.float32]:
    """Points (N, 3) in front of a jump in range to their neighbour on the ring."""
    cloud = core.read_point_clouds([(path, None)])[0]
    assert cloud.ring is not None
    ranges = np.linalg.norm(cloud.points, axis=1)
    azimuths = np.arctan2(cloud.points[:, 1], cloud.points[:, 0])
    order = np.lexsort((azimuths, cloud.ring))
    are_neighbours = (np.diff(cloud.ring[order].astype(int)) == 0) & (
        np.diff(azimuths[order]) < np.radians(1)
    )
    steps, least = np.diff(ranges[order]), 0.3 + 0.1 * np.minimum(ranges[order][1:], ranges[order][:-1])
    is_edge = np.zeros(len(order), bool)
    is_edge[:-1] |= are_neighbours & (steps > least)
    is_edge[1:] |= are_neighbours & (-steps > least)
    return cloud.points[order[is_edge]]


def on_edges(path: Path, image: Path, camera: Camera, T: Pose) -> float:
    """How strong the image's edges are under edges of the cloud: the share of its pixels that have weaker ones."""
    gray = cv2.GaussianBlur(cv2.cvtColor(read_image(image), cv2.COLOR_BGR2GRAY), (0, 0), 2.0)
    strength = np.abs(cv2.Sobel(gray, cv2.CV_32F, 1, 0))
    weaker = np.sort(strength.ravel()[::37])
    strongest = cv2.dilate(strength, np.ones((1, 3)))
    projected = core.project_points(core_camera(camera), edge_points(path), T)
    is_seen = np.isfinite(projected.ranges) & ~projected.is_hidden
    u, v = np.rint(projected.pixels[is_seen]).astype(int).T
    if len(u) < LEAST_POINTS:
        return 0.0
    under = strongest[v.clip(0, camera.height - 1), u.clip(0, camera.width - 1)]
    return float(np.mean(np.searchsorted(weaker, under) / len(weaker)))


def opencalib(folder: Path) -> list[View]:
    """As imported; the transform is the nearest rotation to six printed digits."""
    found, source = [], real("opencalib_road")
    for sequence, count in (("1", 4), ("2", 4), ("3", 5)):
        run_import("opencalib", source, "--sequence", sequence, "-o", folder / sequence)
        drive = read_drive(folder / sequence)
        camera, T = drive.camera, np.array(drive.T_camera_lidar)
        assert (camera.width, camera.height, len(camera.distortion)) == (1920, 1200, count)
        words = (source / sequence / "calib.txt").read_text().split("T:")[1].split()
        np.testing.assert_allclose(T[:3].ravel(), np.array(words, float), atol=1e-5)
        frame = drive.frames[0]
        found.append((drive.resolve(frame.points), drive.resolve(str(frame.image)), camera, T))
    return found


def nuscenes(_: Path) -> list[View]:
    folder = real("nuscenes_keyframe")
    sweep, calibration = next(folder.glob("*LIDAR_TOP*")), folder / "calib.json"
    found = []
    for channel, entry in json.loads(calibration.read_text()).items():
        camera = Camera.model_validate({"model": "plumb_bob", "width": 1600, "height": 900, "K": entry["K"]})
        T = read_transform(calibration, None, FormatOptions(camera=channel))
        found.append((sweep, folder / entry["img"], camera, T))
    return found


@pytest.mark.parametrize("frames", [opencalib, nuscenes])
def test_edges_meet_by_the_files_of(frames: Callable[[Path], list[View]], tmp_path: Path) -> None:
    views = frames(tmp_path)
    assert len(views) in (3, 6)
    right = np.mean([on_edges(*view) for view in views])
    for axis in (0, 1):  # Sideways edges tell nothing of a small roll.
        for angle_deg in (-TURN_DEG, TURN_DEG):
            off = np.mean([on_edges(*view, turned(T, axis, angle_deg)) for *view, T in views])
            assert off < right - BETTER
    backwards = np.mean([on_edges(*view, inverse(T)) for *view, T in views])
    assert backwards < right - BETTER
