"""`semcal import folder`: own files, paired by time or by name, and intrinsics from three kinds of files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from dataset_trees import KITTI_360_FISHEYE, write, write_cloud, write_ids, write_labels
from hypothesis import given
from hypothesis import strategies as st
from test_datasets import complaint, run_import

from semcal_cli.datasets.intrinsics import read_intrinsics
from semcal_cli.datasets.pairing import pairs, stamp_s
from semcal_cli.drive import read_drive
from semcal_cli.errors import InputError

K = [[50.0, 0.0, 31.5], [0.0, 51.0, 15.5], [0.0, 0.0, 1.0]]

ROS = """
image_width: 64
image_height: 32
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [50, 0, 31.5, 0, 51, 15.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.2, 0.001, 0.002, 0.3]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [40, 0, 30, 0, 0, 40, 15, 0, 0, 0, 1, 0]}
"""
ROS_MESSAGE = """
header: {frame_id: front}
height: 32
width: 64
distortion_model: rational_polynomial
d: [1, 2, 3, 4, 5, 6, 7, 8]
k: [50, 0, 31.5, 0, 51, 15.5, 0, 0, 1]
"""
KALIBR = """
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.2, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [50, 51, 31.5, 15.5]
  resolution: [64, 32]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]
  distortion_model: equidistant
  intrinsics: [50, 51, 31.5, 15.5]
  resolution: [64, 32]
cam2:
  camera_model: omni
  distortion_coeffs: [-0.1, 0.2, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [1.5, 50, 51, 31.5, 15.5]
  resolution: [64, 32]
"""
OPENCV = """%YAML:1.0
---
calibration_time: "Mon 01 Jan 2024"
image_width: 64
image_height: 32
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 50., 0., 31.5, 0., 51., 15.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.2, 0.001, 0.002, 0.3 ]
"""
LENS = {"width": 64, "height": 32, "K": K}


@pytest.mark.parametrize(
    ("text", "camera", "expected"),
    [
        (ROS, None, {"model": "plumb_bob", "distortion": [-0.1, 0.2, 0.001, 0.002, 0.3]}),
        (ROS_MESSAGE, None, {"model": "rational_polynomial", "distortion": [1, 2, 3, 4, 5, 6, 7, 8]}),
        (KALIBR, "cam0", {"model": "plumb_bob", "distortion": [-0.1, 0.2, 0.001, 0.002]}),
        (KALIBR, "cam1", {"model": "fisheye", "distortion": [0.1, 0.2, 0.3, 0.4]}),
        (
            KALIBR,
            "cam2",
            {
                "model": "omnidirectional",
                "distortion": [-0.1, 0.2, 0.001, 0.002],
                "parameters": {"xi": 1.5},
            },
        ),
        (OPENCV, None, {"model": "plumb_bob", "distortion": [-0.1, 0.2, 0.001, 0.002, 0.3]}),
    ],
)
def test_intrinsics(tmp_path: Path, text: str, camera: str | None, expected: dict[str, Any]) -> None:
    write(tmp_path / "camera.yaml", text)
    assert read_intrinsics(tmp_path / "camera.yaml", camera) == LENS | expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "a: 1\n",
            "found top-level keys 'a', needed a ROS camera_info (distortion_model), a Kalibr camchain "
            "(cam0) or an OpenCV FileStorage (camera_matrix)",
        ),
        (
            ROS.replace("plumb_bob", "brown"),
            "distortion_model: found 'brown', needed one of: plumb_bob, radtan, "
            "rational_polynomial, equidistant, fisheye, kannala_brandt",
        ),
        (
            ROS.replace("15.5, 0, 0, 1]", "15.5]"),
            "camera_matrix: found a list of 6, needed 9 numbers by rows",
        ),
        (ROS.replace("image_width: 64", ""), "image_width: found nothing, needed a value"),
        (KALIBR, "camera: none given, needed one of: cam0, cam1, cam2"),
        (KALIBR.split("cam1")[0].replace("51, ", ""), "intrinsics: found a list of 3, needed 4 numbers"),
        (
            OPENCV.replace("camera_matrix", "M"),
            "found keys calibration_time, image_width, image_height, M, "
            "distortion_coefficients, needed one of: camera_matrix, cameraMatrix, CameraMatrix, K",
        ),
        (
            OPENCV.replace("image_width: 64", "image_width: wide"),
            "image_width: found 'wide', needed numbers",
        ),
    ],
)
def test_wrong_intrinsics(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "camera.yaml"
    write(path, text)
    with pytest.raises(InputError) as error:
        read_intrinsics(path, None)
    assert str(error.value) == f"{path}: {expected}"


def test_four_coefficients_of_opencv_may_be_two_models(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    write(path, OPENCV.replace("0.002, 0.3 ]", "0.002 ]"))
    assert read_intrinsics(path, None, "fisheye")["model"] == "fisheye"
    with pytest.raises(InputError) as error:
        read_intrinsics(path)
    assert str(error.value) == (
        f"{path}: found 4 coefficients and no fisheye_model, needed --model, as plumb_bob or fisheye"
    )
    write(path, OPENCV.replace("0.002, 0.3 ]", "0.002 ]\nfisheye_model: 1"))
    assert read_intrinsics(path)["model"] == "fisheye"


def test_older_opencv_puts_no_space_after_a_colon(tmp_path: Path) -> None:
    write(tmp_path / "camera.yaml", OPENCV.replace(": ", ":"))
    assert read_intrinsics(tmp_path / "camera.yaml", None)["K"] == K


@given(data=st.data())
def test_a_damaged_opencv_file_is_one_line_of_input_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """OpenCV's own parser aborts on some of these."""
    text = data.draw(st.sampled_from([OPENCV, KITTI_360_FISHEYE]))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        text = text[:at] + data.draw(st.text(max_size=5)) + text[at + data.draw(st.integers(0, 20)) :]
    path = tmp_path_factory.getbasetemp() / "damaged.yaml"
    path.write_text(text, encoding="utf-8")
    try:
        read_intrinsics(path, None)
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("1581624663.149", 1581624663.149),
        ("frame000104-1581624663_149", 1581624663.149),
        ("1581624663-149000001", 1581624663.149),
        ("1581624663149000001", 1581624663.149),
        ("n015-2018-07-24-11-22-45+0800__LIDAR_TOP__1532402927647951", 1532402927.647951),
        ("cloud_1581624663149", 1581624663.149),
        ("12.31", 12.31),
        ("000104", None),
        ("left_000104_2", None),
    ],
)
def test_times_in_names(name: str, expected: float | None) -> None:
    # a double holds Unix time to a quarter of a microsecond
    assert stamp_s(name) == (None if expected is None else pytest.approx(expected, abs=1e-6))


