"""`convert --base`: transforms from a vehicle's base_link, against what numpy composes."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import invoke
from format_files import BODY_OF_OPTICAL, T_ANY, sensor, words, xyzw
from scipy.spatial.transform import Rotation

from semcal_cli.errors import InputError
from semcal_cli.formats import convert, read_transform, write_transform
from semcal_cli.formats.base_link import WRITTEN
from semcal_cli.formats.format import FormatOptions

T_BASE_LIDAR = np.eye(4)
T_BASE_LIDAR[:3, :3] = Rotation.from_euler("xyz", [178.0, -3.0, 65.0], degrees=True).as_matrix()
T_BASE_LIDAR[:3, 3] = [1.21, -0.04, 1.87]
T_CAMERA_BASE = T_ANY @ np.linalg.inv(T_BASE_LIDAR)
WRITTEN_DIGITS = 1e-8  # nine decimals

QUATERNION = xyzw(T_BASE_LIDAR)
PLACE = " ".join(f"--{key} {value!r}" for key, value in zip("xyz", T_BASE_LIDAR[:3, 3].tolist(), strict=True))
TURN = " ".join(f"--q{key} {value!r}" for key, value in zip("xyzw", QUATERNION, strict=True))
STATIC = f"{PLACE} {TURN} --frame-id base_link --child-frame-id os_sensor"
STAMPED = {
    "header": {"frame_id": "base_link"},
    "child_frame_id": "os_sensor",
    "transform": {
        "translation": dict(zip("xyz", T_BASE_LIDAR[:3, 3].tolist(), strict=True)),
        "rotation": dict(zip("xyzw", QUATERNION, strict=True)),
    },
}
ORIGIN = f'xyz="{words(T_BASE_LIDAR[:3, 3])}" rpy="{words(Rotation.from_matrix(T_BASE_LIDAR[:3, :3]).as_euler("xyz"))}"'
BASES = {
    "semcal base": ("base.yaml", json.dumps({"semcal_base": 1, "T_base_lidar": T_BASE_LIDAR.tolist()})),
    "the matrix by its name": ("base.json", json.dumps({"T_base_lidar": T_BASE_LIDAR.tolist()})),
    "tf2": ("tf.yaml", yaml.dump(STAMPED)),
    "ros2-static-transform": ("run.sh", f"ros2 run tf2_ros static_transform_publisher {STATIC}\n"),
    "ros2-launch": (
        "a.launch",
        f'<launch><node pkg="tf2_ros" exec="static_transform_publisher" args="{STATIC}"/></launch>',
    ),
    "urdf": (
        "robot.urdf",
        '<robot><joint name="a" type="fixed"><parent link="base_link"/><child link="mast"/>'
        f'<origin {ORIGIN}/></joint><joint name="b" type="fixed"><parent link="mast"/>'
        '<child link="os_sensor"/></joint></robot>',
    ),
    "autoware": ("sensors_calibration.yaml", yaml.dump({"base_link": {"os_sensor": sensor(T_BASE_LIDAR)}})),
}


@pytest.fixture
def source(tmp_path: Path) -> Path:
    write_transform(T_ANY, tmp_path / "T.yaml", "semcal")
    return tmp_path / "T.yaml"


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return written(tmp_path, *BASES["semcal base"])


def written(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.parametrize("name", [format.name for format in WRITTEN])
@pytest.mark.parametrize("frame", ["optical", "body"])
def test_the_camera_on_the_vehicle_is_that_of_numpy(
    name: str, frame: str, source: Path, base: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = invoke("convert", source, "--to", name, "--base", base, "--to-frame", frame, "-o", out)
    assert done.exit_code == 0, done.output
    if name == "autoware":
        kit = yaml.safe_load(out.read_text())["base_link"]
        T_base_frame = of_sensor(kit["camera_link" if frame == "body" else "camera_optical_frame"])
        np.testing.assert_allclose(of_sensor(kit["lidar"]), T_BASE_LIDAR, atol=WRITTEN_DIGITS)
        to_optical = np.linalg.inv(BODY_OF_OPTICAL) if frame == "body" else np.eye(4)
        T_camera_base = to_optical @ np.linalg.inv(T_base_frame)
        np.testing.assert_allclose(read_transform(out, None, named(frame)), T_ANY, atol=WRITTEN_DIGITS)
    else:
        T_camera_base = read_transform(out, name, named(frame, lidar="base_link"))
    np.testing.assert_allclose(T_camera_base, T_CAMERA_BASE, atol=WRITTEN_DIGITS)


def named(frame: str, **names: str) -> FormatOptions:
    return FormatOptions(frame=frame, **names)  # type: ignore[arg-type]


def of_sensor(entry: dict[str, float]) -> np.ndarray:
    T = np.eye(4)
    angles = [entry[key] for key in ("roll", "pitch", "yaw")]
    T[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    T[:3, 3] = [entry[key] for key in "xyz"]
    return T


@pytest.mark.parametrize("name", BASES)
def test_the_lidar_on_the_vehicle_is_read_from_every_format(name: str, source: Path, tmp_path: Path) -> None:
    path = written(tmp_path, *BASES[name])
    content = yaml.safe_load(convert(source, "tf2", base=path))
    assert content["header"]["frame_id"] == "base_link"
    written(tmp_path, "out.yaml", yaml.dump(content))
    options = FormatOptions(lidar="base_link")
    again = read_transform(tmp_path / "out.yaml", "tf2", options)
    np.testing.assert_allclose(again, T_CAMERA_BASE, atol=WRITTEN_DIGITS)


@pytest.mark.parametrize("direction", ["lidar-to-base", "base-to-lidar"])
@pytest.mark.parametrize("name", ["npy", "text", "tum"])
def test_a_bare_matrix_needs_its_direction(direction: str, name: str, source: Path, tmp_path: Path) -> None:
    T = T_BASE_LIDAR if direction == "lidar-to-base" else np.linalg.inv(T_BASE_LIDAR)
    write_transform(T, tmp_path / "base", name, FormatOptions(direction="lidar-to-camera"))
    asked = ("convert", source, "--to", "tf2", "--base", tmp_path / "base", "-o", tmp_path / "out.yaml")
    done = invoke(*asked)
    assert str(done.exception).endswith(
        "base: found a transform without a stated direction; add --base-direction lidar-to-base (p_base = T p_lidar) "
        "or base-to-lidar"
    )
    assert invoke(*asked, "--base-direction", direction).exit_code == 0
    again = read_transform(tmp_path / "out.yaml", None, FormatOptions(lidar="base_link"))
    np.testing.assert_allclose(again, T_CAMERA_BASE, atol=WRITTEN_DIGITS)


def test_the_base_is_named_as_its_file_does_and_described(source: Path, base: Path, tmp_path: Path) -> None:
    level = np.eye(4)
    level[:3, 3] = [1.0, 0.0, 1.5]
    kit = written(tmp_path, "kit.yaml", yaml.dump({"sensor_kit_base_link": {"top_lidar": sensor(level)}}))
    T_lidar_camera = np.eye(4)
    turned = Rotation.from_euler("xyz", [0.0, 2.0, -10.0], degrees=True).as_matrix()
    T_lidar_camera[:3, :3] = turned @ BODY_OF_OPTICAL[:3, :3]
    T_lidar_camera[:3, 3] = [0.25, -0.1, -0.3]
    write_transform(np.linalg.inv(T_lidar_camera), source, "semcal")
    done = invoke("convert", source, "--to", "urdf", "--base", kit, "--to-camera", "front_optical")
    assert '<parent link="sensor_kit_base_link" />' in done.stdout
    assert done.stderr.splitlines()[0] == (
        "sensor_kit_base_link to front_optical: 1.250 m forward, 0.100 m right, 1.200 m up; the camera looks 10.0 "
        "degrees right of forward and 2.0 degrees down, and leans 0.0 degrees to the right"
    )
    done = invoke("convert", source, "--to", "tf2", "--base", base, "--base-frame", "robot")
    assert "frame_id: robot\n" in done.stdout


ERRORS = [
    (("--to", "kalibr"), "semcal base", "--to kalibr: found --base, which needs one of: ros2-static-transform, "),
    (("--to", "tf2", "--base-direction", "lidar-to-base"), "tf2", "found 'lidar-to-base', but "),
    (("--to", "tf2", "--base-frame", "vehicle"), "tf2", "add --base-frame to name one of them"),
    (("--to", "tf2", "--to-lidar", "velodyne"), "tf2", "add --to-lidar to name the LiDAR's own"),
    (("--to", "tf2", "--base-frame", "x"), "autoware", "--base-frame: found 'x', expected 'base_link', the base in"),
    (("--to", "tf2", "--to-camera", "base_link"), "semcal base", "found 'base_link' for both, expected two names"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "name", "message"), ERRORS)
def test_a_base_that_does_not_fit_is_named(
    words: tuple[str, ...], name: str, message: str, source: Path, tmp_path: Path
) -> None:
    done = invoke("convert", source, "--base", written(tmp_path, *BASES[name]), *words)
    assert isinstance(done.exception, InputError)
    assert message in str(done.exception)


def test_a_calibration_is_no_base(source: Path) -> None:
    done = invoke("convert", source, "--to", "urdf", "--base", source)
    assert "found a transform to a camera, expected the pose of the LiDAR on its vehicle" in str(
        done.exception
    )


def test_a_base_of_another_lidar_is_refused(base: Path, street: Path, tmp_path: Path) -> None:
    document = json.loads(base.read_text()) | {"lidar_frame": "left_lidar"}
    path = written(tmp_path, "left.yaml", yaml.dump(document))
    drive = yaml.safe_load((street / "drive.yaml").read_text()) | {"frame_ids": {"lidar": "right_lidar"}}
    source = written(tmp_path, "drive.yaml", yaml.dump(drive))
    done = invoke("convert", source, "--to", "urdf", "--base", path)
    assert "lidar_frame: found 'left_lidar', expected 'right_lidar', the LiDAR of the transform" in str(
        done.exception
    )
    done = invoke("convert", source, "--to", "urdf", "--base", path, "--to-lidar", "left_lidar")
    assert done.exit_code == 0, done.output


ROBOT = (
    f'<robot><joint name="lidar" type="fixed"><parent link="base_link"/><child link="os_sensor"/><origin {ORIGIN}/>'
    '</joint><!-- kept --><joint name="front" type="fixed"><parent link="base_link"/>'
    '<child link="camera_optical_frame"/><origin xyz="0 0 0" rpy="0 0 0"/></joint></robot>'
)
"""A robot whose camera is mounted on the vehicle, beside the LiDAR."""


def test_a_joint_from_the_vehicle_is_set(source: Path, tmp_path: Path) -> None:
    robot, out = written(tmp_path, "robot.urdf", ROBOT), tmp_path / "new.urdf"
    done = invoke("convert", source, "--into", robot, "--base", robot, "-o", out)
    assert done.exit_code == 0, done.exception
    assert "base_link to camera_optical_frame: " in done.stderr
    np.testing.assert_allclose(read_transform(out), T_ANY, atol=WRITTEN_DIGITS)
    T_camera_base = read_transform(out, None, FormatOptions(lidar="base_link"))
    np.testing.assert_allclose(T_camera_base, T_CAMERA_BASE, atol=WRITTEN_DIGITS)
    assert "<!-- kept -->" in out.read_text()


def test_a_matrix_from_the_vehicle_is_set_under_a_key(source: Path, base: Path, tmp_path: Path) -> None:
    rig = written(tmp_path, "rig.yaml", yaml.dump({"front": {"T": np.eye(4).tolist()}}))
    arguments = ("--into", rig, "--key", "front.T", "--base", base, "--to-direction", "lidar-to-camera")
    done = invoke("convert", source, *arguments)
    assert done.exit_code == 0, done.exception
    np.testing.assert_allclose(yaml.safe_load(done.stdout)["front"]["T"], T_CAMERA_BASE, atol=WRITTEN_DIGITS)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            *BASES["autoware"],
            "found autoware, whose file states the pose of the LiDAR itself; leave out --base",
        ),
        (
            "calib.txt",
            "P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n",
            "in which no frame is the vehicle's; leave out --base",
        ),
        (
            "robot.urdf",
            ROBOT.replace("base_link", "chassis"),
            "add --base-frame to name the vehicle's",
        ),
    ],
)
def test_files_that_no_transform_from_the_vehicle_can_be_set_in(
    name: str, text: str, message: str, source: Path, base: Path, tmp_path: Path
) -> None:
    file = written(tmp_path, name, text)
    done = invoke("convert", source, "--into", file, "--base", base, "-o", tmp_path / "new")
    assert message in str(done.exception)
    assert not done.stderr  # where the camera is on its vehicle is said of a transform that was set
    assert not (tmp_path / "new").exists()
