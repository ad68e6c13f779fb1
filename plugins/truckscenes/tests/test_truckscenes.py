"""A tiny scene becomes a drive whose points lie where the devkit of TruckScenes puts them."""

import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pyquaternion import Quaternion
from semcal_truckscenes.dataset import read

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.importing.recording import Request
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.reading import read_clouds

truckscenes = pytest.importorskip("truckscenes", reason="the devkit needs Python below 3.12")
from truckscenes.utils.data_classes import LidarPointCloud  # noqa: E402

MOUNTINGS = {
    "LIDAR_LEFT": ((5.4, 1.2, 2.3), Quaternion(axis=(0.1, 0.2, 1.0), degrees=70.0)),
    "LIDAR_TOP_FRONT": ((4.9, 0.0, 3.5), Quaternion(axis=(0.0, 1.0, 0.0), degrees=12.0)),
    "CAMERA_LEFT_FRONT": (
        (5.2, 1.1, 2.2),
        Quaternion(0.5, -0.5, 0.5, -0.5) * Quaternion(axis=(0, 1, 0), degrees=9),
    ),
    "CAMERA_RIGHT_BACK": ((5.1, -1.3, 2.4), Quaternion(-0.5, 0.5, 0.5, -0.5)),
}
LIDARS, CAMERAS = [*MOUNTINGS][:2], [*MOUNTINGS][2:]
K = [[990.0, 0.0, 991.5], [0.0, 989.0, 470.5], [0.0, 0.0, 1.0]]
START_US = 1_695_473_372_700_000
PERIOD_US, DELAY_US, NUM_SWEEPS, KEYFRAMES = 100_000, 37_000, 12, (3, 8)
TOLERANCE_M = 2e-5
"""Points are float32, 8 micrometres at 64 m, and positions have 12 digits, 10 micrometres in Germany's UTM."""


def stamp_us(channel: str, index: int) -> int:
    return START_US + index * PERIOD_US + (DELAY_US if channel in CAMERAS else 0)


def ego_pose(moment_us: int) -> tuple[np.ndarray, Quaternion]:
    """The truck drives at 20 m/s and turns at 0.5 rad/s."""
    seconds = (moment_us - START_US) * 1e-6
    place = np.array([691_000.0, 5_336_000.0, 0.0]) + 20.0 * seconds * np.array(
        [np.cos(0.4), np.sin(0.4), 0.0]
    )
    return place, Quaternion(axis=(0.0, 0.0, 1.0), radians=0.4 + 0.5 * seconds)


