import copy
import io
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from conftest import DRIVE, documents, make_pose, poses
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from semcal_cli.cli import semcal
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import FORMATS, find_format, put_transform, read_transform, write_transform
from semcal_cli.formats.format import CameraFrame, FormatOptions, Source
from semcal_cli.geometry.poses import check_rigid, inverse
from semcal_cli.result.calibration import read_calibration

RELLIS3D_KEY = "os1_cloud_node-pylon_camera_node"
PRINTED = 1e-9  # decimals of the reference in the drive.yaml of the real frame

# A camera 1 m down the LiDAR's -x axis that looks along it: x right = y, y down = -z, z forward = -x.
T_CAMERA_LIDAR = np.array([[0, 1, 0, 0], [0, 0, -1, 0], [-1, 0, 0, -1], [0, 0, 0, 1.0]])
RELLIS3D = {RELLIS3D_KEY: {"q": {"w": -0.5, "x": 0.5, "y": 0.5, "z": -0.5}, "t": {"x": -1, "y": 0, "z": 0}}}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.yaml"


def test_rellis3d_is_inverted(path: Path) -> None:
    path.write_text(yaml.dump(RELLIS3D))
    np.testing.assert_allclose(read_transform(path), T_CAMERA_LIDAR, atol=1e-15)


def test_rellis3d_agrees_with_its_drive(rellis3d: Path) -> None:
    T_camera_lidar = read_transform(rellis3d / "transforms.yaml")
    np.testing.assert_allclose(T_camera_lidar, read_transform(rellis3d), atol=PRINTED)
    np.testing.assert_allclose(inverse(T_camera_lidar)[:3, 3], [-0.13165462, 0.03870398, -0.17253834])


def test_rellis3d_between_lidars_is_not_taken_for_a_camera(rellis3d: Path) -> None:
    with pytest.raises(InputError, match="found top-level keys 'vel2os1', needed a transform, of --from "):
        read_transform(rellis3d / "vel2os1.yaml")


def test_quaternion_is_normalised(path: Path) -> None:
    q = {key: 1.0004 * value for key, value in RELLIS3D[RELLIS3D_KEY]["q"].items()}
    path.write_text(yaml.dump({RELLIS3D_KEY: RELLIS3D[RELLIS3D_KEY] | {"q": q}}))
    np.testing.assert_allclose(read_transform(path), T_CAMERA_LIDAR, atol=1e-15)


@pytest.mark.parametrize(
    ("transform", "complaint"),
    [
        (
            {"q": {"w": 1, "x": 1, "y": 0, "z": 0}, "t": {"x": 0, "y": 0, "z": 0}},
            ": found a quaternion of norm 1.41421, needed norm 1 within 0.001",
        ),
        ({"q": {"w": 1, "x": 1, "y": 0}}, ".q.z: found nothing, needed a value"),
        ({"q": [1, 0, 0, 0]}, ".q: found a list of 4, needed a mapping"),
        (None, ": found nothing, needed a mapping"),
    ],
)
def test_wrong_rellis3d(path: Path, transform: object, complaint: str) -> None:
    path.write_text(yaml.dump({RELLIS3D_KEY: transform}))
    with pytest.raises(InputError) as error:
        read_transform(path)
    assert str(error.value) == f"{path}: ['{RELLIS3D_KEY}']{complaint}"


def test_drive_without_reference(path: Path, document: dict[str, Any]) -> None:
    path.write_text(yaml.dump(document))
    with pytest.raises(InputError) as error:
        read_transform(path)
    complaint = "T_camera_lidar: found nothing, needed the drive's reference transform"
    assert str(error.value) == f"{path}: {complaint}"


def test_unknown_content(path: Path) -> None:
    path.write_text("cam0: {}\ncam1: {}\n")
    with pytest.raises(InputError) as error:
        read_transform(path)
    names = ", ".join(format.name for format in FORMATS)
    assert str(error.value) == (
        f"{path}: found top-level keys 'cam0', 'cam1', needed a transform, of --from one of: {names}; "
        "`semcal convert` takes it"
    )


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


