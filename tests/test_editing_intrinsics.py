"""Intrinsics that were estimated together with a transform are set in files of a user's that have some."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from format_files import T_ANY
from refined import LATER_S, clock, spoiled

from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import read_drive
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.result.calibration import Calibration, write_calibration

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
TEXTS = {"chain.yaml": CHAIN, "ost.yaml": INFO, "message.yaml": MESSAGE, "drive.yaml": DRIVE_OF_THE_USER}


def put(folder: Path, name: str, record: Calibration, text: str = "") -> tuple[Path, Result]:
    """Set what a calibration found in a file with the camera that it was given, and with some text at its end."""
    path, source = folder / name, folder / "c.yaml"
    write_calibration(record, source)
    path.write_text(filled(TEXTS[name], record.input.camera) + text)
    return path, invoke("convert", source, "--into", path)


def filled(text: str, lens: Camera) -> str:
    (fx, _, cx), (_, fy, cy), _ = lens.K
    return text.format(fx=fx, fy=fy, cx=cx, cy=cy, width=lens.width, height=lens.height)


@pytest.mark.parametrize("name", TEXTS)
def test_intrinsics_that_were_kept_are_set_where_a_file_has_some(
    name: str, refined: Calibration, refined_file: Path, tmp_path: Path
) -> None:
    """And no other byte changes but those of the transform."""
    path, right = tmp_path / name, refined.used_camera
    path.write_text(filled(TEXTS[name], refined.input.camera))
    found = invoke("convert", refined_file, "--into", path)
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
        np.testing.assert_allclose(read_transform(path), refined.pose, atol=1e-12)


@pytest.mark.parametrize("name", ["chain.yaml", "drive.yaml"])
def test_intrinsics_stay_unless_they_were_estimated_and_kept(
    name: str, refined: Calibration, rejected_file: Path, made: Path, street: Path, tmp_path: Path
) -> None:
    path = tmp_path / name
    for source in (rejected_file, made / "c.yaml", street):
        path.write_text(filled(TEXTS[name], spoiled(refined.input.camera)))
        found = invoke("convert", source, "--into", path)
        assert found.exit_code == 0, found.output
        assert "set the intrinsics" not in found.stderr
        assert f"{spoiled(refined.input.camera).K[0][0]}" in path.read_text()


@pytest.mark.parametrize("stated", ["", "time_offset_s: -0.5   # by the maker\n"])
def test_a_clock_that_was_kept_is_set_in_a_drive(refined: Calibration, tmp_path: Path, stated: str) -> None:
    """So that a next calibration starts from all that was found; nothing but the values changes."""
    path, found = put(tmp_path, "drive.yaml", refined.model_copy(update={"clock": clock()}), stated)
    assert found.exit_code == 0, found.output
    assert found.stderr.endswith(
        f"\nset the time offset in {path}; images are 23.1 ms later than their stamps say\n"
    )
    drive = read_drive(path)
    assert (drive.time_offset_s, drive.camera.K) == (LATER_S, refined.used_camera.K)
    assert ("# by the maker" in path.read_text()) == bool(stated)


def test_a_clock_that_is_not_kept_stays(refined: Calibration, tmp_path: Path) -> None:
    record = refined.model_copy(update={"clock": clock(is_determined=False)})
    path, found = put(tmp_path, "drive.yaml", record, "time_offset_s: 0.25\n")
    assert "the clock" not in found.stderr
    assert read_drive(path).time_offset_s == 0.25


def test_a_file_without_a_place_for_the_clock_is_told(refined: Calibration, tmp_path: Path) -> None:
    path, found = put(tmp_path, "chain.yaml", refined.model_copy(update={"clock": clock()}))
    *_, last = found.stderr.splitlines()
    assert last == (
        f"left out the time offset: {path} has no key for it; images are 23.1 ms later than their stamps say"
    )


def test_a_clock_that_no_drive_may_have_is_refused(refined: Calibration, tmp_path: Path) -> None:
    far = clock().model_copy(update={"time_offset_s": 1.5})
    path, found = put(tmp_path, "drive.yaml", refined.model_copy(update={"clock": far}))
    assert str(found.exception) == (
        f"{path}: time_offset_s: found the new value 1.5, needed one from -1 to 1; correct image_stamp instead"
    )
    assert path.read_text() == filled(DRIVE_OF_THE_USER, refined.input.camera)


def test_a_chain_without_intrinsics_gets_none(refined_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "chain.yaml"
    write_transform(T_ANY, path, "kalibr")
    found = invoke("convert", refined_file, "--into", path)
    assert found.exit_code == 0, found.output
    assert yaml.safe_load(path.read_text())["cam0"].keys() == {"T_cam_lidar"}


OTHERS = [
    (
        "chain.yaml",
        "resolution: [640, 360]",
        "resolution: [320, 180]",
        "resolution: found [320, 180], needed [640, 360]",
    ),
    ("chain.yaml", "resolution: [640, 360]\n", "other: 1\n", "resolution: found nothing, needed [640, 360]"),
    ("chain.yaml", ": radtan", ": equidistant", "distortion_model: found 'equidistant', needed 'radtan'"),
    ("ost.yaml", "image_width: 640", "image_width: wide", "image_width: found 'wide', needed 640"),
    ("ost.yaml", ": plumb_bob", ": equidistant", "distortion_model: found 'equidistant', needed 'plumb_bob'"),
    ("drive.yaml", "model: plumb_bob", "model: fisheye", "camera.model: found 'fisheye', needed 'plumb_bob'"),
    (
        "ost.yaml",
        "distortion_coefficients: ",
        "coefficients: ",
        "found keys image_width, image_height, camera_name, camera_matrix, distortion_model, coefficients, "
        "projection_matrix, needed one of: distortion_coefficients, distCoeffs, dist_coeffs, D, d",
    ),
    (
        "ost.yaml",
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: ",
        "camera_matrix: 5\nother: ",
        "camera_matrix: found 5, needed numbers",
    ),
]


@pytest.mark.parametrize(("name", "old", "new", "said"), OTHERS)
def test_a_file_of_another_camera_is_left_alone(
    name: str, old: str, new: str, said: str, refined: Calibration, refined_file: Path, tmp_path: Path
) -> None:
    path = tmp_path / name
    text = filled(TEXTS[name], refined.input.camera)
    assert old in text
    path.write_text(text.replace(old, new))
    before = path.read_bytes()
    found = invoke("convert", refined_file, "--into", path)
    why = (
        "the value of the camera that was estimated with the transform; --to semcal writes only the transform"
    )
    assert str(found.exception) in (f"{path}: {said}", f"{path}: {said}, {why}")
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("  width: 640   # full size\n", "", "camera.width: found nothing, needed a value"),
        ("  K: [", "  K: 5  # [", "camera.K: found 5, needed a list"),
        ("  K: [", "  distortion: abcde\n  K: [", "camera.distortion: found 'abcde', needed a list"),
        ("  K: [", "  distortion:\n  K: [", "camera.distortion: found nothing, needed a list"),
        ("camera:\n", "camera: 5\nlidar:\n", "camera: found 5, needed a mapping"),
        ("frames:\n", "time_offset_s: late\nframes:\n", "time_offset_s: found 'late', needed a number"),
        (
            "frames:\n- points: points/000000.bin\n",
            "frames: []\n",
            "frames: found a list of 0, needed at least 1",
        ),
    ],
)
def test_what_is_no_drive_is_left_alone(
    old: str, new: str, said: str, refined: Calibration, tmp_path: Path
) -> None:
    """Whatever is set in it; what is wrong is named by its key."""
    path, source = tmp_path / "drive.yaml", tmp_path / "c.yaml"
    text = filled(DRIVE_OF_THE_USER, refined.input.camera)
    assert old in text
    path.write_text(text.replace(old, new))
    before = path.read_bytes()
    for record in (
        refined.model_copy(update={"clock": clock()}),
        refined.model_copy(update={"camera": None}),
    ):
        write_calibration(record, source)
        found = invoke("convert", source, "--into", path)
        assert (str(found.exception), found.output) == (f"{path}: {said}", "")
        assert path.read_bytes() == before


def test_a_drive_of_another_camera_is_told(rejected_file: Path, refined: Calibration, tmp_path: Path) -> None:
    path, given = tmp_path / "drive.yaml", refined.input.camera
    path.write_text(filled(DRIVE_OF_THE_USER, spoiled(given)))
    found = invoke("convert", rejected_file, "--into", path)
    pairs = zip(("fx", "fy"), (given.K[0][0], given.K[1][1]), strict=True)
    figures = ", ".join(f"{name} {1.03 * value:.6g} ({rejected_file}: {value:.6g})" for name, value in pairs)
    *_, last = found.stderr.splitlines()
    assert last == f"the transform belongs to another camera than the drive's, that of {path}: {figures}"
    path.write_text(filled(DRIVE_OF_THE_USER, given))
    assert "belongs" not in invoke("convert", rejected_file, "--into", path).stderr


def test_a_camera_info_needs_a_camera_that_was_found(
    made: Path, refined: Calibration, tmp_path: Path
) -> None:
    path = tmp_path / "ost.yaml"
    path.write_text(filled(INFO, refined.input.camera))
    found = invoke("convert", made / "c.yaml", "--into", path)
    assert str(found.exception) == (
        f"{path}: found a camera-info file, which holds only intrinsics, needed IN to be a calibration that "
        "estimated intrinsics and kept them"
    )


def test_coefficients_of_a_camera_info_may_become_more(
    refined: Calibration, refined_file: Path, tmp_path: Path
) -> None:
    """plumb_bob has five in ROS, and K of no other layout is touched."""
    path = tmp_path / "ost.yaml"
    four = filled(INFO, refined.input.camera).replace("cols: 5, data: [0.0, ", "cols: 4, data: [")
    path.write_text(four)
    assert invoke("convert", refined_file, "--into", path).exit_code == 0
    document = yaml.safe_load(path.read_text())
    assert document["distortion_coefficients"] == {"rows": 1, "cols": 5, "data": [0.0] * 5}
    assert document["projection_matrix"]["data"][0] == 40
