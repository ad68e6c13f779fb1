"""A tiny log becomes a drive whose points lie where Argoverse's own devkit projects them."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from av2.geometry.camera.pinhole_camera import PinholeCamera
from av2.structures.sweep import Sweep
from av2.utils.io import read_city_SE3_ego
from PIL import Image
from pyarrow import feather
from scipy.spatial.transform import Rotation
from semcal_argoverse2.dataset import read

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.importing.recording import Request
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.reading import read_clouds

LOG = "54bc6dbc-ebfb-3fba-b5b3-57f88b4b79ca"
FIRST_NS, PERIOD_NS, DELAY_NS = 315968112437425433, 100_000_000, 12_000_000
NUM_SWEEPS = 3
MOUNTINGS = {
    "ring_front_center": (0.502809, -0.499689, 0.500147, -0.497340, 1.631216, -0.000779, 1.432780),
    "ring_rear_left": (0.600598, -0.603227, -0.371096, 0.371061, 1.104117, 0.124369, 1.446070),
    "up_lidar": (0.999996, 0.0, 0.0, -0.002848, 1.350180, 0.0, 1.640420),
    "down_lidar": (-0.000089, -0.994497, 0.104767, 0.000243, 1.355162, 0.000133, 1.565252),
}
"""qw qx qy qz tx_m ty_m tz_m of the log that the user guide shows."""
SENSORS = ("sensor_name", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
GUIDE = [
    (-1.291016, 2.992188, -0.229370, 24, 31, 3318000),
    (-25.921875, 25.171875, 0.992188, 5, 14, 3318000),
    (-15.500000, 18.937500, 0.901855, 34, 16, 3320303),
    (-3.140625, 4.593750, -0.163696, 12, 30, 3320303),
    (-4.445312, 6.535156, -0.109802, 14, 29, 3322607),
    (18.312500, -38.187500, 3.279297, 26, 50, 106985185),
    (23.109375, -34.437500, 3.003906, 20, 49, 106987490),
    (20.015625, -37.062500, 2.550781, 12, 47, 106989794),
]
"""Rows of the sweep that the user guide shows: x y z intensity laser_number offset_ns."""
ELEVATIONS_DEG = {31: -25.0, 14: -1.0, 16: -1.667, 30: -15.639, 29: -11.31, 50: -2.333, 49: -2.0, 47: -1.333}
"""Elevations of these lasers in the manual of the VLP-32C, the highest first; 32 to 63 are 0 to 31 of the other one."""
TOLERANCE_PX = 2e-3
"""Clouds are float32: 4 micrometres at 64 m, and at 1 m before the camera a tenth of that, times 1,774 pixels."""


def write_table(path: Path, names: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = {name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
    feather.write_feather(pa.table(columns), path)


def write_sweep(path: Path, rows: list[tuple[float, ...]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    types = {"x": "f2", "y": "f2", "z": "f2", "intensity": "u1", "laser_number": "u1", "offset_ns": "i4"}
    columns = zip(*rows, strict=True)
    arrays = {name: np.array(column, types[name]) for name, column in zip(types, columns, strict=True)}
    feather.write_feather(pa.table(arrays), path)


def sweep_ns(index: int) -> int:
    return FIRST_NS + index * PERIOD_NS


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A log that turns at 1 rad/s and drives at 12 m/s, with poses for each sweep and each image, and some twice."""
    log = tmp_path / "set/train" / LOG
    write_table(
        log / "calibration/egovehicle_SE3_sensor.feather", SENSORS, [(k, *v) for k, v in MOUNTINGS.items()]
    )
    names = ("sensor_name", "fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "k3", "height_px", "width_px")
    front = ("ring_front_center", 1773.5, 1773.5, 775.8, 1020.3, -0.3, -0.2, 0.3, 2048, 1550)
    rear = ("ring_rear_left", 1686.5, 1686.5, 1025.7, 776.1, -0.2, -0.1, 0.2, 1550, 2048)
    write_table(log / "calibration/intrinsics.feather", names, [front, rear])
    rng = np.random.default_rng(1)
    for index in range(NUM_SWEEPS):
        points = rng.uniform((-40.0, -15.0, -0.3), (40.0, 15.0, 4.0), (400, 3)).tolist()
        rows = [(*point, i % 256, i % 64, i * 250_000) for i, point in enumerate(points)]
        write_sweep(log / f"sensors/lidar/{sweep_ns(index)}.feather", [*rows, *GUIDE])
        for camera in ("ring_front_center", "ring_rear_left"):
            for delay_ns in (DELAY_NS, DELAY_NS + PERIOD_NS // 2):
                image = log / f"sensors/cameras/{camera}/{sweep_ns(index) + delay_ns}.jpg"
                image.parent.mkdir(parents=True, exist_ok=True)
                Image.new("L", (1550, 2048) if camera == "ring_front_center" else (2048, 1550)).save(image)
    moments = [sweep_ns(index) + delay for index in range(-1, NUM_SWEEPS + 1) for delay in (0, 1, DELAY_NS)]
    poses = [(moment, *pose_at(moment)) for moment in moments]
    write_table(log / "city_SE3_egovehicle.feather", ("timestamp_ns", *SENSORS[1:]), poses)
    return tmp_path / "set"


def pose_at(moment_ns: int) -> tuple[float, ...]:
    """qw qx qy qz tx_m ty_m tz_m of the vehicle in the city."""
    seconds = (moment_ns - FIRST_NS) * 1e-9
    x, y, z, w = Rotation.from_euler("ZYX", (0.7 + seconds, 0.01, -0.02)).as_quat()
    return w, x, y, z, 747.4 + 12.0 * np.cos(0.7) * seconds, 1275.3 + 12.0 * np.sin(0.7) * seconds, -24.3


def imported(root: Path, out: Path, **asked: str) -> Drive:
    return read_drive(write_drive(read(Request(root, **asked)), FrameChoice(), out).path)


def projected(drive: Drive) -> list[np.ndarray]:
    """Pixels (N, 2) of the points of each frame, and their depth, as the drive says."""
    T = np.array(drive.T_camera_lidar)
    pixels = []
    for moved in compensated(drive, read_clouds(drive, None)):
        points_camera = moved.points.astype(float) @ T[:3, :3].T + T[:3, 3]
        homogeneous = points_camera @ np.array(drive.camera.K).T
        pixels.append(np.column_stack([homogeneous[:, :2] / homogeneous[:, 2:], points_camera[:, 2]]))
    return pixels


@pytest.mark.parametrize("camera", ["ring_front_center", "ring_rear_left"])
@pytest.mark.parametrize("lidar", ["up_lidar", "down_lidar"])
def test_points_lie_where_the_devkit_projects_them(
    root: Path, tmp_path: Path, lidar: str, camera: str
) -> None:
    drive = imported(root, tmp_path / "drive", lidar=lidar, camera=camera)
    log = root / "train" / LOG
    pinhole, T_city_ego = PinholeCamera.from_feather(log, camera), read_city_SE3_ego(log)
    assert len(drive.frames) == NUM_SWEEPS
    assert drive.synchronization == "hardware"
    assert (drive.frame_ids.lidar, drive.frame_ids.camera) == (lidar, camera)
    np.testing.assert_array_equal(drive.camera.K, pinhole.intrinsics.K)
    assert (drive.camera.width, drive.camera.height) == (pinhole.width_px, pinhole.height_px)
    for index, (frame, found) in enumerate(zip(drive.frames, projected(drive), strict=True)):
        cloud_ns, image_ns = sweep_ns(index), sweep_ns(index) + DELAY_NS
        assert Path(frame.image).name == f"{image_ns}.jpg"
        assert (frame.points_stamp, frame.image_stamp) == (cloud_ns / 10**9, image_ns / 10**9)
        sweep = Sweep.from_feather(log / f"sensors/lidar/{cloud_ns}.feather")
        is_of_lidar = (sweep.laser_number < 32) == (lidar == "up_lidar")
        uv, points_camera, _ = pinhole.project_ego_to_img_motion_compensated(
            sweep.xyz[is_of_lidar], T_city_ego[image_ns], T_city_ego[cloud_ns]
        )
        is_ahead = points_camera[:, 2] > 1.0
        assert is_ahead.sum() > 30
        np.testing.assert_allclose(found[is_ahead, :2], uv[is_ahead], atol=TOLERANCE_PX)
        np.testing.assert_allclose(found[:, 2], points_camera[:, 2], atol=1e-5)


def test_the_motion_between_sweep_and_image_counts(root: Path, tmp_path: Path) -> None:
    """Without it, pixels are off by many times the tolerance."""
    drive = imported(root, tmp_path / "drive")
    still = drive.model_copy(update={"motion": None})
    still._path = drive.path
    moving, standing = projected(drive)[0], projected(still)[0]
    is_ahead = moving[:, 2] > 1.0
    assert np.abs(moving - standing)[is_ahead, :2].max(axis=1).min() > 5.0


def test_lasers_point_where_the_manual_says(root: Path, tmp_path: Path) -> None:
    """The rows that the user guide shows tell which lasers are whose: each LiDAR sees its own at their elevations."""
    for lidar, lasers in (("up_lidar", range(32)), ("down_lidar", range(32, 64))):
        drive = imported(root, tmp_path / lidar, lidar=lidar)
        shown = [row[4] for row in GUIDE if row[4] in lasers]
        x, y, z = read_clouds(drive, None)[0].points[-len(shown) :].T
        elevations_deg = np.degrees(np.arctan2(z, np.hypot(x, y)))
        expected = [ELEVATIONS_DEG[laser] for laser in shown]
        # Sweeps are of another log than the mountings, and their coordinates are float16.
        np.testing.assert_allclose(elevations_deg, expected, atol=0.5)


def test_the_command_has_the_options(root: Path, tmp_path: Path) -> None:
    """As installed: the entry point is found, and `--lidar` is its option."""
    command = [sys.executable, "-m", "semcal_cli", "import", "argoverse2", str(root), "--lidar", "down_lidar"]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "drive")], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert f"wrote {tmp_path / 'drive/drive.yaml'}: 3 frames, 3 clouds converted" in done.stderr
    assert read_drive(tmp_path / "drive").frame_ids.lidar == "down_lidar"