@st.composite
def near_misses(draw: st.DrawFn) -> object:
    """A right document with one value, at any depth, replaced by anything."""
    drive = yaml.safe_load(DRIVE) | {"T_camera_lidar": T_CAMERA_LIDAR.tolist()}
    document = node = draw(st.sampled_from([drive, copy.deepcopy(RELLIS3D)]))
    while True:
        key = draw(st.sampled_from(list(node) if isinstance(node, dict) else range(len(node))))
        if not isinstance(node[key], dict | list) or draw(st.booleans()):
            node[key] = draw(documents)
            return document
        node = node[key]


@given(document=near_misses())
def test_near_miss_is_one_line_of_input_error(
    tmp_path_factory: pytest.TempPathFactory, document: object
) -> None:
    path = tmp_path_factory.getbasetemp() / "near_miss.yaml"
    path.write_text(yaml.dump(document), encoding="utf-8")
    try:
        check_rigid(read_transform(path))
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017


# Every format, against what scipy makes of an asymmetric pose.

T_ANY = np.eye(4)
T_ANY[:3, :3] = Rotation.from_euler("xyz", [73.0, -21.0, 38.0], degrees=True).as_matrix()
T_ANY[:3, 3] = [0.31, -0.52, 0.17]
T_LIDAR_CAMERA = np.linalg.inv(T_ANY)
BODY_OF_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
T_KIT_LIDAR = np.eye(4)
T_KIT_LIDAR[:3, :3] = Rotation.from_euler("xyz", [2.0, 3.0, 91.0], degrees=True).as_matrix()
T_KIT_LIDAR[:3, 3] = [0.1, 0.2, 1.3]


def xyzw(T: np.ndarray) -> list[float]:
    return Rotation.from_matrix(T[:3, :3]).as_quat().tolist()


def wxyz(T: np.ndarray) -> list[float]:
    return [xyzw(T)[3], *xyzw(T)[:3]]


def rpy(T: np.ndarray) -> list[float]:
    return Rotation.from_matrix(T[:3, :3]).as_euler("xyz").tolist()


def words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def named(keys: str, values: Any) -> dict[str, float]:
    return {key: float(value) for key, value in zip(keys, values, strict=True)}


def sensor(T: np.ndarray) -> dict[str, float]:
    return dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), [*T[:3, 3].tolist(), *rpy(T)], strict=True))


T_LIDAR_BODY = T_LIDAR_CAMERA @ np.linalg.inv(BODY_OF_OPTICAL)
R0 = Rotation.from_euler("xyz", [0.4, -0.3, 0.9], degrees=True).as_matrix()
ARGUMENTS = " ".join(
    f"--{k} {v!r}" for k, v in zip("xyz", T_LIDAR_CAMERA[:3, 3].tolist(), strict=True)
) + " ".join(["", *(f"--q{k} {v!r}" for k, v in zip("xyzw", xyzw(T_LIDAR_CAMERA), strict=True))])
STAMPED = {
    "header": {"frame_id": "os_sensor", "stamp": {"secs": 0, "nsecs": 0}},
    "child_frame_id": "front_optical",
    "transform": {
        "translation": named("xyz", T_LIDAR_CAMERA[:3, 3]),
        "rotation": named("xyzw", xyzw(T_LIDAR_CAMERA)),
    },
}
KIT = {
    "sensor_kit_base_link": {
        "camera0/camera_link": sensor(T_KIT_LIDAR @ T_LIDAR_BODY),
        "camera1/camera_optical_link": sensor(T_KIT_LIDAR @ T_LIDAR_CAMERA),
        "velodyne_top_base_link": sensor(T_KIT_LIDAR),
    }
}
SENSORS = [
    {
        "token": "a",
        "sensor_token": "s",
        "translation": T[:3, 3].tolist(),
        "rotation": wxyz(T),
        "camera_intrinsic": [],
    }
    for T in (T_KIT_LIDAR @ T_LIDAR_CAMERA, T_KIT_LIDAR)
]
SENSORS[1]["token"] = "b"
T_R0 = np.eye(4)
T_R0[:3, :3] = R0
OPENCV = (
    "%YAML:1.0\n---\nCameraExtrinsicMat: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [{}]\n"
)
L2C, C2L = FormatOptions(direction="lidar-to-camera"), FormatOptions(direction="camera-to-lidar")

