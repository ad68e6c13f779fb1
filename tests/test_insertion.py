"""A transform that is set in a file which is there already, of which only the numbers change."""

import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import invoke
from conftest import make_pose
from format_files import BODY_OF_OPTICAL, FILES as FORMAT_FILES, T_ANY, rpy, words, xyzw

from semcal_cli.errors import InputError
from semcal_cli.files.documents import parse_any
from semcal_cli.formats import insertion, read_transform, set_in_file, write_transform
from semcal_cli.formats.format import FormatOptions, Source, edited
from semcal_cli.formats.xml_tags import start_tags

NUM_TAGS, MAX_SECONDS = 50_000, 5.0
"""Tags of a file, and the time of the processor in which they are found: it takes half a second."""
ANY_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")
LAUNCH_PY = """from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    # the LiDAR's mast was bent in May: é
    imu = Node(package="tf2_ros", executable="static_transform_publisher",
               arguments=["0", "0", "0", "0", "0", "0", "a", "b"])
    return LaunchDescription([imu, Node(
        package='tf2_ros', executable='static_transform_publisher',
        arguments=['--x', '0.1', '--y', '0', '--z', '-1.5',  # metres
                   '--roll', '0', '--pitch', '0', '--yaw', '1.5', '--frame-id', 'os_sensor',
                   '--child-frame-id', 'front_optical'])])
"""
ROBOT = """<?xml version="1.0"?>
<robot name="cart" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <!-- <joint name="camera_joint"><origin xyz="9 9 9"/></joint> -->
  <joint name="mast" type="fixed">
    <parent link="base_link"/><child link="velodyne"/>
    <origin xyz="0 0 1.5" rpy="0 0 0.3"/>
  </joint>
  <joint name="camera_joint" type="fixed">
    <origin rpy="0 0 0" xyz="0.2 0.1 0.4" />  <!-- measured by hand -->
    <parent link="base_link"/><child link="camera_link"/>
  </joint>
  <joint name="optical" type="fixed"><origin rpy="-1.570796327 0 -1.570796327"/>
    <parent link="camera_link"/><child link="camera_optical_frame"/></joint>
</robot>
"""
KITTI = (
    "P0: 700 0 600 0 0 700 170 0 0 0 1 0\nP2: 700 0 600 42 0 700 170 0.2 0 0 1 0.003\n"
    "R0_rect: 0.999923936 0.009837760 -0.007445048 -0.009869795 0.999942115 -0.004278459 0.007402527 0.004351614 "
    "0.999963132\r\nTr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\nTr_imu_to_velo: 1 0 0 0 0 1 0 0 0 0 1 0\n"
)
FILES = {
    "robot.urdf.xacro": (ROBOT, "camera_joint", FormatOptions()),
    "static.launch.py": (LAUNCH_PY, None, FormatOptions()),
    "static.launch.xml": (
        "<launch>\n  <!-- é --><node pkg='tf2_ros' exec='static_transform_publisher' name='a'\n"
        "    args='0 0 0 0 0 0 1 camera_link velodyne'/>\n</launch>\n",
        None,
        FormatOptions(frame="body"),
    ),
    "static.sh": (
        "# the old one\nros2 run tf2_ros static_transform_publisher --x 0 --y 0 --z 0 \\\n  --qx 0 --qy 0 --qz 0 "
        "--qw 1 --frame-id os --child-frame-id 'cam_optical'\n",
        None,
        FormatOptions(),
    ),
    "calib.txt": (KITTI, None, FormatOptions(camera="P2")),
}


def calibration(folder: Path) -> Path:
    write_transform(T_ANY, folder / "T.yaml", "semcal")
    return folder / "T.yaml"


@pytest.mark.parametrize("name", FILES)
def test_only_the_numbers_of_the_transform_change(name: str, tmp_path: Path) -> None:
    text, key, options = FILES[name]
    target, output = tmp_path / name, tmp_path / f"new.{name}"
    target.write_bytes(text.encode())
    set_in_file(calibration(tmp_path), target, output, key=key, write_options=options)
    assert target.read_bytes() == text.encode()
    np.testing.assert_allclose(read_transform(output, None, options), T_ANY, atol=1e-7)
    new = output.read_bytes().decode().splitlines(keepends=True)
    changed = [
        (old, line) for old, line in zip(text.splitlines(keepends=True), new, strict=True) if old != line
    ]
    assert 1 <= len(changed) <= 2
    for old, line in changed:
        assert ANY_NUMBER.sub("#", old) == ANY_NUMBER.sub("#", line)
    assert max(len(match[0]) for _, line in changed for match in ANY_NUMBER.finditer(line)) <= 12


