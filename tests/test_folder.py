"""`semcal import folder`: own files, paired by time or by name, and intrinsics from three kinds of files."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from dataset_trees import KITTI_360_FISHEYE, write, write_cloud, write_ids, write_labels
from hypothesis import given
from hypothesis import strategies as st
from test_datasets import complaint, run_import

from semcal_cli.datasets.intrinsics import read_intrinsics
from semcal_cli.datasets.pairing import by_time, pairs, stamps_s
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError

MODELS = "plumb_bob, rational_polynomial, thin_prism, fisheye, omnidirectional, equirectangular, fov, double_sphere"
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
ROS_ECHO = """
header:
  stamp: {sec: 1581624663, nanosec: 149000000}
  frame_id: front
height: 32
width: 64
distortion_model: plumb_bob
d:
- -0.1
- 0.2
- 0.001
- 0.002
- 0.3
k: [50.0, 0.0, 31.5, 0.0, 51.0, 15.5, 0.0, 0.0, 1.0]
p: [40.0, 0.0, 30.0, 0.0, 0.0, 40.0, 15.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 1
roi:
  x_offset: 0
  y_offset: 0
  height: 32
  width: 64
  do_rectify: false
---
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
OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"Mon 01 Jan 2024"</calibration_time>
<image_width>64</image_width>
<image_height>32</image_height>
<!-- flags: +fix_aspectRatio -->
<flags>2</flags>
<fisheye_model>0</fisheye_model>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    50. 0. 3.15000000e+01 0. 51.
    1.55e+01 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    -0.1 0.2 1.0e-03 2.0e-03 .3</data></distortion_coefficients>
<size><_>64</_><_>32</_></size>
</opencv_storage>
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
        (ROS_ECHO.replace("roi:", "roi: 5\nr:"), "roi: found 5, needed a mapping"),
        (
            '<!DOCTYPE a [<!ENTITY b "c">]>' + OPENCV_XML,
            "found <!DOCTYPE, needed XML without declarations",
        ),
        (OPENCV_XML.replace("</flags>", ""), "line 23: found no well-formed XML, needed it"),
        (
            OPENCV_XML.replace("opencv_storage", "storage"),
            "found XML of 'storage', needed 'opencv_storage' with keys in it",
        ),
        (OPENCV_XML.replace("flags>", "image_width>"), "key 'image_width' is given twice"),
        (
            OPENCV_XML.replace("3.15000000e+01", "nan"),
            "camera_matrix: found '50. 0. nan 0. 51.\\n    1.55e+01 0. 0. 1.', needed numbers",
        ),
        (
            OPENCV.replace("0.002, 0.3 ]", "0.002, 0.3, 0.4 ]"),
            "distortion_coefficients: found 6 numbers, needed one of: 4, 5, 8, 12, 14",
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


@pytest.mark.parametrize(
    ("found", "instead", "expected"),
    [
        ("binning_y: 1", "binning_y: 2", "binning_y: found 2, needed 0 or 1"),
        ("x_offset: 0", "x_offset: 8", "roi.x_offset: found 8, needed 0"),
        ("  height: 32", "  height: 16", "roi.height: found 16, needed 0 or 32"),
    ],
)
def test_intrinsics_of_a_part_of_the_picture(tmp_path: Path, found: str, instead: str, expected: str) -> None:
    path = tmp_path / "camera.yaml"
    write(path, ROS_ECHO.replace(found, instead))
    with pytest.raises(InputError) as error:
        read_intrinsics(path, None)
    assert str(error.value) == f"{path}: {expected}: K is for the full picture"


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


@pytest.mark.parametrize(
    ("text", "camera", "model", "expected"),
    [
        (ROS, None, "fisheye", ": found 5 coefficients, needed 0 or 4 for --model fisheye"),
        (
            KALIBR,
            "cam2",
            "fisheye",
            ": found model 'omnidirectional', which cannot be taken as --model fisheye",
        ),
        (KALIBR, "cam1", "fov", ": found 4 coefficients, needed 1 for --model fov"),
        (
            KITTI_360_FISHEYE,
            None,
            "plumb_bob",
            ": found model 'omnidirectional', which cannot be taken as --model plumb_bob",
        ),
        (OPENCV, None, "pinhole", f"--model: found 'pinhole', needed one of: {MODELS}"),
        (ROS, "left", None, ": found one camera without a name, needed no --camera ('left')"),
        (OPENCV, "left", None, ": found one camera without a name, needed no --camera ('left')"),
        (KITTI_360_FISHEYE, "left", None, ": found one camera without a name, needed no --camera ('left')"),
    ],
)
def test_options_that_do_not_fit_the_intrinsics(
    tmp_path: Path, text: str, camera: str | None, model: str | None, expected: str
) -> None:
    path = tmp_path / "camera.yaml"
    write(path, text)
    with pytest.raises(InputError) as error:
        read_intrinsics(path, camera, model)
    assert str(error.value) == (f"{path}{expected}" if expected.startswith(":") else expected)


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
        ("0000000005", None),
        ("0000000002_0000000385", None),
        ("0000000005_000", None),
        ("20240131_120000", None),
        ("1581624663.5", 1581624663.5),
        ("1581624663_98000000", 1581624663.098),
        ("1581624663.149000072479248", 1581624663.149),
    ],
)
def test_times_in_names(name: str, expected: float | None) -> None:
    # a double holds Unix time to a quarter of a microsecond
    path = Path(f"{name}.png")
    found = stamps_s([path])
    assert found == ({} if expected is None else {path: pytest.approx(expected, abs=1e-6)})


