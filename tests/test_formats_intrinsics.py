"""Intrinsics beside a transform: in a ROS camera_info, a Kalibr camchain and an OpenCV FileStorage, and into files."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from camera_infos import ROS, ROS_ECHO
from commands import invoke
from conftest import DRIVE
from format_files import T_ANY

import semcal_cli
from semcal_cli.config.directions import Direction
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.validation import validate
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.formats.camera_block import read_intrinsics
from semcal_cli.formats.format import FormatOptions
from semcal_cli.result.calibration_document import CalibrationDocument

L2C = ["--to-direction", "lidar-to-camera"]
SIZE = {"width": 64, "height": 32}
K = ((50.0, 0.0, 31.5), (0.0, 51.25, 15.5), (0.0, 0.0, 1.0))
COEFFICIENTS = (-0.1, 0.2, 0.001, -2e-05, 0.3, 0.01, 0.02, 0.03, 0.004, 0.005, 0.006, 0.007, 0.1, -0.2)


def camera(model: Any, count: int = 0, **parameters: float) -> Camera:
    distortion = (0.9,) if model == "fov" else COEFFICIENTS[:count]
    return Camera(model=model, K=K, distortion=distortion, parameters=parameters, **SIZE)


CAMERAS = {
    "plumb_bob, none": camera("plumb_bob"),
    "plumb_bob, 4": camera("plumb_bob", 4),
    "plumb_bob, 5": camera("plumb_bob", 5),
    "plumb_bob, k3 0": camera("plumb_bob", 4).model_copy(update={"distortion": (*COEFFICIENTS[:4], 0.0)}),
    "plumb_bob, skew": camera("plumb_bob", 4).model_copy(update={"K": ((50.0, 0.117, 31.5), *K[1:])}),
    "rational_polynomial, none": camera("rational_polynomial"),
    "rational_polynomial, 8": camera("rational_polynomial", 8),
    "thin_prism, none": camera("thin_prism"),
    "thin_prism, 12": camera("thin_prism", 12),
    "thin_prism, 14": camera("thin_prism", 14),
    "fisheye, none": camera("fisheye"),
    "fisheye, 4": camera("fisheye", 4),
    "omnidirectional, none": camera("omnidirectional", xi=1.5),
    "omnidirectional, 4": camera("omnidirectional", 4, xi=1.5),
    "equirectangular": camera("equirectangular"),
    "fov": camera("fov", 1),
    "double_sphere": camera("double_sphere", xi=-0.2, alpha=0.6),
}
OF_OPENCV = ("plumb_bob", "rational_polynomial", "thin_prism", "fisheye")
OF_KALIBR = ("plumb_bob", "fisheye", "omnidirectional", "double_sphere", "fov")
LENSES = {"camera-info": OF_OPENCV, "kalibr": OF_KALIBR, "opencv": OF_OPENCV}


def write(path: Path, name: str, lens: Camera) -> bytes:
    direction = "camera-to-lidar" if name == "opencv" else None
    return write_transform(T_ANY, path, name, FormatOptions(direction, intrinsics=lens))


def without(path: Path, name: str, lens: Camera, why: str) -> None:
    """Check that the transform alone is written of a lens without a place, and no file of intrinsics."""
    if name == "camera-info":
        with pytest.raises(InputError, match=f"^{re.escape(why)}$"):
            write(path, name, lens)
        assert not path.exists()
        return
    told: list[str] = []
    direction: Direction | None = "camera-to-lidar" if name == "opencv" else None
    options = FormatOptions(direction, intrinsics=lens, on_note=told.append)
    write_transform(T_ANY, path, name, options)
    assert told == [f"{why}: the transform is written without intrinsics"]
    np.testing.assert_allclose(read_transform(path, None, FormatOptions(direction)), T_ANY, atol=1e-12)


@pytest.mark.parametrize("kind", CAMERAS)
@pytest.mark.parametrize("name", LENSES)
def test_a_lens_comes_back_with_the_same_numbers_or_is_left_out(name: str, kind: str, tmp_path: Path) -> None:
    lens, path = CAMERAS[kind], tmp_path / "camera.yaml"
    if lens.model not in LENSES[name]:
        needed = ", ".join(LENSES[name])
        without(path, name, lens, f"to {name}: found the lens {lens.model}, expected one of: {needed}")
        return
    if (name, kind) == ("kalibr", "plumb_bob, 5"):
        of_kalibr = "needed 0: Kalibr's radtan has k1, k2, p1 and p2"
        without(path, name, lens, f"to kalibr: found the lens plumb_bob with k3 0.3, {of_kalibr}")
        return
    if (name, kind) == ("kalibr", "plumb_bob, skew"):
        why = "to kalibr: found a K with skew 0.117, needed 0: the format has fx, fy, cx and cy"
        without(path, name, lens, why)
        return
    write(path, name, lens)
    found = validate(Camera, read_intrinsics(path), path)
    # What is not there is 0, and no more than zeros are added or left out.
    longest = max(len(found.distortion), len(lens.distortion))
    padded = [each.distortion + (0.0,) * (longest - len(each.distortion)) for each in (found, lens)]
    assert padded[0] == padded[1]
    assert found.model_copy(update={"distortion": ()}) == lens.model_copy(update={"distortion": ()})
    if name != "camera-info":
        options = FormatOptions("camera-to-lidar" if name == "opencv" else None)
        np.testing.assert_allclose(read_transform(path, None, options), T_ANY, atol=1e-12)


@pytest.mark.parametrize("kind", [kind for kind, lens in CAMERAS.items() if lens.model in OF_OPENCV])
def test_opencv_reads_what_is_written_for_it(kind: str, tmp_path: Path) -> None:
    lens = CAMERAS[kind]
    write(tmp_path / "e.yml", "opencv", lens)
    storage = cv2.FileStorage(str(tmp_path / "e.yml"), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), lens.K)
    coefficients = storage.getNode("distortion_coefficients").mat().ravel()
    np.testing.assert_array_equal(coefficients[: len(lens.distortion)], lens.distortion)
    np.testing.assert_array_equal(coefficients[len(lens.distortion) :], 0.0)
    sides = [storage.getNode(f"image_{side}").real() for side in ("width", "height")]
    assert sides == [64.0, 32.0]
    assert bool(storage.getNode("fisheye_model").real()) == (lens.model == "fisheye")
    extrinsic = storage.getNode("CameraExtrinsicMat").mat()
    np.testing.assert_allclose(extrinsic, np.linalg.inv(T_ANY), atol=1e-12)


def test_a_camera_info_is_as_camera_calibration_writes_it() -> None:
    """Of a single camera: no turn to the rectified image, which has the K of the raw one."""
    text = write_transform(
        T_ANY, None, "camera-info", FormatOptions(camera="front", intrinsics=CAMERAS["plumb_bob, 4"])
    )
    assert yaml.safe_load(text) == {
        "image_width": 64,
        "image_height": 32,
        "camera_name": "front",
        "camera_matrix": {"rows": 3, "cols": 3, "data": [50.0, 0, 31.5, 0, 51.25, 15.5, 0, 0, 1]},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": [-0.1, 0.2, 0.001, -2e-05, 0]},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]},
        "projection_matrix": {
            "rows": 3,
            "cols": 4,
            "data": [50.0, 0, 31.5, 0, 0, 51.25, 15.5, 0, 0, 0, 1, 0],
        },
    }


# Where the camera comes from.


@pytest.mark.parametrize("name", LENSES)
def test_the_camera_is_that_which_the_transform_belongs_to(
    name: str,
    refined: CalibrationDocument,
    refined_file: Path,
    rejected_file: Path,
    street: Path,
    tmp_path: Path,
) -> None:
    direction = L2C if name == "opencv" else []
    for source, lens in (
        (refined_file, refined.used_camera),
        (rejected_file, refined.input.camera),
        (street, read_drive(street).camera),
    ):
        found = invoke("convert", source, "--to", name, "-o", tmp_path / "out.yaml", *direction)
        assert found.exit_code == 0, found.output
        assert read_intrinsics(tmp_path / "out.yaml")["K"] == [list(row) for row in lens.K]


@pytest.mark.parametrize("name", ["kalibr", "camera-info"])
def test_python_and_standard_input_give_the_same(name: str, refined_file: Path) -> None:
    written = invoke("convert", refined_file, "--to", name).stdout
    assert semcal_cli.convert(refined_file, name).decode() == written
    assert invoke("convert", "-", "--to", name, stdin=refined_file.read_bytes()).stdout == written


def test_a_drive_needs_no_reference_for_its_camera(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drive.yaml").write_text(DRIVE)
    monkeypatch.chdir(tmp_path)
    found = invoke("convert", ".", "--to", "camera-info", "-o", tmp_path / "ost.yaml")
    assert found.exit_code == 0, found.output
    lens = read_drive(tmp_path).camera
    assert read_intrinsics(tmp_path / "ost.yaml")["K"] == [list(row) for row in lens.K]


def test_a_bare_transform_is_written_alone(tmp_path: Path) -> None:
    write_transform(T_ANY, tmp_path / "T.yaml", "semcal")
    chain = invoke("convert", tmp_path / "T.yaml", "--to", "kalibr").stdout
    assert yaml.safe_load(chain).keys() == {"cam0"}
    assert yaml.safe_load(chain)["cam0"].keys() == {"T_cam_lidar"}
    assert "camera_matrix" not in invoke("convert", tmp_path / "T.yaml", "--to", "opencv", *L2C).stdout
    found = invoke("convert", tmp_path / "T.yaml", "--to", "camera-info")
    assert str(found.exception) == (
        f"{tmp_path / 'T.yaml'}: found no camera, expected a semcal calibration or a drive: --to camera-info "
        "writes intrinsics"
    )
    with pytest.raises(InputError) as error:
        write_transform(T_ANY, None, "camera-info")
    assert str(error.value) == (
        "to camera-info: found no camera, expected IN to be a semcal calibration or a drive"
    )


@pytest.mark.parametrize("text", [ROS, ROS_ECHO.removesuffix("---\n")])
def test_a_camera_info_is_no_transform(text: str, street: Path, tmp_path: Path) -> None:
    path = tmp_path / "ost.yaml"
    path.write_text(text)
    said = f"{path}: found camera-info intrinsics and no transform, expected a file with a transform"
    for command in (
        ("convert", path, "--to", "semcal"),
        ("convert", path, "--from", "camera-info", "--to", "kalibr"),
        ("verify", street, path),
        ("compare", path, street),
    ):
        assert str(invoke(*command).exception) == said


def test_calibrate_writes_the_intrinsics_too(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "chain.yaml"
    found = invoke("calibrate", street, "--init", street, "--to", "kalibr", "-o", out, "-q")
    assert found.exit_code == 0, found.output
    assert read_intrinsics(out)["K"] == [list(row) for row in read_drive(street).camera.K]


OF_TOOLS = {
    "ost.txt": (
        "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n64\n\nheight\n48\n\n[narrow_stereo]\n\ncamera matrix\n"
        "50.5 0.000000 31.5\n0.000000 51.5 23.5\n0.000000 0.000000 1.000000\n\ndistortion\n"
        "0.1 -0.2 0.01 -0.02 0.3 \n\nrectification\n1 0 0\n0 1 0\n0 0 1\n\nprojection\n1 0 0 0\n0 1 0 0\n0 0 1 0\n",
        5,
    ),
    "orb_slam.yaml": (
        '%YAML:1.0\n\nCamera.type: "PinHole"\n# left\nCamera.fx: 50.5\nCamera.fy: 51.5\nCamera.cx: 31.5\n'
        "Camera.cy: 23.5\nCamera.k1: 0.1\nCamera.k2: -0.2\nCamera.p1: 0.01\nCamera.p2: -0.02\n"
        "Camera.width: 64\nCamera.height: 48\nORBextractor.nFeatures: 1000\n",
        4,
    ),
    "camera_pinhole.yaml": (
        "cam_model: Pinhole\ncam_width: 64\ncam_height: 48\nscale: 0.5\ncam_fx: 50.5\ncam_fy: 51.5\ncam_cx: 31.5\n"
        "cam_cy: 23.5\ncam_d0: 0.1\ncam_d1: -0.2\ncam_d2: 0.01\ncam_d3: -0.02\n",
        4,
    ),
    "avia.yaml": (
        "/**:\n  ros__parameters:\n    camera: {model: Pinhole, width: 64, height: 48, scale: 1.0, fx: 50.5, fy: 51.5, "
        "cx: 31.5, cy: 23.5, d0: 0.1, d1: -0.2, d2: 0.01, d3: -0.02}\n",
        4,
    ),
    "center_camera-intrinsic.json": (
        json.dumps(
            {
                "center_camera-intrinsic": {
                    **{"sensor_name": "center_camera", "param_type": "intrinsic"},
                    "param": {
                        **{"img_dist_w": 64, "img_dist_h": 48},
                        "cam_K": {
                            "rows": 3,
                            "cols": 3,
                            "data": [[50.5, 0, 31.5], [0, 51.5, 23.5], [0, 0, 1]],
                        },
                        "cam_dist": {"rows": 1, "cols": 5, "data": [[0.1, -0.2, 0.01, -0.02, 0.3]]},
                    },
                }
            }
        ),
        5,
    ),
    "calib.json": (
        json.dumps(
            {
                "camera": {
                    "camera_model": "plumb_bob",
                    "distortion_coeffs": [0.1, -0.2, 0.01, -0.02, 0.3],
                    "intrinsics": [50.5, 51.5, 31.5, 23.5],
                },
                "meta": {},
            }
        ),
        5,
    ),
}


@pytest.mark.parametrize("name", OF_TOOLS)
def test_intrinsics_of_other_tools_are_read(name: str, tmp_path: Path) -> None:
    """The size of the images, which calib.json does not state, is that of the images."""
    text, count = OF_TOOLS[name]
    (tmp_path / name).write_text(text)
    found = validate(Camera, read_intrinsics(tmp_path / name, size=lambda: (64, 48)), tmp_path / name)
    assert (found.model, found.size) == ("plumb_bob", (64, 48))
    assert found.distortion == (0.1, -0.2, 0.01, -0.02, 0.3)[:count]
    assert found.K == ((50.5, 0.0, 31.5), (0.0, 51.5, 23.5), (0.0, 0.0, 1.0))
    if name == "calib.json":
        with pytest.raises(InputError, match=r"calib.json: found no size of the images, and no images"):
            read_intrinsics(tmp_path / name)