T_LIDAR_BODY = np.linalg.inv(BODY_OF_OPTICAL @ T_ANY)
DOCUMENTS: dict[str, tuple[str, Any, FormatOptions, Any]] = {
    "sensors.front.T": (
        "# rig 7\nsensors:\n  front:\n    T: [[1, 0, 0, 0],   # old\n        [0, 1, 0, 0], [0, 0, 1, 0]]\n"
        "  rear: {T: [1.0]}\n",
        lambda found: np.vstack([found["sensors"]["front"]["T"], [0, 0, 0, 1]]),
        FormatOptions(direction="lidar-to-camera"),
        T_ANY,
    ),
    "/**.ros__parameters.a.b[1].T": (
        "/**:\n  ros__parameters:\n    a.b:\n    - 1\n    - T: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n",
        lambda found: np.reshape(found["/**"]["ros__parameters"]["a.b"][1]["T"], (4, 4)),
        FormatOptions(direction="lidar-to-camera"),
        T_ANY,
    ),
    "robot.base.camera": (
        "robot:\n  base:\n    camera: {x: 0, y: 0, z: 0, roll: 0.1, pitch: 0, yaw: 1.57} # radians\n",
        lambda found: [
            found["robot"]["base"]["camera"][name] for name in ("x", "y", "z", "roll", "pitch", "yaw")
        ],
        FormatOptions(direction="camera-to-lidar", frame="body"),
        [*T_LIDAR_BODY[:3, 3], *rpy(T_LIDAR_BODY)],
    ),
    "tf": (
        '{"tf":\t{"rotation": {"x": 0, "y": 0, "z": 0, "w": 1},\t"translation": [0, 0, 1e-3]}}',
        lambda found: [
            *(found["tf"]["rotation"][name] for name in "xyzw"),
            *found["tf"]["translation"],
        ],
        FormatOptions(direction="lidar-to-camera"),
        [*xyzw(T_ANY), *T_ANY[:3, 3]],
    ),
    "ExtrinsicMat": (
        "%YAML:1.0\n---\nExtrinsicMat: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n"
        "   data: [1, 0, 0, 0, 0, 1, 0, 0,\n     0, 0, 1, 0, 0, 0, 0, 1]\nother: 3\n",
        None,
        FormatOptions(direction="lidar-to-camera"),
        T_ANY,
    ),
}


@pytest.mark.parametrize("key", DOCUMENTS)
def test_a_document_gets_the_transform_in_its_own_notation(key: str, tmp_path: Path) -> None:
    text, values, options, expected = DOCUMENTS[key]
    target = tmp_path / f"theirs.{'json' if text.startswith('{') else 'yaml'}"
    target.write_text(text)
    content = set_in_file(calibration(tmp_path), target, key=key, write_options=options).decode()
    assert ANY_NUMBER.sub("#", content) == ANY_NUMBER.sub("#", text)
    if values is None:
        target.write_text(content)
        np.testing.assert_allclose(read_transform(target, None, options), expected, atol=1e-8)
    else:
        found = json.loads(content) if target.suffix == ".json" else yaml.safe_load(content)
        np.testing.assert_allclose(values(found), expected, atol=1e-8)