def files(*names: str) -> list[Path]:
    return [Path(name) for name in names]


@pytest.mark.parametrize("mark", ["_", "-", "."])
def test_nanoseconds_without_zeros_in_front(mark: str) -> None:
    """ROS's seconds and nanoseconds: 98000000 is 0.098 s, and 149000 beside it 0.000149 s."""
    names = [f"1581624663{mark}{ns}.png" for ns in (198000000, 98000000, 149000, 0)]
    found = stamps_s(files(*names))
    expected = [1581624663.198, 1581624663.098, 1581624663.000149, 1581624663.0]
    assert list(found.values()) == pytest.approx(expected, abs=1e-6)


def test_a_pair_whose_one_side_has_nanoseconds_without_zeros() -> None:
    """As text 0.98 s is nearest to 0.98 s, as nanoseconds 0.098 s is nearest to 0.1 s."""
    clouds = files("1581624663_98000000.bin", "1581624663_980000000.bin")
    pictures = files("1581624663_100000000.png", "1581624663_980000000.png")
    assert pairs(clouds, pictures, max_gap_s=0.05) == dict(zip(clouds, pictures, strict=True))


def test_decimal_fractions_may_have_any_length() -> None:
    names = ("1581624663.98.bin", "1581624663.1490002.bin", "1581624664.bin")
    assert list(stamps_s(files(*names)).values()) == pytest.approx(
        [1581624663.98, 1581624663.1490002, 1581624664.0], abs=1e-6
    )
    # a zero in front shows that the others have lost zeros at the end
    dropped = files("1581624663.012345678.bin", "1581624663.14900000.bin")
    assert list(stamps_s(dropped).values()) == pytest.approx([1581624663.012345678, 1581624663.149], abs=1e-6)


@pytest.mark.parametrize(
    "names",
    [
        ("1581624663_149.bin", "1581624663_98.bin"),  # milliseconds without zeros?
        ("1581624663_149000000.bin", "1581624664_098000000.bin", "1581624665_98.bin"),
    ],
)
def test_digits_after_seconds_that_are_not_clear(names: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        by_time(files(*names))
    assert str(error.value) == (
        f"{names[-1]}: found 2 digits after the seconds, needed 3, 6 or 9 in every name, or nanoseconds without "
        "zeros in front"
    )


def test_numbers_of_ten_digits_are_no_stamps(tmp_path: Path) -> None:
    """KITTI's names."""
    for number in (5, 6):
        write_cloud(tmp_path / f"clouds/{number:010d}.bin")
        write_ids(tmp_path / f"labels/{number:010d}.png")
    write(tmp_path / "camera.yaml", ROS)
    patterns = ("--points", tmp_path / "clouds/*", "--image-labels", tmp_path / "labels/*")
    run_import("folder", *patterns, "--camera-info", tmp_path / "camera.yaml", "-o", tmp_path / "drive")
    frames = read_drive(tmp_path / "drive").frames
    assert [(frame.points_stamp, frame.image_stamp) for frame in frames] == [(None, None), (None, None)]


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


def own_data_without(root: Path, *names: str) -> list[object]:
    arguments = own_data(root)
    for name in names:
        (root / name).unlink()
    return arguments


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


def test_clouds_that_have_one_label_set_each(tmp_path: Path) -> None:
    arguments = own_data_without(tmp_path / "own", "clouds/000002.label", "clouds/000003.label")
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        "--points: found 3 clouds, 1 with a file of --point-labels, 2 with one of --image-labels, "
        "none with both, needed at least one"
    )
    arguments[arguments.index("--image-labels")] = "--images"
    assert "1 with a file of --point-labels, 2 with one of --images," in complaint(
        "folder", *arguments, "-o", tmp_path / "drive"
    )


def test_a_pattern_that_finds_nothing(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    arguments[1] = tmp_path / "own/*.pcd"
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        f"--points: {tmp_path}/own/*.pcd: found no such files, needed at least one; quote the pattern"
    )


def test_nothing_that_can_be_paired(tmp_path: Path) -> None:
    arguments = own_data_without(tmp_path / "own", "labels/000002.png", "labels/000003.png")
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        "--image-labels: found no partner, by name, for any of 3 clouds (as 000001.bin) "
        "among 1 files (as 000004.png)"
    )
