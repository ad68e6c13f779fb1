"""Intrinsics beside a transform: in a ROS camera_info, a Kalibr camchain and an OpenCV FileStorage, and into files."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from camera_infos import ROS, ROS_ECHO
from click.testing import CliRunner, Result
from conftest import DRIVE
from format_files import T_ANY
from refined import spoiled, with_camera

import semcal_cli
from semcal_cli.cli import semcal
from semcal_cli.datasets.intrinsics import read_intrinsics
from semcal_cli.drive.document import Camera, read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.validation import validate
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.result.calibration import Calibration, read_calibration, write_calibration

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
BARE = "; a bare transform (--to semcal) is written without its lens"


def run(*arguments: object, **options: Any) -> Result:
    return CliRunner().invoke(semcal, [*map(str, arguments)], **options)


def write(path: Path, name: str, lens: Camera) -> bytes:
    direction = "camera-to-lidar" if name == "opencv" else None
    return write_transform(T_ANY, path, name, FormatOptions(direction, intrinsics=lens))


@pytest.mark.parametrize("kind", CAMERAS)
@pytest.mark.parametrize("name", LENSES)
def test_a_lens_comes_back_with_the_same_numbers_or_is_refused(name: str, kind: str, tmp_path: Path) -> None:
    lens, path = CAMERAS[kind], tmp_path / "camera.yaml"
    if lens.model not in LENSES[name]:
        with pytest.raises(InputError) as error:
            write(path, name, lens)
        needed = ", ".join(LENSES[name])
        assert str(error.value) == f"--to {name}: found the lens {lens.model}, needed one of: {needed}{BARE}"
        assert not path.exists()
        return
    if (name, kind) == ("kalibr", "plumb_bob, 5"):
        with pytest.raises(InputError) as error:
            write(path, name, lens)
        assert str(error.value) == (
            "--to kalibr: found the lens plumb_bob with k3 0.3, needed 0: Kalibr's radtan has k1, k2, p1 and p2"
        )
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
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), K)
    coefficients = storage.getNode("distortion_coefficients").mat().ravel()
    np.testing.assert_array_equal(coefficients[: len(lens.distortion)], lens.distortion)
    np.testing.assert_array_equal(coefficients[len(lens.distortion) :], 0.0)
    sides = [storage.getNode(f"image_{side}").real() for side in ("width", "height")]
    assert sides == [64.0, 32.0]
    assert bool(storage.getNode("fisheye_model").real()) == (lens.model == "fisheye")
    extrinsic = storage.getNode("CameraExtrinsicMat").mat()
    np.testing.assert_allclose(extrinsic, np.linalg.inv(T_ANY), atol=1e-12)


def test_a_camera_info_is_as_camera_calibration_writes_it() -> None:
    """Of a single camera: no turn to the rectified picture, which has the K of the raw one."""
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


@pytest.fixture
def record(made: Path) -> Calibration:
    """What a calibration says that has found a camera on a drive with another one."""
    known = read_calibration(made / "c.yaml")
    right = known.input.camera
    return with_camera(known, spoiled(right), right)


@pytest.fixture
def file(record: Calibration, tmp_path: Path) -> Path:
    write_calibration(record, tmp_path / "c.yaml")
    return tmp_path / "c.yaml"


@pytest.fixture
def rejected(record: Calibration, tmp_path: Path) -> Path:
    """The same, whose camera was not kept."""
    write_calibration(
        with_camera(record, record.input.camera, record.used_camera, is_kept=False),
        tmp_path / "rejected.yaml",
    )
    return tmp_path / "rejected.yaml"


@pytest.mark.parametrize("name", LENSES)
def test_the_camera_is_that_which_the_transform_belongs_to(
    name: str, record: Calibration, file: Path, rejected: Path, street: Path, tmp_path: Path
) -> None:
    direction = L2C if name == "opencv" else []
    for source, lens in (
        (file, record.used_camera),
        (rejected, record.input.camera),
        (street, read_drive(street).camera),
    ):
        found = run("convert", source, "--to", name, "-o", tmp_path / "out.yaml", *direction)
        assert found.exit_code == 0, found.output
        assert read_intrinsics(tmp_path / "out.yaml")["K"] == [list(row) for row in lens.K]


def test_python_writes_the_same(file: Path) -> None:
    for name in ("kalibr", "camera-info"):
        assert semcal_cli.convert(file, name).decode() == run("convert", file, "--to", name).stdout


def test_a_calibration_is_read_from_standard_input(file: Path) -> None:
    for name in ("kalibr", "camera-info"):
        piped = run("convert", "-", "--to", name, input=file.read_bytes())
        assert piped.stdout == run("convert", file, "--to", name).stdout


def test_a_drive_needs_no_reference_for_its_camera(tmp_path: Path) -> None:
    (tmp_path / "drive.yaml").write_text(DRIVE)
    found = run("convert", tmp_path, "--to", "camera-info", "-o", tmp_path / "ost.yaml")
    assert found.exit_code == 0, found.output
    lens = read_drive(tmp_path).camera
    assert read_intrinsics(tmp_path / "ost.yaml")["K"] == [list(row) for row in lens.K]


def test_a_bare_transform_is_written_alone(tmp_path: Path) -> None:
    write_transform(T_ANY, tmp_path / "T.yaml", "semcal")
    chain = run("convert", tmp_path / "T.yaml", "--to", "kalibr").stdout
    assert yaml.safe_load(chain).keys() == {"cam0"}
    assert yaml.safe_load(chain)["cam0"].keys() == {"T_cam_lidar"}
    assert "camera_matrix" not in run("convert", tmp_path / "T.yaml", "--to", "opencv", *L2C).stdout
    found = run("convert", tmp_path / "T.yaml", "--to", "camera-info")
    assert str(found.exception) == (
        f"{tmp_path / 'T.yaml'}: found no camera, needed a calibration of semcal's or a drive: --to camera-info "
        "writes intrinsics"
    )
    with pytest.raises(InputError) as error:
        write_transform(T_ANY, None, "camera-info")
    assert str(error.value) == (
        "--to camera-info: found no camera, needed IN to be a calibration of semcal's or a drive"
    )


@pytest.mark.parametrize("text", [ROS, ROS_ECHO.removesuffix("---\n")])
def test_a_camera_info_is_no_transform(text: str, street: Path, tmp_path: Path) -> None:
    path = tmp_path / "ost.yaml"
    path.write_text(text)
    said = f"{path}: found the intrinsics of a camera-info and no transform, needed a file with a transform"
    for command in (
        ("convert", path, "--to", "semcal"),
        ("convert", path, "--from", "camera-info", "--to", "kalibr"),
        ("verify", street, path),
        ("compare", path, street),
    ):
        assert str(run(*command).exception) == said


def test_calibrate_writes_the_intrinsics_too(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "chain.yaml"
    found = run("calibrate", street, "--init", street, "--to", "kalibr", "-o", out, "-q")
    assert found.exit_code == 0, found.output
    assert read_intrinsics(out)["K"] == [list(row) for row in read_drive(street).camera.K]


# Into a file of the user's.

CHAIN = """# our rig
cam0:
  cam_overlaps: [1]
  camera_model: pinhole   # of the left
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [{fx}, {fy}, {cx}, {cy}]
  resolution: [{width}, {height}]
  rostopic: /cam0/image_raw
  T_cam_lidar:
  - [1.0, 0.0, 0.0, 0.0]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