# A robot whose camera and LiDAR stand on its base, and a part that hangs in the air.
ROBOT = (
    "<robot><joint name='up' type='fixed'><origin xyz='0 0 1.5' rpy='0 0 0.3'/><parent link='base_link'/>"
    "<child link='velodyne'/></joint><joint name='out' type='fixed'><origin xyz='0.7 0.1 0.4' rpy='0 0.2 0'/>"
    "<parent link='base_link'/><child link='camera_link'/></joint><joint name='in' type='fixed'>"
    "<origin rpy='-1.5707963267948966 0 -1.5707963267948966'/><parent link='camera_link'/>"
    "<child link='camera_optical_frame'/></joint><joint name='loose' type='fixed'><parent link='head'/>"
    "<child link='nose'/></joint></robot>"
)

FILES: dict[str, tuple[str, str, FormatOptions]] = {
    "ros2-static-transform": (
        "a.sh",
        f"ros2 run tf2_ros static_transform_publisher {ARGUMENTS} --frame-id os_sensor --child-frame-id cam_optical",
        FormatOptions(),
    ),
    "ros2-static-transform, parent is the camera, body": (
        "a.sh",
        f"static_transform_publisher {words(np.linalg.inv(T_LIDAR_BODY)[:3, 3])} "
        f"{words(rpy(np.linalg.inv(T_LIDAR_BODY))[::-1])} camera_link lidar 100",
        FormatOptions(frame="body"),
    ),
    "ros2-launch": (
        "a.launch.xml",
        "<launch><node pkg='tf2_ros' exec='static_transform_publisher' args='0 0 0 0 0 0 base imu'/>"
        f"<node pkg='tf2_ros' exec='static_transform_publisher' args='{ARGUMENTS} --frame-id l --child-frame-id "
        "cam0_optical'/></launch>",
        FormatOptions(lidar="l"),
    ),
    "tf2": ("a.yaml", yaml.dump(STAMPED), FormatOptions()),
    "apollo": ("a.yaml", yaml.dump(STAMPED | {"child_frame_id": "front_6mm"}), FormatOptions()),
    "autoware": ("a.yaml", yaml.dump(KIT), FormatOptions(camera="camera0/camera_link")),
    "autoware, optical": ("a.yaml", yaml.dump(KIT), FormatOptions(camera="camera1/camera_optical_link")),
    "urdf": (
        "a.urdf",
        "<robot><joint name='i' type='fixed'><parent link='base'/><child link='imu'/></joint>"
        f"<joint name='j' type='fixed'><origin xyz='{words(T_LIDAR_BODY[:3, 3])}' rpy='{words(rpy(T_LIDAR_BODY))}'/>"
        "<parent link='os_sensor'/><child link='camera_link'/></joint></robot>",
        FormatOptions(frame="body"),
    ),
    "kitti-odometry": ("calib.txt", f"P0: {words(np.eye(3, 4))}\nTr: {words(T_ANY[:3])}\n", FormatOptions()),
    "kitti-object": (
        "000000.txt",
        f"R0_rect: {words(R0)}\nTr_velo_to_cam: {words((np.linalg.inv(T_R0) @ T_ANY)[:3])}\nTr_imu_to_velo: 1\n",
        FormatOptions(),
    ),
    "kitti-360": ("calib_cam_to_velo.txt", words(T_LIDAR_CAMERA[:3]), FormatOptions()),
    "rellis-3d": (
        "transforms.yaml",
        yaml.dump(
            {
                RELLIS3D_KEY: {
                    "q": named("wxyz", wxyz(T_LIDAR_CAMERA)),
                    "t": named("xyz", T_LIDAR_CAMERA[:3, 3]),
                }
            }
        ),
        FormatOptions(),
    ),
    "nuscenes": ("calibrated_sensor.json", json.dumps(SENSORS), FormatOptions(camera="a", lidar="b")),
    "kalibr": (
        "chain.yaml",
        yaml.dump({"cam0": {"T_cam_lidar": T_ANY.tolist(), "rostopic": "/a"}}),
        FormatOptions(),
    ),
    "lidar2cam": (
        "calib.json",
        json.dumps(
            {"CAM_FRONT": {"lidar2cam": T_ANY.tolist()}, "CAM_BACK": {"lidar2cam": np.eye(4).tolist()}}
        ),
        FormatOptions(camera="CAM_FRONT"),
    ),
    "opencv": ("e.yml", OPENCV.format(", ".join(words(T_LIDAR_CAMERA).split())), C2L),
    "direct-visual-lidar": (
        "calib.json",
        json.dumps({"results": {"T_lidar_camera": [*T_LIDAR_CAMERA[:3, 3].tolist(), *xyzw(T_LIDAR_CAMERA)]}}),
        FormatOptions(),
    ),
    "opencalib": ("calib.txt", f"K: 1 0 0 0 1 0 0 0 1\nD: 0 0 0 0\nT: {words(T_ANY[:3])}\n", FormatOptions()),
    "fast-livo2": (
        "avia.yaml",
        yaml.dump(
            {
                "/**": {
                    "ros__parameters": {
                        "extrin_calib": {"Rcl": T_ANY[:3, :3].ravel().tolist(), "Pcl": T_ANY[:3, 3].tolist()}
                    }
                }
            }
        ),
        FormatOptions(),
    ),
    "colmap": (
        "rig_config.json",
        json.dumps(
            [
                {
                    "cameras": [
                        {"image_prefix": "left/", "ref_sensor": True},
                        {
                            "image_prefix": "right/",
                            "cam_from_rig_rotation": wxyz(T_ANY),
                            "cam_from_rig_translation": T_ANY[:3, 3].tolist(),
                        },
                    ]
                }
            ]
        ),
        FormatOptions(),
    ),
    "tum": ("pose.txt", f"# stamp x y z qx qy qz qw\n1.5 {words(T_ANY[:3, 3])} {words(xyzw(T_ANY))}\n", L2C),
    "text": ("T.txt", "\n".join(words(row) for row in T_LIDAR_CAMERA[:3]), C2L),
    "text, brackets": ("T.txt", str(T_ANY.tolist()), L2C),
}


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


