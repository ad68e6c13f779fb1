"""Intrinsics from the files of ROS, Kalibr and OpenCV: their camera, and what is said of a wrong one."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from camera_infos import KALIBR, LENS, OPENCV, OPENCV_XML, ROS, ROS_ECHO, ROS_MESSAGE, K
from dataset_trees import KITTI_360_FISHEYE, write
from hypothesis import given, strategies as st

from semcal_cli.errors import InputError
from semcal_cli.formats.camera_block import read_intrinsics

MODELS = "plumb_bob, rational_polynomial, thin_prism, fisheye, omnidirectional, equirectangular, fov, double_sphere"


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
        (OPENCV_XML, None, {"model": "plumb_bob", "distortion": [-0.1, 0.2, 0.001, 0.002, 0.3]}),
        (ROS_ECHO, None, {"model": "plumb_bob", "distortion": [-0.1, 0.2, 0.001, 0.002, 0.3]}),
        (
            "---" + ROS_ECHO + ROS_ECHO.replace("50.0", "99.0"),
            None,
            {"model": "plumb_bob", "distortion": [-0.1, 0.2, 0.001, 0.002, 0.3]},
        ),
    ],
)
def test_intrinsics(tmp_path: Path, text: str, camera: str | None, expected: dict[str, Any]) -> None:
    write(tmp_path / "camera.yaml", text)
    assert read_intrinsics(tmp_path / "camera.yaml", camera) == LENS | expected


def test_intrinsics_of_a_part_of_the_image(tmp_path: Path) -> None:
    """The K of each binned pixel's mean ray, and of a region, is that of the full image (CameraInfo.msg)."""
    path, text = tmp_path / "camera.yaml", ROS_ECHO
    for found, instead in (
        ("binning_x: 0", "binning_x: 2"),
        ("binning_y: 1", "binning_y: 4"),
        ("x_offset: 0", "x_offset: 8"),
        ("y_offset: 0", "y_offset: 4"),
        ("  width: 64", "  width: 40"),
        ("  height: 32", "  height: 24"),
    ):
        assert found in text
        text = text.replace(found, instead)
    write(path, text)
    block = read_intrinsics(path)
    assert (block["width"], block["height"], block["distortion"]) == (20, 6, [-0.1, 0.2, 0.001, 0.002, 0.3])
    (fx, _, cx), (_, fy, cy), _ = block["K"]
    (full_fx, _, full_cx), (_, full_fy, full_cy), _ = LENS["K"]
    u, v = np.arange(20), np.arange(6)
    means_u, means_v = 8 + 2 * u + 0.5, 4 + 4 * v + 1.5  # of the pixels that are binned
    np.testing.assert_allclose((u - cx) / fx, (means_u - full_cx) / full_fx)
    np.testing.assert_allclose((v - cy) / fy, (means_v - full_cy) / full_fy)


@pytest.mark.parametrize(
    ("found", "instead", "expected"),
    [
        ("binning_y: 1", "binning_y: -2", "binning_y: found -2, expected a whole number of at least 0"),
        ("binning_y: 1", "binning_y: 33", "binning_y: found 33, needed at most 32, the height"),
        (
            "x_offset: 0",
            "x_offset: 8",
            "roi: found x_offset 8 and width 64, expected a region within the width 64",
        ),
        ("  height: 32", "  height: 0.5", "roi.height: found 0.5, expected a whole number of at least 0"),
    ],
)
def test_wrong_parts_of_the_image(tmp_path: Path, found: str, instead: str, expected: str) -> None:
    path = tmp_path / "camera.yaml"
    assert found in ROS_ECHO
    write(path, ROS_ECHO.replace(found, instead))
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
        f"{path}: distortion_coefficients: found 4 coefficients and no fisheye_model; "
        "add --model, such as plumb_bob or fisheye"
    )
    write(path, OPENCV.replace("0.002, 0.3 ]", "0.002 ]\nfisheye_model: 1"))
    assert read_intrinsics(path)["model"] == "fisheye"


@pytest.mark.parametrize(
    ("count", "model"),
    [
        (4, "plumb_bob"),
        (5, "plumb_bob"),
        (8, "rational_polynomial"),
        (12, "thin_prism"),
        (14, "thin_prism"),
    ],
)
def test_the_count_of_coefficients_tells_the_model(tmp_path: Path, count: int, model: str) -> None:
    """Of an OpenCV file that says it is no fisheye; and of ROS's rational_polynomial, which has 8 or more."""
    path, numbers = tmp_path / "camera.yaml", ", ".join(["0.01"] * count)
    write(path, OPENCV.replace("-0.1, 0.2, 0.001, 0.002, 0.3", numbers) + "fisheye_model: 0\n")
    assert read_intrinsics(path)["model"] == model
    if count >= 8:
        write(path, ROS_MESSAGE.replace("1, 2, 3, 4, 5, 6, 7, 8", numbers))
        assert read_intrinsics(path)["model"] == model


@pytest.mark.parametrize(
    ("text", "camera"),
    [
        (ROS.replace(", 0.3]}", "]}"), None),
        (KALIBR, "cam0"),
        (OPENCV.replace("0.002, 0.3 ]", "0.002 ]\nfisheye_model: 0"), None),
    ],
)
def test_a_model_that_is_asked_for_goes_before_the_file(
    tmp_path: Path, text: str, camera: str | None
) -> None:
    write(tmp_path / "camera.yaml", text)
    block = read_intrinsics(tmp_path / "camera.yaml", camera, "fisheye")
    assert block == LENS | {"model": "fisheye", "distortion": [-0.1, 0.2, 0.001, 0.002]}


def test_xml_that_opencv_wrote(tmp_path: Path) -> None:
    path = tmp_path / "camera.xml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon & Tue")
    for key, value in (("image_width", 64), ("image_height", 32), ("fisheye_model", 1)):
        storage.write(key, value)
    storage.write("camera_matrix", np.array(K))
    storage.write("distortion_coefficients", np.array([[0.1, 1e-9, 0.0, -3e-5]]).T)
    storage.release()
    assert read_intrinsics(path) == LENS | {"model": "fisheye", "distortion": [0.1, 1e-9, 0.0, -3e-5]}


def test_older_opencv_puts_no_space_after_a_colon(tmp_path: Path) -> None:
    write(tmp_path / "camera.yaml", OPENCV.replace(": ", ":"))
    assert read_intrinsics(tmp_path / "camera.yaml", None)["K"] == K


@given(data=st.data())
def test_a_damaged_opencv_file_is_one_line_of_input_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """OpenCV's own parser aborts on some of these."""
    text = data.draw(st.sampled_from([OPENCV, OPENCV_XML, ROS_ECHO, KITTI_360_FISHEYE]))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        text = text[:at] + data.draw(st.text(max_size=5)) + text[at + data.draw(st.integers(0, 20)) :]
    path = tmp_path_factory.getbasetemp() / "damaged.yaml"
    path.write_text(text, encoding="utf-8")
    try:
        read_intrinsics(path, None)
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017
