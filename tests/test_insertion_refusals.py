"""A transform that is not set in a file which is there already: what is refused, and why."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import invoke
from format_files import FILES as FORMAT_FILES, T_ANY, words, xyzw
from test_insertion import calibration

from semcal_cli.errors import InputError
from semcal_cli.formats import set_in_file, write_transform
from semcal_cli.formats.format import FormatOptions


@pytest.mark.parametrize(
    ("text", "key", "complaint"),
    [
        ("a: {T: 1}", "a.b", r"a: found keys .*'?T'?.*, expected the key 'b'"),
        ("a: {T: [1, 2]}", "a.T", "a.T: found a list of 2, needed 3 x 4 or 4 x 4 numbers"),
        ("a: {x: 0, y: 0, z: 0, roll: 90, pitch: 0, yaw: 0}", "a", "roll: found 90, expected radians"),
        ("a: {x: 0, y: 0, z: 0, yaw: 0}", "a", "found x, y, z, yaw, expected roll pitch yaw, or qx"),
        ("a: {t: [0, 0, 0], q: [0, 0, 0, 1], rotation: [0, 0, 0, 1]}", "a", "expected nine numbers, or roll"),
        ("a: &n [1, 0]\nT: *n", "T", "anchor"),
        ("a: {T: 1}", None, "add --key with the keys of the transform, such as a.b.T"),
        ("T: [1,0,0,0, 0,1,0,0, 0,0,1,0, 1,2,3,1]", "T", "T: found the last row 1 2 3 1, needed 0 0 0 1"),
        ("T: [1,0,0,x, 0,1,0,0, 0,0,1,0, 0]", "T", "T: found a list of 13, needed 3 x 4"),
        ("T: {rows: 4, cols: 3, data: [1,0,0, 0,1,0, 0,0,1, 0,0,0]}", "T", "T: found 3 columns, needed 4"),
        (
            "a: {x: 0, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0, qx: 0, qy: 0, qz: 0, qw: 1}",
            "a",
            "a: found angles and a quaternion; remove one, which would not be set",
        ),
        (
            "a: {t: [0, 0, 0], R: [1,0,0, 0,1,0, 0,0,1], matrix: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}",
            "a",
            "a: found 'matrix' beside the transform; remove it, since it would not be set",
        ),
    ],
)
def test_a_place_without_a_transform_is_refused(
    text: str, key: str | None, complaint: str, tmp_path: Path
) -> None:
    (tmp_path / "theirs.yaml").write_text(text)
    options = FormatOptions(direction="lidar-to-camera")
    with pytest.raises(InputError, match=complaint):
        set_in_file(calibration(tmp_path), tmp_path / "theirs.yaml", key=key, write_options=options)


MACRO = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="camera" params="*origin">
    <joint name="camera_joint" type="fixed">{}<parent link="velodyne"/><child link="cam_optical"/></joint>
  </xacro:macro>
  <xacro:camera><origin xyz="1 0 0"/></xacro:camera>
</robot>
"""


@pytest.mark.parametrize(
    ("origin", "found"),
    [
        (
            '<xacro:insert_block name="origin"/>',
            'found <xacro:insert_block name="origin"/>, which may insert an origin; state an <origin> of numbers in '
            "its place, or set the one that it inserts by hand",
        ),
        (
            '<xacro:if value="1"><origin xyz="0 0 1"/></xacro:if>',
            'found <xacro:if value="1">, which may insert an origin; state an <origin> of numbers in its place, or '
            "set the one that it inserts by hand",
        ),
        (
            '<origin xyz="${x} 0 0.4"/>',
            "found xyz '${x} 0 0.4', which xacro computes; state numbers in its place, or change what it is computed "
            "from",
        ),
        (
            '<origin xyz="0 0 0" rpy="$(arg rpy)"/>',
            "found rpy '$(arg rpy)', which xacro computes; state numbers in its place, or change what it is computed "
            "from",
        ),
    ],
)
def test_what_xacro_computes_is_not_overwritten(origin: str, found: str, tmp_path: Path) -> None:
    target = tmp_path / "robot.xacro"
    target.write_text(MACRO.format(origin))
    refused = invoke("convert", calibration(tmp_path), "--into", target, "-o", tmp_path / "new.xacro")
    assert str(refused.exception) == f"{target}: joint 'camera_joint': {found}"
    assert not (tmp_path / "new.xacro").exists()


def test_what_a_launch_file_computes_is_not_overwritten(tmp_path: Path) -> None:
    target = tmp_path / "static.launch.xml"
    node = "<launch><node pkg='tf2_ros' exec='static_transform_publisher' args='{} 0 0 0 0 0 os cam_optical'/></launch>"
    target.write_text(node.format("$(var x)"))
    refused = invoke("convert", calibration(tmp_path), "--into", target)
    assert str(refused.exception) == (
        f"{target}: static_transform_publisher: found $(var x), which the launch file computes; state numbers and "
        "names in its place"
    )
    target.write_text(node.format("0"))
    assert invoke("convert", calibration(tmp_path), "--into", target).exit_code == 0