@pytest.mark.parametrize("name", ["semcal", "tf2", "kalibr", "rellis-3d", "fast-livo2"])
def test_documents_are_json_where_the_files_suffix_says_so(name: str, tmp_path: Path) -> None:
    for suffix in (".json", ".yaml"):
        write_transform(T_ANY, tmp_path / f"T{suffix}", name)
        np.testing.assert_allclose(read_transform(tmp_path / f"T{suffix}"), T_ANY, atol=1e-9)
    json.loads((tmp_path / "T.json").read_text())


def test_sensors_are_named_by_channel_in_a_table_of_the_users(tmp_path: Path) -> None:
    table = tmp_path / "calibrated_sensor.json"
    table.write_text(json.dumps([dict(row, sensor_token=row["token"] * 2) for row in SENSORS]))
    channels = [{"token": "aa", "channel": "CAM_FRONT"}, {"token": "bb", "channel": "LIDAR_TOP"}]
    (tmp_path / "sensor.json").write_text(json.dumps(channels))
    options, T = (
        FormatOptions(camera="CAM_FRONT", lidar="LIDAR_TOP"),
        make_pose((0.5, -0.8, 1.9), (0.2, 0.1, -0.7)),
    )
    put_transform(T, table, options)
    np.testing.assert_allclose(read_transform(table, None, options), T, atol=1e-9)


def test_lines_that_say_nothing_of_it_stay_as_they_are(tmp_path: Path) -> None:
    """With the indentation of the file, and rows of a matrix on a line each."""
    text = (
        "# the rig\ncam0:\n    camera_model: pinhole   # of the left\n    intrinsics: [1.0, 2.0, 3.0, 4.0]\n"
        "    topics:\n      - /a\n      - '/b'\n    T_cam_lidar:\n"
        + "".join(f"      - [{', '.join(map(repr, row))}]\n" for row in np.eye(4).tolist())
        + "    resolution: [640, 480]\n"
    )
    file = tmp_path / "chain.yaml"
    file.write_text(text)
    put_transform(T_ANY, file, None)
    before, after = text.splitlines(), file.read_text().splitlines()
    assert len(after) == len(before)
    changed = [number for number, lines in enumerate(zip(before, after, strict=True)) if lines[0] != lines[1]]
    assert changed == [8, 9, 10]  # Of the matrix, whose last row is what it was.