def files(*names: str) -> list[Path]:
    return [Path(name) for name in names]


def test_pairs_by_time_are_each_others_nearest() -> None:
    """Of two clouds near one picture the nearer takes it; what is too far stays alone; the order does not matter."""
    clouds = files("1000000000.00.bin", "1000000000.10.bin", "1000000000.14.bin", "1000000000.50.bin")
    pictures = files("1000000000.60.png", "1000000000.13.png", "1000000000.02.png")
    expected = {clouds[0]: pictures[2], clouds[2]: pictures[1]}
    assert pairs(clouds, pictures, max_gap_s=0.05) == expected
    assert pairs(clouds, pictures, max_gap_s=0.11) == expected | {clouds[3]: pictures[0]}


def test_pairs_by_name_whatever_the_suffix() -> None:
    clouds, pictures = files("a/000001.pcd.bin", "a/000002.pcd.bin"), files("b/000002.png", "b/000003.png")
    assert pairs(clouds, pictures, max_gap_s=0.05) == {clouds[1]: pictures[0]}
    with pytest.raises(InputError, match=r"^b/1.png: found the name of a/1.png, needed names that tell"):
        pairs(files("a/1.bin"), files("a/1.png", "b/1.png"), max_gap_s=0.05)


def own_data(root: Path) -> list[object]:
    for number in (1, 2, 3):
        write_cloud(root / f"clouds/{number:06d}.bin")
        write_labels(root / f"clouds/{number:06d}.label", [1, 2, 3])
    for number in (2, 3, 4):
        write_ids(root / f"labels/{number:06d}.png")
    write(root / "camera.yaml", ROS)
    return [
        "--points",
        root / "clouds/*.bin",
        "--point-labels",
        root / "clouds/*.label",
        "--image-labels",
        root / "labels/*.png",
        "--camera-info",
        root / "camera.yaml",
    ]


def test_own_data(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    reference = tmp_path / "reference.yaml"
    T = [[0, -1, 0, 1], [0, 0, -1, 2], [1, 0, 0, 3], [0, 0, 0, 1]]
    own = {"semcal_drive": 1, "camera": {"model": "plumb_bob", **LENS}, "frames": [{"points": "a.bin"}]}
    write(reference, yaml.safe_dump(own | {"T_camera_lidar": T}))
    stderr = run_import("folder", *arguments, "--reference", reference, "-o", tmp_path / "drive.yaml")
    drive = read_drive(tmp_path / "drive.yaml")
    assert [frame.points for frame in drive.frames] == ["own/clouds/000002.bin", "own/clouds/000003.bin"]
    assert drive.frames[0].image_labels == "own/labels/000002.png"
    assert drive.frames[0].points_stamp is None
    np.testing.assert_array_equal(drive.T_camera_lidar, T)
    assert "note: --image-labels: 2 pairs by name; unpaired: 1 clouds, 1 files\n" in stderr


def test_a_pattern_that_finds_nothing(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    arguments[1] = tmp_path / "own/*.pcd"
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        f"--points: {tmp_path}/own/*.pcd: found no such files, needed at least one; quote the pattern"
    )


def test_nothing_that_can_be_paired(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    for number in (2, 3):
        (tmp_path / f"own/labels/{number:06d}.png").unlink()
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        "--image-labels: found no partner, by name, for any of 3 clouds (as 000001.bin) "
        "among 1 files (as 000004.png)"
    )