def write_pcd(path: Path, points: np.ndarray, times_us: np.ndarray) -> None:
    """PCD as in the data set: x y z intensity as float32, and the time as a whole number of microseconds."""
    record = np.dtype([*((name, "<f4") for name in ("x", "y", "z", "intensity")), ("timestamp", "<u8")])
    cloud = np.zeros(len(points), record)
    for axis, column in zip("xyz", points.T, strict=True):
        cloud[axis] = column
    cloud["intensity"], cloud["timestamp"] = 0.5, times_us
    header = (
        "VERSION 0.7\nFIELDS x y z intensity timestamp\nSIZE 4 4 4 4 8\nTYPE F F F F U\nCOUNT 1 1 1 1 1\n"
        f"WIDTH {len(cloud)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(cloud)}\nDATA binary\n"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(header.encode() + cloud.tobytes())


def write_scene(root: Path, *, is_still: bool) -> Path:
    """A scene of 12 sweeps and images, of which 2 are keyframes; `is_still`: all points are of the time of the sweep.

    Otherwise points have the times of the image before, of the sweep and of the image after, for each of which there is
    a pose.
    """
    rng = np.random.default_rng(5)
    tables: dict[str, list[dict[str, object]]] = {
        name: [] for name in ("attribute", "category", "instance", "sample_annotation", "visibility")
    } | {
        name: []
        for name in (
            "ego_motion_cabin",
            "ego_motion_chassis",
            "weather_annotation",
            "ego_pose",
            "sample_data",
        )
    }
    tables["scene"] = [
        {"token": "scene", "name": "scene-a", "first_sample_token": "s0", "last_sample_token": "s1"}
    ]
    tables["sample"] = [
        {"token": f"s{i}", "scene_token": "scene", "timestamp": stamp_us("", index), "next": "", "prev": ""}
        for i, index in enumerate(KEYFRAMES)
    ]
    tables["sensor"] = [
        {"token": f"of {name}", "channel": name, "modality": name.partition("_")[0].lower()}
        for name in MOUNTINGS
    ]
    tables["calibrated_sensor"] = [
        {
            "token": f"on {name}",
            "sensor_token": f"of {name}",
            "translation": [*place],
            "rotation": [*turn],
            "camera_intrinsic": K if name in CAMERAS else [],
        }
        for name, (place, turn) in MOUNTINGS.items()
    ]
    for channel in MOUNTINGS:
        for index in range(NUM_SWEEPS):
            moment, token, is_key = stamp_us(channel, index), f"{channel}{index}", index in KEYFRAMES
            suffix = "jpg" if channel in CAMERAS else "pcd"
            file = f"{'samples' if is_key else 'sweeps'}/{channel}/{channel}_{moment}.{suffix}"
            place, turn = ego_pose(moment)
            tables["ego_pose"].append(
                {"token": f"at {token}", "timestamp": moment, "translation": [*place], "rotation": [*turn]}
            )
            tables["sample_data"].append(
                {
                    "token": token,
                    "sample_token": "s0" if index <= KEYFRAMES[0] else "s1",
                    "ego_pose_token": f"at {token}",
                    "calibrated_sensor_token": f"on {channel}",
                    "filename": file,
                    "fileformat": suffix,
                    "width": 1980,
                    "height": 943,
                    "timestamp": moment,
                    "is_key_frame": is_key,
                    "next": "",
                    "prev": "",
                }
            )
            if is_key and suffix == "pcd":
                points = rng.uniform((-40, -40, -3), (40, 40, 5), (300, 3)).astype(np.float32)
                times = moment + rng.choice([DELAY_US - PERIOD_US, 0, DELAY_US], 300) * (not is_still)
                write_pcd(root / file, points, times)
            elif is_key:
                (root / file).parent.mkdir(parents=True, exist_ok=True)
                Image.new("L", (1980, 943)).save(root / file)
    for name, rows in tables.items():
        path = root / f"v1.2-mini/{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(rows))
    return root


def imported(root: Path, out: Path, **asked: str) -> Drive:
    return read_drive(write_drive(read(Request(root, **asked)), FrameChoice(), out).path)


def points_camera(drive: Drive) -> list[np.ndarray]:
    """Points (N, 3) of each frame in the camera at the time of its image, metres, as the drive says."""
    T = np.array(drive.T_camera_lidar)
    moved = compensated(drive, read_clouds(drive, None))
    return [cloud.points.astype(float) @ T[:3, :3].T + T[:3, 3] for cloud in moved]


def devkit(root: Path) -> "truckscenes.TruckScenes":
    with warnings.catch_warnings():  # The devkit warns that what draws is not installed.
        warnings.simplefilter("ignore")
        return truckscenes.TruckScenes("v1.2-mini", str(root), verbose=False)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("lidar", LIDARS)
def test_points_lie_where_the_devkit_puts_them(tmp_path: Path, lidar: str, camera: str) -> None:
    """The devkit moves a sweep as a whole, so that its points are all of one time here."""
    root = write_scene(tmp_path / "set", is_still=True)
    drive, known = imported(root, tmp_path / "drive", lidar=lidar, camera=camera), devkit(root)
    assert (drive.camera.width, drive.camera.height) == (1980, 943)
    np.testing.assert_array_equal(drive.camera.K, K)
    assert drive.synchronization == "stamps"
    assert (drive.frame_ids.lidar, drive.frame_ids.camera) == (lidar, camera)
    assert len(drive.frames) == len(KEYFRAMES)
    for frame, found, sample in zip(drive.frames, points_camera(drive), known.sample, strict=True):
        sweep, image = (known.get("sample_data", sample["data"][channel]) for channel in (lidar, camera))
        for row, file, stamp in (
            (sweep, frame.points, frame.points_stamp),
            (image, frame.image, frame.image_stamp),
        ):
            assert (
                drive.resolve(str(file)).resolve() == Path(known.get_sample_data_path(row["token"])).resolve()
            )
            assert abs(stamp - row["timestamp"] * 1e-6) < 1e-6
        cloud, _ = LidarPointCloud.from_file_multisweep(
            known, sample, lidar, camera, nsweeps=1, min_distance=0.0
        )
        np.testing.assert_allclose(found, cloud.points[:3].T, atol=TOLERANCE_M)


def test_each_point_is_moved_from_its_own_time(tmp_path: Path) -> None:
    root = write_scene(tmp_path / "set", is_still=False)
    drive = imported(root, tmp_path / "drive")
    for frame, found in zip(drive.frames, points_camera(drive), strict=True):
        cloud = LidarPointCloud.from_file(str(drive.resolve(frame.points)))
        expected = [
            in_camera(point, int(time), round(frame.image_stamp * 1e6))
            for point, time in zip(cloud.points[:3].T, cloud.timestamps[0], strict=True)
        ]
        np.testing.assert_allclose(found, expected, atol=TOLERANCE_M)
        assert len({*cloud.timestamps[0].tolist()}) == 3


def in_camera(point_lidar: np.ndarray, time_us: int, image_us: int) -> np.ndarray:
    """A point of one moment in the camera at another, through the poses of the truck at both."""
    point = point_lidar
    for place, turn in (MOUNTINGS["LIDAR_LEFT"], ego_pose(time_us)):
        point = turn.rotate(point) + place
    for place, turn in (ego_pose(image_us), MOUNTINGS["CAMERA_LEFT_FRONT"]):
        point = turn.inverse.rotate(point - place)
    return point


def test_the_command_has_the_options(tmp_path: Path) -> None:
    """As installed: the entry point is found, and has `--lidar` and `--version`."""
    root = write_scene(tmp_path / "set", is_still=False)
    asked = [
        "--lidar",
        "LIDAR_TOP_FRONT",
        "--version",
        "v1.2-mini",
        "--sequence",
        "scene-a",
        "-o",
        str(tmp_path / "drive"),
    ]
    command = [sys.executable, "-m", "semcal_cli", "import", "truckscenes", str(root), *asked]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"wrote {tmp_path / 'drive/drive.yaml'}: 2 frames" in done.stderr
    assert read_drive(tmp_path / "drive").frame_ids.lidar == "LIDAR_TOP_FRONT"


def test_frames_without_poses_are_left_out(tmp_path: Path) -> None:
    root = write_scene(tmp_path / "set", is_still=True)
    file = root / "v1.2-mini/sample_data.json"
    rows = json.loads(file.read_text())
    early = [row for row in rows if row["timestamp"] <= stamp_us("CAMERA_LEFT_FRONT", KEYFRAMES[1])]
    file.write_text(json.dumps(early))
    recording = read(Request(root))
    assert [frame.name for frame in recording.frames] == [f"LIDAR_LEFT{KEYFRAMES[0]}"]
    assert "left out 1 frame without poses around them" in recording.remarks
    file.write_text(json.dumps([row for row in rows if row["is_key_frame"]]))
    with pytest.raises(
        InputError, match="found no poses before and after the sweep and the image of any frame"
    ):
        read(Request(root))


@pytest.mark.parametrize("asked", ["camera", "lidar", "sequence", "version"])
def test_unknown_names_are_named(tmp_path: Path, asked: str) -> None:
    root = write_scene(tmp_path / "set", is_still=True)
    with pytest.raises(InputError, match=f"{asked}: found 'roof', expected"):
        read(Request(root, **{asked: "roof"}))