def test_arrays_are_read_either_way_round(tmp_path: Path) -> None:
    np.save(tmp_path / "T.npy", T_LIDAR_CAMERA[:3].astype(np.float64))
    np.testing.assert_allclose(read_transform(tmp_path / "T.npy", None, C2L), T_ANY, atol=1e-12)


THERE_AND_BACK = 1e-8  # Roll, pitch and yaw lose half of their digits close to a pitch of 90 degrees.
RELATIVE = {"autoware": "sensor kit", "nuscenes": "vehicle"}


@pytest.mark.parametrize("name", [format.name for format in FORMATS if format.name not in RELATIVE])
@pytest.mark.parametrize("frame", ["optical", "body"])
@given(T=poses)
@settings(max_examples=8)
def test_there_and_back_is_the_same(name: str, frame: CameraFrame, T: np.ndarray) -> None:
    options = FormatOptions(direction="camera-to-lidar", frame=frame)
    content = find_format(name).write(T, options)
    suffix = (
        "calib_cam_to_velo.txt"
        if name == "kitti-360"
        else "f.json"
        if content.startswith((b"{", b"["))
        else "f"
    )
    source = Source(Path(suffix), content)
    assert find_format(name).recognises(source) or name == "apollo"
    again = find_format(name).read(source, options)
    np.testing.assert_allclose(again, T, atol=THERE_AND_BACK)


@pytest.mark.parametrize(("name", "relative_to"), RELATIVE.items())
def test_what_is_relative_to_something_else_needs_a_file(name: str, relative_to: str) -> None:
    with pytest.raises(
        InputError, match=f"--to {name}: poses are relative to the {relative_to}, needed --into a "
    ):
        find_format(name).write(T_ANY, FormatOptions())


@pytest.mark.parametrize(
    ("name", "text", "options", "kept"),
    [
        (
            "kit.yaml",
            "# our kit\n"
            + yaml.dump(KIT, default_flow_style=None).replace(
                "velodyne_top", "# the top one\n  velodyne_top"
            ),
            FormatOptions(camera="camera0/camera_link"),
            ["# our kit", "# the top one", "camera1/camera_optical_link"],
        ),
        (
            "avia.yaml",
            "/**:\n  ros__parameters:\n    common: {img_en: 1}  # keep\n    extrin_calib:\n"
            "      extrinsic_T: [0.1, 0.2, 0.3]\n      Rcl: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n      Pcl: [0, 0, 0]\n",
            FormatOptions(),
            ["common: {img_en: 1}  # keep", "extrinsic_T: [0.1, 0.2, 0.3]"],
        ),
        (
            "calibrated_sensor.json",
            json.dumps(SENSORS, indent=1),
            FormatOptions(camera="a", lidar="b"),
            ['\n  "token": "b"'],
        ),
        ("drive.yaml", DRIVE + "# the end\n", FormatOptions(), ["# the end", "K: [[640, 0, 639.5]"]),
    ],
)
def test_a_file_of_the_users_keeps_all_else(
    name: str, text: str, options: FormatOptions, kept: list[str], tmp_path: Path
) -> None:
    file, T = tmp_path / name, make_pose((0.5, -0.8, 1.9), (0.2, 0.1, -0.7))
    file.write_text(text)
    put_transform(T, file, options)
    np.testing.assert_allclose(read_transform(file, None, options), T, atol=1e-9)
    for piece in kept:
        assert piece in file.read_text()


