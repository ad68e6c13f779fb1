"""Transforms in files of every format: how they are written."""

import io
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from commands import invoke
from conftest import poses
from format_files import SENSORS, T_ANY, words
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from semcal_cli.config.directions import CameraFrame
from semcal_cli.errors import InputError
from semcal_cli.formats import FORMATS, convert, find_format, read_transform, write_transform
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.formats.kitti_files import KITTI_360_FILE
from semcal_cli.report.notations import files


@pytest.mark.parametrize("name", ["semcal", "tf2", "kalibr", "rellis-3d", "fast-livo2", "extrinsic-matrix"])
def test_documents_are_json_where_the_files_suffix_says_so(name: str, tmp_path: Path) -> None:
    options = FormatOptions("lidar-to-camera" if name == "extrinsic-matrix" else None)
    for suffix in (".json", ".yaml"):
        write_transform(T_ANY, tmp_path / f"T{suffix}", name, options)
        np.testing.assert_allclose(read_transform(tmp_path / f"T{suffix}", None, options), T_ANY, atol=1e-9)
    json.loads((tmp_path / "T.json").read_text())


def test_sensors_are_named_by_channel_in_a_table_of_the_users(tmp_path: Path) -> None:
    table = tmp_path / "calibrated_sensor.json"
    table.write_text(json.dumps([dict(row, sensor_token=row["token"] * 2) for row in SENSORS]))
    channels = [{"token": "aa", "channel": "CAM_FRONT"}, {"token": "bb", "channel": "LIDAR_TOP"}]
    (tmp_path / "sensor.json").write_text(json.dumps(channels))
    options = FormatOptions(camera="CAM_FRONT", lidar="LIDAR_TOP")
    np.testing.assert_allclose(read_transform(table, None, options), T_ANY, atol=1e-9)


THERE_AND_BACK = 5e-7
"""Nine decimals of a quaternion move a camera 100 m away by so much, metres. Roll, pitch and yaw lose half of their
digits close to a pitch of 90 degrees."""
ONLY_READ = ("ros2-launch-py", "opencalib-json")
OF_CAMERA_0 = ("kitti-odometry", "kitti-object")
RELATIVE = {
    "autoware": "sensor kit",
    "nuscenes": "vehicle",
    "calibration-anywhere": "parent",
    "driveworks": "rig",
}


@pytest.mark.parametrize(
    "name",
    [
        format.name
        for format in FORMATS
        if format.name not in {*RELATIVE, *ONLY_READ} and format.has_transform
    ],
)
@pytest.mark.parametrize("frame", ["optical", "body"])
@given(T=poses)
@settings(max_examples=8)
def test_there_and_back_is_the_same(name: str, frame: CameraFrame, T: np.ndarray) -> None:
    options = FormatOptions(direction="camera-to-lidar", frame=frame, covariance=np.eye(6))
    content = find_format(name).write(T, replace(options, camera="P0" if name in OF_CAMERA_0 else None))
    file = KITTI_360_FILE if name == "kitti-360" else "f.json" if content.startswith((b"{", b"[")) else "f"
    source = Source(Path(file), content)
    assert find_format(name).recognises(source) or name == "apollo"
    again = find_format(name).read(source, options)
    np.testing.assert_allclose(again, T, atol=THERE_AND_BACK)


def test_what_may_be_another_camera_s_is_not_written_as_camera_0_s(tmp_path: Path) -> None:
    write_transform(T_ANY, tmp_path / "T.yaml", "semcal")
    for name in OF_CAMERA_0:
        for camera in (None, "P2"):
            with pytest.raises(InputError, match=f"to {name}: (found .*; )?add camera P0, if "):
                find_format(name).write(T_ANY, FormatOptions(camera=camera))
    for name in ("kitti-raw", "kitti-360"):
        done = invoke("convert", tmp_path / "T.yaml", "--to", name)
        assert (
            done.stderr == f"--to {name}: the transform is written as that of camera 0 before rectification\n"
        )
    assert not [text.name for text in files(T_ANY) if "kitti" in text.name]


