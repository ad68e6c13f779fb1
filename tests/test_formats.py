"""Transforms in files of every format: how they are read, and what is said of a file that is wrong."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import invoke
from conftest import documents, make_pose
from format_files import (
    C2L,
    FILES,
    KIT,
    RELLIS3D,
    RELLIS3D_KEY,
    ROBOT,
    SENSORS,
    STAMPED,
    T_ANY,
    T_CAMERA_LIDAR,
    T_LIDAR_CAMERA,
    words,
)
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import read_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.poses import inverse
from semcal_cli.result.calibration_document import read_calibration

PRINTED = 1e-9  # decimals of the reference in the drive.yaml of the real frame


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.yaml"


def test_rellis3d_agrees_with_its_drive(rellis3d: Path) -> None:
    T_camera_lidar = read_transform(rellis3d / "transforms.yaml")
    np.testing.assert_allclose(T_camera_lidar, read_transform(rellis3d), atol=PRINTED)
    np.testing.assert_allclose(inverse(T_camera_lidar)[:3, 3], [-0.13165462, 0.03870398, -0.17253834])


def test_rellis3d_between_lidars_is_not_taken_for_a_camera(rellis3d: Path) -> None:
    with pytest.raises(
        InputError,
        match="found top-level keys 'vel2os1', expected a transform in a format that `semcal convert",
    ):
        read_transform(rellis3d / "vel2os1.yaml")


def test_quaternion_is_normalised(path: Path) -> None:
    q = {key: 1.0004 * value for key, value in RELLIS3D[RELLIS3D_KEY]["q"].items()}
    path.write_text(yaml.dump({RELLIS3D_KEY: RELLIS3D[RELLIS3D_KEY] | {"q": q}}))
    np.testing.assert_allclose(read_transform(path), T_CAMERA_LIDAR, atol=1e-15)


def test_drive_without_reference(path: Path, document: dict[str, Any]) -> None:
    path.write_text(yaml.dump(document))
    with pytest.raises(InputError) as error:
        read_transform(path)
    complaint = "found a drive without a reference, expected a transform, or a drive with T_camera_lidar"
    assert str(error.value) == f"{path}: {complaint}"


def test_unknown_content(path: Path) -> None:
    path.write_text("cam0: {}\ncam1: {}\n")
    with pytest.raises(InputError) as error:
        read_transform(path)
    assert str(error.value) == (
        f"{path}: found top-level keys 'cam0', 'cam1', expected a transform in a format that `semcal convert "
        "--formats` lists"
    )


@pytest.mark.parametrize(
    ("names", "direction", "camera"),
    [
        (None, "add direction {choice}", "add camera to name one of them"),
        (
            {"direction": "--init-direction", "camera": "--eye"},
            "add --init-direction {choice}",
            "add --eye to name ",
        ),
        (
            {},
            "add --direction {choice}; first: `semcal convert {path} --direction lidar-to-camera --to semcal "
            "-o T.yaml`",
            "add --camera to name one of them; `semcal convert` takes this option",
        ),
    ],
    ids=["a program", "a command with both options", "a caller without options"],
)
def test_a_message_names_the_options_that_the_caller_has(
    names: dict[str, str] | None, direction: str, camera: str, path: Path
) -> None:
    options = FormatOptions() if names is None else FormatOptions(names=names)
    path.write_text("1 0 0 0 0 1 0 0 0 0 1 0")
    choice = "lidar-to-camera (p_camera = T p_lidar) or camera-to-lidar"
    with pytest.raises(InputError, match=f"; {re.escape(direction.format(choice=choice, path=path))}$"):
        read_transform(path, "text", options)
    path.write_text(yaml.dump({f"cam{number}": {"T_cam_lidar": T_ANY.tolist()} for number in range(2)}))
    with pytest.raises(InputError, match=f"; {re.escape(camera)}"):
        read_transform(path, "kalibr", options)


garbage = documents.map(yaml.dump).map(str.encode) | documents.map(json.dumps).map(str.encode) | st.binary()


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@pytest.mark.parametrize("read", [read_drive, read_calibration, read_transform])
@given(content=garbage)
def test_garbage_is_one_line_of_input_error(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, read: Callable[[Path], object], content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / f"garbage{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read(path)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("kind", FILES)
def test_each_format_is_read_the_right_way_round(kind: str, tmp_path: Path) -> None:
    name, text, options = FILES[kind]
    format = kind.split(",")[0]
    file = tmp_path / name
    file.write_text(text)
    np.testing.assert_allclose(read_transform(file, format, options), T_ANY, atol=1e-12)
    if format != "apollo":  # of tf2's layout: only its name tells
        np.testing.assert_allclose(read_transform(file, None, options), T_ANY, atol=1e-12)


def test_joints_of_a_robot_are_chained(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(ROBOT)
    places = (([0, 0, 1.5], [0, 0, 0.3]), ([0.7, 0.1, 0.4], [0, 0.2, 0]))
    T_base_lidar, T_base_body = (np.eye(4) for _ in places)
    for T, (place, angles) in zip((T_base_lidar, T_base_body), places, strict=True):
        T[:3, :3], T[:3, 3] = Rotation.from_euler("xyz", angles).as_matrix(), place
    T_optical_base = np.linalg.inv(
        T_base_body @ np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    )
    for options in (FormatOptions(), FormatOptions(camera="camera_link", frame="body")):
        T = read_transform(tmp_path / "robot.urdf", None, options)
        np.testing.assert_allclose(T, T_optical_base @ T_base_lidar, atol=1e-12)


def test_arrays_are_read_either_way_round(tmp_path: Path) -> None:
    np.save(tmp_path / "T.npy", T_LIDAR_CAMERA[:3].astype(np.float64))
    np.testing.assert_allclose(read_transform(tmp_path / "T.npy", None, C2L), T_ANY, atol=1e-12)


def stamped(parent: str = "os_sensor", child: str = "front_optical") -> str:
    return yaml.dump(STAMPED | {"header": {"frame_id": parent}, "child_frame_id": child})


WORDS = {
    "rellis": RELLIS3D_KEY,
    "kit": yaml.dump(KIT),
    "to cam0": stamped(child="cam0"),
    "to b": stamped(child="b"),
    "from base_link": stamped(parent="base_link"),
    "rows": words(T_ANY[:3]),
    "stretched": words(T_ANY[:3] * 1.2),
    "mirrored": words(-T_ANY[:3]),
    "sensors": json.dumps(SENSORS),
    "deep": "[" * 100 + "]" * 100,
    "deeper": "[" * 900 + "]" * 900,
    "robot": ROBOT,
    "moving robot": ROBOT.replace("fixed", "revolute"),
}
"""What stands for the words in braces of the table."""
WRONG = yaml.safe_load((Path(__file__).parent / "hostile/transforms.yaml").read_text())


@pytest.mark.parametrize("case", WRONG)
def test_what_a_file_leaves_open_or_has_wrong_is_said(case: dict[str, str], tmp_path: Path) -> None:
    text, says = case["text"], case["says"]
    for word, meaning in WORDS.items():
        text, says = (each.replace(f"{{{word}}}", meaning) for each in (text, says))
    (tmp_path / case["file"]).write_text(text, encoding="latin-1")
    found = invoke("convert", tmp_path / case["file"], "--to", "semcal", *case.get("with", "").split())
    assert isinstance(found.exception, InputError), found.output
    assert says in str(found.exception)


def test_compare_reads_every_format(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(FILES["kitti-odometry"][1])
    (tmp_path / "b.json").write_text(FILES["direct-visual-lidar"][1])
    found = invoke("compare", tmp_path / "a.txt", tmp_path / "b.json")
    assert found.exit_code == 0, found.output
    assert "\nverdict          pass: " in found.stdout


@pytest.mark.parametrize("name", [*FILES])
def test_standard_input_is_read_as_a_file_is(name: str, tmp_path: Path) -> None:
    """A stream has a content, but no name."""
    file, text, options = FILES[name]
    (tmp_path / file).write_text(text)
    asked = {key: getattr(options, key) for key in ("direction", "frame", "camera", "lidar")}
    said = [f"--{key}={value}" for key, value in asked.items() if value is not None]
    # KITTI-360's file is known by its name alone, and Apollo's has the layout of tf2's.
    said += [f"--from={name}"] if name in ("kitti-360", "apollo") else []
    command = ["convert", "--to", "semcal", *said]
    of_file = invoke(*command, tmp_path / file)
    of_stream = invoke(*command, "-", stdin=text)
    assert of_stream.exit_code == of_file.exit_code == 0, of_stream.output
    assert of_stream.stdout == of_file.stdout


def test_channels_of_nuscenes_need_a_file_beside(tmp_path: Path) -> None:
    _, text, _ = FILES["nuscenes"]
    command = ["convert", "-", "--to", "semcal", "--camera", "CAM_FRONT", "--lidar", "LIDAR_TOP"]
    found = invoke(*command, stdin=text)
    assert isinstance(found.exception, InputError)
    assert str(found.exception).startswith(
        "/dev/stdin: found no 'CAM_FRONT'; add --camera with the token of "
    )


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_a_bare_matrix_under_its_name_is_a_transform(suffix: str, tmp_path: Path) -> None:
    T = make_pose((0.3, -0.2, 0.9), (0.1, 0.2, 0.3))
    path = tmp_path / f"t{suffix}"
    path.write_text(json.dumps({"T_camera_lidar": T.tolist()}))
    np.testing.assert_allclose(read_transform(path), T, atol=1e-12)
    path.write_text(json.dumps({"T_camera_lidar": T[:3].tolist()}))
    with pytest.raises(InputError, match="T_camera_lidar: found a list of 3, needed at least 4"):
        read_transform(path)


@pytest.mark.parametrize(
    ("keys", "camera", "complaint"),
    [
        (("ExtrinsicMat",), None, None),
        (("P1", "ExtrinsicMat"), None, None),
        (("left", "ExtrinsicMat"), "ExtrinsicMat", None),
        (("left", "ExtrinsicMat"), None, "found matrices left, ExtrinsicMat; add camera to name one"),
        (("left",), "right", "found matrices left; add camera to name one"),
        ((), None, "found keys rows, expected a 4 x 4 or 3 x 4 matrix, such as CameraExtrinsicMat"),
    ],
)
def test_matrices_of_an_opencv_storage(
    keys: tuple[str, ...], camera: str | None, complaint: str | None, tmp_path: Path
) -> None:
    T = make_pose((0.1, -0.2, 0.3), (0.4, 0.5, -0.6))
    lines = ["%YAML:1.0", "---", "rows: 3"]
    for key in keys:
        matrix = np.diag([500.0, 500.0, 1.0, 1.0]) if key == "P1" else np.eye(4) if key == "left" else T
        data = ", ".join(map(repr, matrix.ravel().tolist()))
        lines.append(f"{key}: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [ {data} ]")
    (tmp_path / "a.yaml").write_text("\n".join(lines) + "\n")
    options = FormatOptions("lidar-to-camera", camera=camera)
    if complaint is None:
        np.testing.assert_allclose(read_transform(tmp_path / "a.yaml", options=options), T, atol=1e-12)
        return
    with pytest.raises(InputError, match=re.escape(complaint)):
        read_transform(tmp_path / "a.yaml", options=options)