def test_the_speed_of_each_frame_is_known(root: Path) -> None:
    """The LiDAR is 1.35 m before the origin of the vehicle, which turns at 1 rad/s: it is faster or slower by that."""
    speeds = [frame.speed_mps for frame in read(Request(root)).frames]
    np.testing.assert_allclose(speeds, 12.0, atol=1.35)


def test_frames_without_poses_are_left_out(root: Path, tmp_path: Path) -> None:
    file = root / "train" / LOG / "city_SE3_egovehicle.feather"
    feather.write_feather(feather.read_table(file).slice(0, 8), file)
    recording = read(Request(root))
    assert [frame.name for frame in recording.frames] == [str(sweep_ns(0))]
    assert "left out 2 frames without poses around them" in recording.remarks


def test_sweeps_without_an_image_are_said_to_be(root: Path) -> None:
    folder = root / "train" / LOG / "sensors/cameras/ring_front_center"
    for image in folder.iterdir():
        image.rename(folder / f"{int(image.stem) + 10**10}.jpg")
    with pytest.raises(
        InputError, match=f"{LOG}: found no sweep with an image of ring_front_center within 0.05 s"
    ):
        read(Request(root))


def change(file: Path, name: str, values: list[object]) -> None:
    table = feather.read_table(file)
    index = table.column_names.index(name)
    feather.write_feather(table.set_column(index, name, pa.array(values)), file)