@pytest.mark.parametrize(
    ("name", "text", "options", "complaint"),
    [
        (
            "a.yaml",
            "b: 1",
            [],
            "a.yaml: found top-level keys 'b', needed a transform, of --from one of: semcal, ",
        ),
        ("a.txt", "", [], "a.txt: found nothing, needed a transform, of --from one of: semcal, "),
        (
            "a.txt",
            words(T_ANY[:3]),
            [],
            "a.txt: found a transform of no stated direction, needed --direction ",
        ),
        (
            "a.txt",
            words(T_ANY[:3] * 1.2),
            ["--direction", "lidar-to-camera"],
            "--repair takes the nearest rotation",
        ),
        ("a.txt", words(-T_ANY[:3]), ["--direction", "lidar-to-camera", "--repair"], "found determinant -1 "),
        ("a.yaml", yaml.dump(KIT), [], "needed --camera to name one of them"),
        (
            "a.yaml",
            yaml.dump(STAMPED | {"child_frame_id": "cam0"}),
            [],
            "found the camera's frame 'cam0', needed --frame",
        ),
        (
            "a.yaml",
            yaml.dump(STAMPED | {"child_frame_id": "b"}),
            [],
            "found frames 'os_sensor' and 'b', needed --camera",
        ),
        (
            "a.json",
            json.dumps(SENSORS),
            [],
            "found 2 sensors, needed --camera with the token or channel of one of: a, b",
        ),
        (
            "a.yaml",
            "results: {T_lidar_camera: [1, 2]}",
            [],
            "results: T_lidar_camera: found a list of 2, needed 7 numbers",
        ),
        ("a.urdf", "<robot><joint/></robot>", [], "found links none, needed --camera to name one"),
        ("a.urdf", "<!DOCTYPE a><joint/>", [], "found <!DOCTYPE, needed XML without declarations"),
        (
            "a.sh",
            "static_transform_publisher 1 2 3 a b",
            [],
            "found 3 numbers, needed 6 or 7, then parent and child",
        ),
        ("a.sh", "static_transform_publisher --x 1 --wx 2", [], "found argument 'wx', needed some of: "),
        ("T.npy", "nothing", ["--from", "npy"], "found no NumPy array"),
        (
            "a.yaml",
            yaml.dump(STAMPED | {"header": {"frame_id": "base_link"}}),
            [],
            "found frame 'base_link', needed --lidar base_link if it is the LiDAR's own",
        ),
        ("a.urdf", ROBOT.replace("fixed", "revolute"), [], "joint 'in': found type 'revolute' between them"),
        ("a.urdf", ROBOT, ["--camera", "nose"], "found no joints from 'velodyne' to 'nose'"),
        ("calib.txt", f"T: {words(T_ANY[:3])}\n" * 2, [], "T: found it twice, needed it once"),
        (
            "a.txt",
            f"Tr: {words(T_ANY[:3])}",
            ["--camera", "Tr"],
            "--camera: found 'Tr', needed one of: P0, P1",
        ),
        (
            "a.txt",
            f"Tr: {words(T_ANY[:3])}\nP2: 1e-300 0 0 1e300 0 1e-300 0 0 0 0 1e-300 0",
            ["--camera", "P2"],
            "P2: found",
        ),
        (
            "a.sh",
            "static_transform_publisher 1 2 3 0 0 0 velodyne cam0_optical\n"
            "static_transform_publisher 1 2 4 0 0 0 velodyne cam1_optical\n",
            [],
            "found transforms velodyne to cam0_optical, velodyne to cam1_optical, needed --camera and --lidar",
        ),
        ("a.yaml", "results: 'a", [], "while scanning a quoted scalar"),
        ("a.json", "[" * 900 + "]" * 900, [], "needed a transform"),
        ("a.npy", "\x93NUMPY", [], "a damaged NumPy array"),
        (
            "a.txt",
            "Tr: 1 2 3 0 4 5 6 0 7 8 9 0",
            ["--repair"],
            "needed a rotation",
        ),
        ("a.json", json.dumps(SENSORS), ["--camera", "a", "--lidar", "a"], "found 'a' for both"),
        (
            "calib.txt",
            f"T: {words(T_ANY[:3])}",
            ["--direction", "camera-to-lidar"],
            "--direction: found 'camera-to-lidar', needed nothing: opencalib files leave that not open",
        ),
    ],
)
def test_what_a_file_leaves_open_or_has_wrong_is_said(
    name: str, text: str, options: list[str], complaint: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text, encoding="latin-1")
    found = CliRunner().invoke(semcal, ["convert", str(tmp_path / name), "--to", "semcal", *options])
    assert isinstance(found.exception, InputError), found.output
    assert complaint in str(found.exception)