"""
INFO = """# by hand
image_width: {width}
image_height: {height}
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [{fx}, 0.0, {cx}, 0.0, {fy}, {cy}, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0.0, 0.0, 0.0, 0.0, 0.0]}}
projection_matrix: {{rows: 3, cols: 4, data: [40, 0, 30, 0, 0, 40, 15, 0, 0, 0, 1, 0]}}  # ours
"""
MESSAGE = """header: {{frame_id: front}}
height: {height}
width: {width}
distortion_model: plumb_bob
d: [0.0, 0.0, 0.0, 0.0, 0.0]
k: [{fx}, 0.0, {cx}, 0.0, {fy}, {cy}, 0.0, 0.0, 1.0]
"""
DRIVE_OF_THE_USER = """semcal_drive: 1
camera:
  model: plumb_bob
  width: {width}   # full size
  height: {height}
  K: [[{fx}, 0.0, {cx}], [0.0, {fy}, {cy}], [0.0, 0.0, 1.0]]
frames:
- points: points/000000.bin
"""
TEXTS = {
    "chain.yaml": CHAIN,
    "ost.yaml": INFO,
    "message.yaml": MESSAGE,
    "drive.yaml": DRIVE_OF_THE_USER,
}


def filled(text: str, lens: Camera) -> str:
    (fx, _, cx), (_, fy, cy), _ = lens.K
    return text.format(fx=fx, fy=fy, cx=cx, cy=cy, width=lens.width, height=lens.height)


@pytest.mark.parametrize("name", TEXTS)
def test_intrinsics_that_were_kept_are_set_where_a_file_has_some(
    name: str, record: Calibration, file: Path, tmp_path: Path
) -> None:
    """And no other byte changes but those of the transform."""
    path, right = tmp_path / name, record.used_camera
    path.write_text(filled(TEXTS[name], record.input.camera))
    found = run("convert", file, "--into", path)
    assert found.exit_code == 0, found.output
    wanted, after = filled(TEXTS[name], right).splitlines(), path.read_text().splitlines()
    apart = [line for line in after if line not in wanted]
    assert all(
        "0.0, 0.0, 0.0, 1.0]" in line or line.startswith(("  - [", "- [", "T_camera_lidar")) for line in apart
    )
    assert set(wanted) - set(after) <= set(filled(CHAIN, right).splitlines()[-4:-1])
    (fx, _, cx), (_, fy, cy), _ = right.K
    *_, last = found.stderr.splitlines()
    assert last == f"set the intrinsics in {path}: fx {fx:.6g}, fy {fy:.6g}, cx {cx:.6g}, cy {cy:.6g}"
    assert ("set the transform in " in found.stderr) == (name in ("chain.yaml", "drive.yaml"))
    if name in ("chain.yaml", "drive.yaml"):
        np.testing.assert_allclose(read_transform(path), record.pose, atol=1e-12)


@pytest.mark.parametrize("name", ["chain.yaml", "drive.yaml"])
def test_intrinsics_stay_unless_they_were_estimated_and_kept(
    name: str, record: Calibration, rejected: Path, made: Path, street: Path, tmp_path: Path
) -> None:
    path = tmp_path / name
    for source in (rejected, made / "c.yaml", street):
        path.write_text(filled(TEXTS[name], spoiled(record.input.camera)))
        found = run("convert", source, "--into", path)
        assert found.exit_code == 0, found.output
        assert "set the intrinsics" not in found.stderr
        assert f"{spoiled(record.input.camera).K[0][0]}" in path.read_text()


def test_a_chain_without_intrinsics_gets_none(file: Path, tmp_path: Path) -> None:
    path = tmp_path / "chain.yaml"
    write_transform(T_ANY, path, "kalibr")
    found = run("convert", file, "--into", path)
    assert found.exit_code == 0, found.output
    assert yaml.safe_load(path.read_text())["cam0"].keys() == {"T_cam_lidar"}


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        (
            "chain.yaml",
            "resolution: [640, 360]",
            "resolution: [320, 180]",
            "found pictures of 320 x 180 pixels, needed 640 x 360: the camera that was estimated with the transform is "
            "of those; --to semcal writes the transform alone",
        ),
        (
            "ost.yaml",
            "image_width: 640",
            "image_width: wide",
            "found pictures of 'wide' x 360 pixels, needed 640 x 360: the camera that was estimated with the transform "
            "is of those; --to semcal writes the transform alone",
        ),
        (
            "chain.yaml",
            "resolution: [640, 360]\n",
            "other: 1\n",
            "found no size of pictures, needed 640 x 360: the camera that was estimated with the transform is "
            "of those; --to semcal writes the transform alone",
        ),
        (
            "chain.yaml",
            "distortion_model: radtan",
            "distortion_model: equidistant",
            "distortion_model: found 'equidistant', needed 'radtan', as the camera that was estimated with the "
            "transform has it",
        ),
        (
            "ost.yaml",
            "distortion_model: plumb_bob",
            "distortion_model: equidistant",
            "distortion_model: found 'equidistant', needed 'plumb_bob'",
        ),
        (
            "drive.yaml",
            "model: plumb_bob",
            "model: fisheye",
            "camera.model: found 'fisheye', needed 'plumb_bob', as the camera that was estimated with the transform "
            "has it",
        ),
        (
            "ost.yaml",
            "distortion_coefficients: ",
            "coefficients: ",
            "distortion_coefficients: found nothing, needed a value",
        ),
        (
            "ost.yaml",
            "camera_matrix:\n  rows: 3\n  cols: 3\n  data: ",
            "camera_matrix: 5\nother: ",
            "camera_matrix: found 5, needed numbers",
        ),
    ],
)
def test_a_file_of_another_camera_is_left_alone(
    name: str, old: str, new: str, said: str, record: Calibration, file: Path, tmp_path: Path
) -> None:
    path = tmp_path / name
    text = filled(TEXTS[name], record.input.camera)
    assert old in text
    path.write_text(text.replace(old, new))
    before = path.read_bytes()
    found = run("convert", file, "--into", path)
    assert str(found.exception) == f"{path}: {said}"
    assert path.read_bytes() == before


def test_a_camera_info_needs_a_camera_that_was_found(made: Path, record: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "ost.yaml"
    path.write_text(filled(INFO, record.input.camera))
    found = run("convert", made / "c.yaml", "--into", path)
    assert str(found.exception) == (
        f"{path}: found a camera-info, which holds intrinsics alone, needed IN to be a calibration that estimated and "
        "kept its camera's"
    )


def test_coefficients_of_a_camera_info_may_become_more(
    record: Calibration, file: Path, tmp_path: Path
) -> None:
    """plumb_bob has five in ROS, and K of no other layout is touched."""
    path = tmp_path / "ost.yaml"
    four = filled(INFO, record.input.camera).replace("cols: 5, data: [0.0, ", "cols: 4, data: [")
    path.write_text(four)
    assert run("convert", file, "--into", path).exit_code == 0
    document = yaml.safe_load(path.read_text())
    assert document["distortion_coefficients"] == {"rows": 1, "cols": 5, "data": [0.0] * 5}
    assert document["projection_matrix"]["data"][0] == 40
