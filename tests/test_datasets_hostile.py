"""`semcal import` on values that no data set has: one line that names the file and key, and nothing is written."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_infos import KALIBR, OPENCV, ROS
from dataset_imports import complaint
from dataset_trees import KITTI_360_DRIVE, KITTI_360_FISHEYE, KITTI_RAW_DRIVE, TREES, numbers, write

from semcal_cli.errors import InputError
from semcal_cli.formats.intrinsics import read_intrinsics

HUGE = "9" * 400
CUT = "9" * 57 + "..."
SIDE = "needed a whole number from 1 to 65535"
ROTATION = "needed a rotation: determinant 1 and R R^T the identity within 0.001"
TWICE = numbers(np.diag([2.0, 1.0, 1.0, 1.0])[:3])
FAR = "1 0 0 1e300 0 1 0 0 0 0 1 0"
NO_ROTATION = f"found determinant 2 and R R^T off the identity by 3, {ROTATION}"


def swapped(old: str, new: str) -> Callable[[str], str]:
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return edit


def line(key: str, values: str) -> Callable[[str], str]:
    """Put other values under a key."""

    def edit(text: str) -> str:
        lines = [f"{key}: {values}" if one.startswith(f"{key}:") else one for one in text.splitlines()]
        assert lines != text.splitlines()
        return "\n".join(lines)

    return edit


def row(index: int, **values: Any) -> Callable[[str], str]:
    """Put other values into a row of a table."""

    def edit(text: str) -> str:
        rows = json.loads(text)
        rows[index] |= values
        return json.dumps(rows)

    return edit


def without(index: int, key: str) -> Callable[[str], str]:
    def edit(text: str) -> str:
        rows = json.loads(text)
        del rows[index][key]
        return json.dumps(rows)

    return edit


def whole(text: str) -> Callable[[str], str]:
    return lambda _: text


@pytest.mark.parametrize(
    ("name", "file", "edit", "expected"),
    [
        # numbers
        ("kitti-odometry", "sequences/00/calib.txt", line("Tr", TWICE), f"Tr: {NO_ROTATION}"),
        (
            "kitti-odometry",
            "sequences/00/calib.txt",
            line("Tr", FAR),
            "Tr: found a translation of 1e+300, needed at most 100000 m",
        ),
        (
            "kitti-odometry",
            "sequences/00/calib.txt",
            line("Tr", "1 0 0 0 0 1 0 0 0 0 1 nan"),
            "Tr: found 'nan', needed 12 numbers, all finite",
        ),
        (
            "kitti-odometry",
            "sequences/00/calib.txt",
            line("P2", "50 0 31.5 1e300 0 50 15.5 1e300 0 0 1 1e300"),
            "P2: found a translation of 1e+300, needed at most 100000 m",
        ),
        (
            "kitti-odometry",
            "sequences/00/calib.txt",
            line("P2", "-50 0 31.5 0 0 50 15.5 0 0 0 1 0"),
            "P2: found focal lengths -50.0 and 50.0, needed both above 0",
        ),
        (
            "kitti-odometry",
            "sequences/00/calib.txt",
            whole("\n".join(f"{'k' * 99}{i}: 1" for i in range(3000))),
            f"found keys {', '.join(['k' * 37 + '...'] * 8)}, and 2,992 more, needed Tr, or R0_rect and Tr_velo_to_cam",
        ),
        (
            "kitti-odometry",
            "sequences/00/times.txt",
            whole("1e300"),
            "line 1: found 1e+300, needed at least -1e+10 and at most 1e+10",
        ),
        (
            "kitti-raw",
            "2011_09_26/calib_cam_to_cam.txt",
            line("S_rect_02", "64.7 36.2"),
            f"S_rect_02: found 64.7, {SIDE}",
        ),
        (
            "kitti-raw",
            "2011_09_26/calib_cam_to_cam.txt",
            line("R_rect_00", "2 0 0 0 1 0 0 0 1"),
            f"R_rect_00: {NO_ROTATION}",
        ),
        (
            "kitti-raw",
            "2011_09_26/calib_velo_to_cam.txt",
            line("T", "0 0 1e7"),
            "T: found a translation of 1e+07, needed at most 100000 m",
        ),
        (
            "kitti-raw",
            f"{KITTI_RAW_DRIVE}/image_02/timestamps.txt",
            whole("2011-09-26 13:02:25.1e300"),
            "line 1: found '2011-09-26 13:02:25.1e300', needed a time as 2011-09-26 13:02:25.95",
        ),
        (
            "kitti-360",
            "calibration/perspective.txt",
            line("S_rect_01", "64 -1"),
            f"S_rect_01: found -1.0, {SIDE}",
        ),
        (
            "kitti-360",
            f"data_poses/{KITTI_360_DRIVE}/poses.txt",
            whole(f"250 {TWICE}"),
            f"line 1: {NO_ROTATION}",
        ),
        (
            "kitti-360",
            f"data_poses/{KITTI_360_DRIVE}/poses.txt",
            whole(f"250 {FAR}"),
            "line 1: found a translation of 1e+300, needed at most 1e+08 m",
        ),
        (
            "kitti-360",
            f"data_poses/{KITTI_360_DRIVE}/poses.txt",
            whole(f"250.7 {FAR}"),
            "line 1: found frame 250.7, needed a whole number from 0 to 1000000000",
        ),
        ("opencalib", "1/calib.txt", line("T", TWICE), f"T: {NO_ROTATION}"),
        ("opencalib", "1/calib.txt", line("K", "1 1 0 0 1 0 0 0 1"), "K: found skew 1.0, needed 0"),
        (
            "rellis-3d",
            "00000/camera_info.txt",
            whole("0 1 2 3"),
            "intrinsics: found focal lengths 0.0 and 1.0, needed both above 0",
        ),
        (
            "rellis-3d",
            "00000/transforms.yaml",
            swapped("x: -1", "x: -1e308"),
            "['os1_cloud_node-pylon_camera_node']: found a translation of 1e+308, needed at most 100000 m",
        ),
        (
            "nuscenes",
            "v1.0-mini/calibrated_sensor.json",
            row(1, camera_intrinsic=[]),
            "row 'c1': camera_intrinsic: found a list of 0, needed at least 3",
        ),
        (
            "nuscenes",
            "v1.0-mini/sample_data.json",
            row(0, timestamp=int(HUGE)),
            f"[0].timestamp: found {CUT}, needed at most 10000000000000000",
        ),
        ("nuscenes", "v1.0-mini/sample_data.json", row(1, width=0), f"row 'd1': width: found 0, {SIDE}"),
        (
            "nuscenes",
            "v1.0-mini/ego_pose.json",
            row(0, translation=[1e308, 0.0, 0.0]),
            "[0].translation[0]: found 1e+308, needed at most 100000000.0",
        ),
        (
            "nuscenes",
            "v1.0-mini/ego_pose.json",
            row(0, translation=[1e7, 0.0, 0.0]),
            "rows 'e0' and 'e1': T_camera_lidar: found a translation of 9.9999e+06, needed at most 1e+06 m",
        ),
        (
            "carla",
            "sensors.json",
            row(1, fov=0),
            "sensor 'labels': fov: found 0, needed at least 0.1 and at most 179.9",
        ),
        (
            "carla",
            "sensors.json",
            row(1, fov=180),
            "sensor 'labels': fov: found 180, needed at least 0.1 and at most 179.9",
        ),
        ("carla", "sensors.json", row(1, width=64.7), f"sensor 'labels': width: found 64.7, {SIDE}"),
        (
            "carla",
            "sensors.json",
            row(0, x=int(HUGE)),
            f"sensor 'lidar': x: found {CUT}, needed a finite number",
        ),
        (
            "carla",
            "sensors.json",
            row(0, x=1e308),
            "sensor 'lidar': x: found 1e+308, needed at least -100000 and at most 100000",
        ),
        # documents
        (
            "carla",
            "sensors.json",
            swapped("64", "9" * 5000),
            "found a whole number of too many digits",
        ),
        ("carla", "sensors.json", whole("[" * 100_000), "nested too deeply"),
        (
            "carla",
            "sensors.json",
            whole("[" + '{"a": ' * 100 + r'"\\"' + "}" * 100 + "]"),
            "nested too deeply",
        ),
        ("nuscenes", "v1.0-mini/scene.json", whole("[[]]"), "[0]: found a list of 0, needed a mapping"),
        (
            "nuscenes",
            "v1.0-mini/scene.json",
            whole('[{"name": "\\ud800"}]'),
            "found '\\ud800', needed text without lone surrogates",
        ),
        # names
        ("carla", "sensors.json", without(0, "id"), "[0].id: found nothing, needed a name inside {root}"),
        ("carla", "sensors.json", row(0, id=""), "[0].id: found '', needed a name inside {root}"),
        (
            "carla",
            "sensors.json",
            row(0, id="../../.."),
            "[0].id: found '../../..', needed a name inside {root}",
        ),
    ],
)
def test_a_hostile_value_is_named(
    tmp_path: Path, name: str, file: str, edit: Callable[[str], str], expected: str
) -> None:
    check_complaint(tmp_path, name, file, edit, expected)


@pytest.mark.parametrize(
    ("table", "index", "where", "filename"),
    [
        ("sample_data", 0, "row 'd0'", "../../../../etc/passwd"),
        ("sample_data", 1, "row 'd1'", "/etc/passwd"),
        ("lidarseg", 0, "row 'l'", "a/../b"),
    ],
)
def test_a_file_outside_of_the_data_set_is_named(
    tmp_path: Path, table: str, index: int, where: str, filename: str
) -> None:
    expected = f"{where}: filename: found {filename!r}, needed a name inside {{root}}"
    check_complaint(tmp_path, "nuscenes", f"v1.0-mini/{table}.json", row(index, filename=filename), expected)


def check_complaint(tmp_path: Path, name: str, file: str, edit: Callable[[str], str], expected: str) -> None:
    """Edit a file of a data set, import it, and compare the error; nothing is written."""
    tree = TREES[name](tmp_path / "tree")
    path = tree.root / file
    path.write_text(edit(path.read_text()))
    found = complaint(name, tree.root, *tree.arguments, "-o", tmp_path / "drive")
    assert found == f"{path}: {expected.replace('{root}', str(tree.root))}"
    assert not (tmp_path / "drive").exists()


# Intrinsics


@pytest.mark.parametrize(
    ("text", "model", "expected"),
    [
        (KALIBR.replace("[64, 32]", "[.inf, 32]"), None, "resolution: found inf, needed a finite number"),
        (KALIBR.replace("[64, 32]", "[.nan, 32]"), None, "resolution: found nan, needed a finite number"),
        (KALIBR.replace("[64, 32]", "[64.9, 32]"), None, f"resolution: found 64.9, {SIDE}"),
        (KALIBR.replace("[50,", f"[{HUGE},"), None, f"intrinsics: found {CUT}, needed a finite number"),
        (
            KALIBR.replace("[50,", "[-50,"),
            None,
            "intrinsics: found focal lengths -50.0 and 51.0, needed both above 0",
        ),
        (KALIBR.replace("[-0.1,", "[x,"), None, "distortion_coeffs[0]: found 'x', needed a number"),
        (
            KALIBR.replace("-0.1, 0.2, 0.001, 0.002", "7.0"),
            "fov",
            "distortion_coeffs: found [0] 7.0, needed more than 0 and less than 3.14159",
        ),
        (
            KALIBR.replace("-0.1, 0.2, 0.001", "0.2, 0.1"),
            None,
            "distortion_coeffs: found 3 coefficients, needed 0 or 4 or 5 for plumb_bob",
        ),
        (
            ROS.replace("data: [50,", f"data: [{HUGE},"),
            None,
            f"camera_matrix[0][0]: found {CUT}, needed a number",
        ),
        (ROS.replace("width: 64", "width: 64.5"), None, "image_width: found 64.5, needed a whole number"),
        (
            ROS.replace("camera_matrix:", "k:").replace("data: [50,", "data: [-50,"),
            None,
            "k: found focal lengths -50.0 and 51.0, needed both above 0",
        ),
        (OPENCV.replace("[ 50.", f"[ {HUGE}"), None, f"camera_matrix: found {CUT}, needed a finite number"),
        (
            OPENCV.replace("width: 64", f"width: {HUGE}"),
            None,
            f"image_width: found {CUT}, needed a finite number",
        ),
        (OPENCV.replace("width: 64", "width: 64.5"), None, f"image_width: found 64.5, {SIDE}"),
        (OPENCV + f"fisheye_model: {HUGE}\n", None, f"fisheye_model: found {CUT}, needed a finite number"),
        (
            "%YAML:1.0\n---\n" + "".join(f"key{i}: 1\n" for i in range(3000)),
            None,
            "found keys key0, key1, key2, key3, key4, key5, key6, key7, and 2,992 more, needed one of: "
            "camera_matrix, cameraMatrix, CameraMatrix, K, k",
        ),
        (
            KITTI_360_FISHEYE.replace("2.2134047507854890e+00", HUGE),
            None,
            f"mirror_parameters.xi: found {CUT}, needed a finite number",
        ),
        (
            KITTI_360_FISHEYE.replace("2.2134047507854890e+00", "-1"),
            None,
            "mirror_parameters: found xi -1.0, needed at least 0 and at most 100",
        ),
        (ROS.replace("64", "9" * 5000), None, "found a whole number of too many digits"),
    ],
)
def test_hostile_intrinsics(tmp_path: Path, text: str, model: str | None, expected: str) -> None:
    path = tmp_path / "camera.yaml"
    write(path, text)
    with pytest.raises(InputError) as error:
        read_intrinsics(path, "cam0" if "cam0" in text else None, model)
    assert str(error.value) == f"{path}: {expected}"


def test_a_camera_of_a_camchain_may_be_named_by_a_number(tmp_path: Path) -> None:
    write(tmp_path / "camera.yaml", KALIBR.split("cam1")[0].replace("cam0", "0"))
    assert read_intrinsics(tmp_path / "camera.yaml", "0")["width"] == 64