@pytest.mark.parametrize(
    ("file", "column", "value", "said"),
    [
        ("calibration/intrinsics.feather", "fx_px", -1.0, "{file}: K: found focal lengths -1"),
        (
            "calibration/intrinsics.feather",
            "width_px",
            0,
            "{file}: width_px: found 0.0, expected a whole number",
        ),
        ("calibration/egovehicle_SE3_sensor.feather", "qw", 2.0, "{file}: found a quaternion of norm"),
        (
            "calibration/egovehicle_SE3_sensor.feather",
            "tx_m",
            "1",
            "{file}: tx_m: found values that are not finite numbers",
        ),
        (
            "calibration/egovehicle_SE3_sensor.feather",
            "tx_m",
            None,
            "{file}: tx_m: found values that are not finite numbers",
        ),
        (
            "city_SE3_egovehicle.feather",
            "tz_m",
            float("nan"),
            "{file}: tz_m: found values that are not finite numbers",
        ),
        (
            f"sensors/lidar/{FIRST_NS}.feather",
            "x",
            float("inf"),
            "{file}: x: found values that are not finite numbers",
        ),
    ],
)
def test_wrong_values_are_named(
    root: Path, tmp_path: Path, file: str, column: str, value: object, said: str
) -> None:
    path = root / "train" / LOG / file
    change(path, column, [value] * feather.read_table(path).num_rows)
    with pytest.raises(InputError) as error:
        imported(root, tmp_path / "drive")
    assert str(error.value).startswith(said.format(file=path))
    assert not (tmp_path / "drive").exists()


@pytest.mark.parametrize("asked", ["camera", "lidar", "sequence"])
def test_unknown_names_are_named(root: Path, asked: str) -> None:
    with pytest.raises(InputError, match=f"{asked}: found 'roof', expected"):
        read(Request(root, **{asked: "roof"}))


def test_missing_and_damaged_files_are_named(root: Path, tmp_path: Path) -> None:
    log = root / "train" / LOG
    with pytest.raises(InputError, match="found no sequence, expected folders of logs, with calibration/ego"):
        read(Request(tmp_path))
    (log / "calibration/intrinsics.feather").write_bytes(b"no table")
    with pytest.raises(InputError, match=r"intrinsics\.feather: found no Feather table, expected one: "):
        read(Request(root))
    feather.write_feather(pa.table({"sensor_name": ["a"]}), log / "calibration/intrinsics.feather")
    with pytest.raises(InputError, match="found columns sensor_name, expected one fx_px"):
        read(Request(root))