@pytest.mark.parametrize(("name", "relative_to"), RELATIVE.items())
def test_what_is_relative_to_something_else_is_only_read(name: str, relative_to: str) -> None:
    with pytest.raises(
        InputError,
        match=f"to {name}: poses are relative to the {relative_to}; (add base .*, or )?choose another format: ",
    ):
        find_format(name).write(T_ANY, FormatOptions())


def test_convert_replaces_nothing_that_it_reads(street: Path, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    shutil.copy(street / "drive.yaml", drive)
    before = (drive / "drive.yaml").read_bytes()
    for source in (drive, drive / "drive.yaml"):
        found = invoke("convert", source, "--to", "opencalib", "-o", drive / "drive.yaml")
        assert isinstance(found.exception, InputError)
        with pytest.raises(InputError, match=r"drive.yaml: found the input file; choose another name"):
            convert(source, "opencalib", drive / "drive.yaml")
    assert (drive / "drive.yaml").read_bytes() == before
    os.mkfifo(tmp_path / "pipe")
    reader = Thread(target=lambda: seen.append((tmp_path / "pipe").read_text()))
    seen: list[str] = []
    reader.start()
    write_transform(T_ANY, tmp_path / "pipe", "opencalib")
    reader.join()
    assert seen[0].startswith("T: ")
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize(
    ("name", "value", "needed"),
    [
        ("direction", "lidar_to_camera", "one of: lidar-to-camera, camera-to-lidar"),
        ("frame", "bodyy", "one of: optical, body"),
        ("camera", 3, "a name"),
        ("lidar", b"x", "a name"),
    ],
)
def test_options_of_a_program_are_checked(name: str, value: object, needed: str) -> None:
    with pytest.raises(InputError) as error:
        FormatOptions(**{name: value})  # type: ignore[arg-type]
    assert str(error.value) == f"{name}: found {value!r}, expected {needed}"


def test_convert_repairs_aloud_and_writes(tmp_path: Path) -> None:
    scaled = T_ANY.copy()
    scaled[0, :3] *= 0.9
    (tmp_path / "T.txt").write_text("\n".join(words(row) for row in scaled))
    arguments = ["convert", tmp_path / "T.txt", "--direction", "lidar-to-camera", "--repair"]
    out = tmp_path / "T.npy"
    found = invoke(*arguments, "--to", "npy", "--to-direction", "camera-to-lidar", "-o", out)
    assert found.exit_code == 0, found.output
    assert "semcal: repaired: " in found.stderr
    assert (
        "found a matrix that is not a rotation (determinant 0.9, singular values 0.9 to 1), used the nearest rotation"
        in found.stderr
    )
    assert Rotation.from_matrix((np.load(out) @ T_ANY)[:3, :3]).magnitude() < 0.1
    again = invoke(*arguments, "--to", "text", "--to-direction", "lidar-to-camera")
    rows = np.loadtxt(io.StringIO(again.stdout))
    np.testing.assert_allclose(rows, np.linalg.inv(np.load(out)), atol=1e-12)


def test_a_file_that_holds_more_is_replaced_only_by_force(street: Path, tmp_path: Path) -> None:
    """A robot is not lost to a joint; a transform that was written before is replaced by the next."""
    robot = tmp_path / "robot.urdf"
    robot.write_text('<robot name="precious"><link name="base"/></robot>\n')
    words = ["convert", street, "--to", "urdf", "--to-lidar", "lidar", "--to-camera", "camera", "-o", robot]
    refused = invoke(*words)
    assert str(refused.exception) == (
        f"{robot}: found a file that holds something else than a transform of urdf; choose another -o, or --force"
    )
    assert "precious" in robot.read_text()
    for more in (["--force"], []):
        done = invoke(*words, *more)
        assert done.exit_code == 0, done.output
        assert "a joint alone; --into robot.urdf" in done.output
    turned = read_transform(street)
    turned[:3, 3] += 0.5
    write_transform(turned, tmp_path / "other.yaml", "semcal")
    assert invoke("convert", tmp_path / "other.yaml", *words[2:]).exit_code == 0