def test_a_pose_on_a_base_follows_from_that_of_the_lidar(tmp_path: Path) -> None:
    kit = yaml.safe_load(FORMAT_FILES["autoware"][1])
    target = tmp_path / "sensor_kit_calibration.yaml"
    target.write_text("# of the kit\n" + yaml.dump(kit))
    T = make_pose((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    write_transform(T, tmp_path / "T.yaml", "semcal")
    options = FormatOptions(camera="camera0/camera_link")
    content = set_in_file(tmp_path / "T.yaml", target, write_options=options).decode()
    assert ANY_NUMBER.sub("#", content) == ANY_NUMBER.sub("#", target.read_text())
    changed = yaml.safe_load(content)["sensor_kit_base_link"]
    assert [name for name in changed if changed[name] != kit["sensor_kit_base_link"][name]] == [
        "camera0/camera_link"
    ]
    target.write_text(content)
    np.testing.assert_allclose(read_transform(target, None, options), T, atol=1e-8)
    with pytest.raises(InputError, match="found autoware, whose entries have names; leave out --key"):
        set_in_file(tmp_path / "T.yaml", target, key="sensor_kit_base_link", write_options=options)


def test_of_many_keys_only_the_one_in_question_is_parsed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parsed = []
    monkeypatch.setattr(insertion, "parse_any", lambda *what: [parsed.append(what), parse_any(*what)][1])
    keys = "".join(f"key_{number}: {number}\n" for number in range(1_000))
    (tmp_path / "big.yaml").write_text(f"{keys}T: {[*range(12)]}\n")
    options = FormatOptions(direction="lidar-to-camera")
    content = set_in_file(calibration(tmp_path), tmp_path / "big.yaml", key="T", write_options=options)
    assert content.startswith(keys.encode())
    T = np.reshape(yaml.safe_load(content)["T"], (3, 4))
    np.testing.assert_allclose(T, T_ANY[:3], atol=1e-8)
    assert len(parsed) < 50


def test_the_command_replaces_a_file_only_by_force(tmp_path: Path) -> None:
    T, target = calibration(tmp_path), tmp_path / "robot.urdf"
    target.write_text(ROBOT)
    arguments = ["convert", T, "--into", target, "-o", target, "--key", "camera_joint"]
    refused = invoke(*arguments)
    assert str(refused.exception) == f"{target}: found a file; choose another -o, or --force"
    assert target.read_text() == ROBOT
    assert invoke(*arguments, "--force").exit_code == 0
    np.testing.assert_allclose(read_transform(target), T_ANY, atol=1e-7)
    unnamed = invoke("convert", T, "--into", target)
    assert (
        "found the joints mast, camera_joint, optical between 'velodyne' and 'camera_optical_frame'; add --key"
    ) in str(unnamed.exception)
    assert invoke("convert", T, "--into", target, "--to", "urdf").exit_code == 2
    bare = tmp_path / "theirs.yaml"
    bare.write_text(f"T: [{words(np.eye(4)).replace(' ', ', ')}]")
    assert "add --to-direction lidar-to-camera" in str(
        invoke("convert", T, "--into", bare, "--key", "T").exception
    )


def test_many_tags_take_no_time_for_one_another() -> None:
    tag = "<é a='é'/>"
    source = Source(Path("a.urdf"), f"<robot>{NUM_TAGS * tag}</robot>".encode())
    started = time.process_time()
    tags = start_tags(source)
    assert time.process_time() - started < MAX_SECONDS
    assert [each.text for each in tags[1:]] == [tag] * NUM_TAGS


def test_what_is_edited_has_one_place_for_each_number() -> None:
    source = Source(Path("a.txt"), b"x: 0.25")
    assert edited(source, [(3, 4, "1"), (4, 7, ".5")]) == b"x: 1.5"
    with pytest.raises(InputError, match=r"a.txt: line 1: found one place for '0.1' and '0.2', expected two"):
        edited(source, [(3, 7, "0.1"), (3, 7, "0.2")])


def test_numbers_that_are_read_back_must_be_those_of_the_transform(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(insertion, "number_text", lambda value: f"{value + 1e-5:.9f}")
    (tmp_path / "theirs.yaml").write_text("T: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]")
    with pytest.raises(InputError, match="T: the transform cannot be set"):
        set_in_file(
            calibration(tmp_path),
            tmp_path / "theirs.yaml",
            key="T",
            write_options=FormatOptions(direction="lidar-to-camera"),
        )


@pytest.mark.parametrize("separator", ["\u2028", "\x0c", "\x85", "\r"])
def test_a_launch_file_in_python_has_the_lines_that_python_sees(separator: str, tmp_path: Path) -> None:
    # A carriage return ends a line, and a comment with it; the others do not.
    text = LAUNCH_PY.replace(": é\n", f": é{separator}# é\n")
    assert text != LAUNCH_PY
    target = tmp_path / "static.launch.py"
    target.write_bytes(text.encode())
    content = set_in_file(calibration(tmp_path), target)
    assert ANY_NUMBER.sub("#", content.decode()) == ANY_NUMBER.sub("#", text)
    target.write_bytes(content)
    np.testing.assert_allclose(read_transform(target), T_ANY, atol=1e-7)


def test_a_frame_with_the_name_of_a_number_stays(tmp_path: Path) -> None:
    target, text = tmp_path / "static.sh", FILES["static.sh"][0]
    before, numbers, _ = re.split("(--x.*?)--frame-id", text, flags=re.DOTALL)
    text = f"{before}--frame-id x --child-frame-id cam_optical {numbers}"
    target.write_text(text)
    options = FormatOptions(lidar="x", camera="cam_optical")
    content = set_in_file(calibration(tmp_path), target, write_options=options).decode()
    assert ANY_NUMBER.sub("#", content) == ANY_NUMBER.sub("#", text)


@pytest.mark.parametrize("key", ["true", "null", "1.5", "7"])
def test_keys_that_are_no_text_lead_to_a_transform(key: str, tmp_path: Path) -> None:
    matrix = "[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]"
    text = f"True: {matrix}\n~: {matrix}\n1.50: {matrix}\n+7: {matrix}\n2: {matrix}\n'true ': {matrix}\n"
    target = tmp_path / "theirs.yaml"
    target.write_text(text)
    options = FormatOptions(direction="lidar-to-camera")
    found = yaml.safe_load(set_in_file(calibration(tmp_path), target, key=key, write_options=options))
    np.testing.assert_allclose(found.pop(yaml.safe_load(key)), T_ANY[:3].ravel(), atol=1e-8)
    assert list(found.values()) == [yaml.safe_load(matrix)] * 5


def test_a_note_says_that_angles_are_written_in_radians(tmp_path: Path) -> None:
    target = tmp_path / "theirs.yaml"
    target.write_text(
        "unit: rad\nA: {x: 0, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}\n"
        "Q: {x: 0, y: 0, z: 0, qx: 0, qy: 0, qz: 0, qw: 1}\n"
    )
    convert = [
        "convert",
        calibration(tmp_path),
        "--into",
        target,
        "--to-direction",
        "lidar-to-camera",
        "--key",
    ]
    assert invoke(*convert, "A").stderr == f"{target}: A: angles are written in radians\n"
    assert invoke(*convert, "Q").stderr == ""