@pytest.mark.parametrize(
    ("parent", "child", "options"),
    [
        ("velodyne", "camera_optical_frame", FormatOptions()),
        ("camera_optical_frame", "velodyne", FormatOptions()),
        ("velodyne", "camera_link", FormatOptions(frame="body")),
        ("base", "nose", FormatOptions(frame="optical", camera="nose", lidar="base")),
    ],
)
def test_a_file_in_place_keeps_its_frames(
    parent: str, child: str, options: FormatOptions, tmp_path: Path
) -> None:
    document = {"header": {"frame_id": parent}, "child_frame_id": child, "transform": STAMPED["transform"]}
    file, T = tmp_path / "a.yaml", make_pose((0.5, -0.8, 1.9), (0.2, 0.1, -0.7))
    file.write_text(yaml.dump(document))
    put_transform(T, file, options)
    np.testing.assert_allclose(read_transform(file, None, options), T, atol=1e-9)
    after = yaml.safe_load(file.read_text())
    assert (after["header"]["frame_id"], after["child_frame_id"]) == (parent, child)
    if options != FormatOptions():
        with pytest.raises(InputError, match=r"needed --to-(camera|frame|lidar) "):
            put_transform(T, file, FormatOptions())


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.yaml", yaml.dump(STAMPED | {"transform": None})),
        ("a.yaml", yaml.dump(STAMPED | {"transform": {"translation": [1, 2, 3]}})),
        ("a.yaml", yaml.dump(STAMPED | {"header": "lidar"})),
        ("a.yaml", f"{RELLIS3D_KEY}: 5"),
        ("a.json", json.dumps({"cam0": {"T_cam_lidar": 1}}).replace("1}}", '1}, "x": 1e400}')),
        ("a.yaml", yaml.dump(STAMPED) + "date: 2020-02-30\n"),
    ],
)
def test_files_that_cannot_be_edited_are_left_alone(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=rf"{name}: "):
        put_transform(T_ANY, tmp_path / name)
    assert (tmp_path / name).read_text() == text


def test_convert_replaces_nothing_that_it_reads(street: Path, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    shutil.copy(street / "drive.yaml", drive)
    before = (drive / "drive.yaml").read_bytes()
    for source in (drive, drive / "drive.yaml"):
        arguments = ["convert", str(source), "--to", "opencalib", "-o", str(drive / "drive.yaml")]
        assert isinstance(CliRunner().invoke(semcal, arguments).exception, InputError)
    assert (drive / "drive.yaml").read_bytes() == before
    os.mkfifo(tmp_path / "pipe")
    reader = Thread(target=lambda: seen.append((tmp_path / "pipe").read_text()))
    seen: list[str] = []
    reader.start()
    write_transform(T_ANY, tmp_path / "pipe", "opencalib")
    reader.join()
    assert seen[0].startswith("T: ")
    assert (tmp_path / "pipe").is_fifo()


def test_convert_repairs_aloud_and_writes(tmp_path: Path) -> None:
    scaled = T_ANY.copy()
    scaled[0, :3] *= 0.9
    (tmp_path / "T.txt").write_text("\n".join(words(row) for row in scaled))
    arguments = ["convert", str(tmp_path / "T.txt"), "--direction", "lidar-to-camera", "--repair"]
    out = tmp_path / "T.npy"
    found = CliRunner().invoke(
        semcal, [*arguments, "--to", "npy", "--to-direction", "camera-to-lidar", "-o", str(out)]
    )
    assert found.exit_code == 0, found.output
    assert "semcal: repaired: " in found.stderr
    assert "found no rotation (determinant 0.9, rows stretched by 0.9 to 1), took the nearest" in found.stderr
    assert Rotation.from_matrix((np.load(out) @ T_ANY)[:3, :3]).magnitude() < 0.1
    again = CliRunner().invoke(semcal, [*arguments, "--to", "text", "--to-direction", "lidar-to-camera"])
    rows = np.loadtxt(io.StringIO(again.stdout))
    np.testing.assert_allclose(rows, np.linalg.inv(np.load(out)), atol=1e-12)


def test_compare_reads_every_format(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(FILES["kitti-odometry"][1])
    (tmp_path / "b.json").write_text(FILES["direct-visual-lidar"][1])
    found = CliRunner().invoke(semcal, ["compare", str(tmp_path / "a.txt"), str(tmp_path / "b.json")])
    assert found.exit_code == 0, found.output
    assert found.stdout.splitlines()[-1] == "same"