def test_a_quaternion_alone_is_no_place_for_a_transform(tmp_path: Path) -> None:
    target, options = tmp_path / "theirs.yaml", FormatOptions(direction="lidar-to-camera")
    target.write_text("a: {rotation: {x: 0, y: 0, z: 0, w: 1}, b: {x: 0, y: 0, z: 0, w: 1, t: [0, 0, 0]}}")
    with pytest.raises(InputError, match=r"a.rotation: found x, y, z, w, needed .* a translation and a"):
        set_in_file(calibration(tmp_path), target, key="a.rotation", write_options=options)
    content = set_in_file(calibration(tmp_path), target, key="a.b", write_options=options)
    *quaternion, t = yaml.safe_load(content)["a"]["b"].values()
    np.testing.assert_allclose([*quaternion, *t], [*xyzw(T_ANY), *T_ANY[:3, 3]], atol=1e-8)


@pytest.mark.parametrize(("ends", "found"), [("\nR: ", "2 lines"), ("\r", "0 lines")])
def test_a_key_of_kitti_on_several_lines_is_refused(ends: str, found: str, tmp_path: Path) -> None:
    target = tmp_path / "calib_velo_to_cam.txt"
    R = words(np.eye(3))
    first = f"R: {R}{ends}" if found == "2 lines" else f"calib_time: today{ends}R: "
    target.write_bytes(f"{first}{R}\nT: 0 0 0\n".encode())
    with pytest.raises(InputError, match=f"R: found {found}, expected one"):
        set_in_file(calibration(tmp_path), target)


@pytest.mark.parametrize(
    ("key", "complaint"),
    [
        (r'"\ud83d\ude97"', "theirs.json: .*: found no such key in the text, expected it without escapes"),
        (
            '"\U0001f697"\n',
            "theirs.json: found JSON that is no YAML, expected each key and its colon on one line",
        ),
    ],
)
def test_json_that_yaml_does_not_read_alike_is_refused(key: str, complaint: str, tmp_path: Path) -> None:
    target = tmp_path / "theirs.json"
    target.write_text(f"{{{key}: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}}")
    options = FormatOptions(direction="lidar-to-camera")
    with pytest.raises(InputError, match=complaint):
        set_in_file(calibration(tmp_path), target, key="\U0001f697", write_options=options)


@pytest.mark.parametrize("name", ["nuscenes", "driveworks", "calibration-anywhere"])
@pytest.mark.parametrize("key", [None, "a.b"])
def test_poses_on_a_base_that_are_only_read_are_not_set(name: str, key: str | None, tmp_path: Path) -> None:
    file_name, content, _ = FORMAT_FILES[name]
    target = tmp_path / file_name
    target.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError, match=f"{target.name}: found {name}, which is only read"):
        set_in_file(calibration(tmp_path), target, key=key)


@pytest.mark.parametrize(
    "text",
    [
        "a: {n: 1, T: {unit: deg, x: 0, y: 0, z: 0, roll: 1, pitch: 0, yaw: 1.5}}",
        "a: {T: {t: [0, 0, 0], rpy: [1, 0, 1.5], rpy_unit: Degrees}}",
        "angles: degree\na: {T: {t: [0, 0, 0], rotation: {roll: 1, pitch: 0, yaw: 1.5}}}",
        "a: {T: {t: [0, 0, 0], rotation: {roll: 1, pitch: 0, yaw: 1.5, degrees: true}}}",
    ],
)
def test_angles_in_degrees_are_not_overwritten_by_radians(text: str, tmp_path: Path) -> None:
    (tmp_path / "theirs.yaml").write_text(text)
    options = FormatOptions(direction="lidar-to-camera")
    with pytest.raises(InputError, match=r"theirs.yaml: .*: found .*, expected radians, in which angles are"):
        set_in_file(calibration(tmp_path), tmp_path / "theirs.yaml", key="a.T", write_options=options)


def test_a_direction_that_a_format_states_itself_is_refused(tmp_path: Path) -> None:
    write_transform(np.eye(4), tmp_path / "T.yaml", "semcal")
    target = tmp_path / "calib.txt"
    write_transform(np.eye(4), target, "opencalib")
    with pytest.raises(
        InputError, match=r"^direction: found 'camera-to-lidar', but opencalib files state it"
    ):
        set_in_file(tmp_path / "T.yaml", target, write_options=FormatOptions(direction="camera-to-lidar"))
