"""Intrinsics beside a transform: in a ROS camera_info, a Kalibr camchain and an OpenCV FileStorage, and into files."""

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
        without(path, name, lens, f"--to {name}: found the lens {lens.model}, expected one of: {needed}")
        return
    if (name, kind) == ("kalibr", "plumb_bob, 5"):
        of_kalibr = "needed 0: Kalibr's radtan has k1, k2, p1 and p2"
        without(path, name, lens, f"--to kalibr: found the lens plumb_bob with k3 0.3, {of_kalibr}")
        return
    if (name, kind) == ("kalibr", "plumb_bob, skew"):
        why = "--to kalibr: found a K with skew 0.117, needed 0: the format has fx, fy, cx and cy"
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
        "--to camera-info: found no camera, expected IN to be a semcal calibration or a drive"
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
