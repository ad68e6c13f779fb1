"""A tiny sequence becomes a drive whose points lie where the devkit of ZOD projects them."""

import json
import subprocess
import sys
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from semcal_zod.dataset import read
from zod.constants import Camera, Lidar
from zod.data_classes.calibration import Calibration
from zod.data_classes.ego_motion import EgoMotion
from zod.data_classes.sensor import LidarData
from zod.utils.compensation import motion_compensate_pointwise
from zod.visualization.lidar_on_image import project_lidar_to_image

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.importing.recording import Request
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.reading import read_clouds

START_S = 1_655_199_648.0
NUM_SWEEPS, PERIOD_S, DELAY_S = 4, 0.1, 0.021
TOLERANCE_M = 1.5e-4
"""Between poses 0.2 m and 5 mrad apart, the devkit goes straight on and semcal along an arc, 0.125 mm beside it."""
TOLERANCE_PX = 5e-3
"""Points are float32, 4 micrometres at 60 m, and 2,500 pixels are a radian."""


def pose(turn: tuple[float, float, float], place: tuple[float, float, float]) -> list[list[float]]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("ZYX", turn, degrees=True).as_matrix(), place
    return T.tolist()


CALIBRATION = {
    "FC": {
        "extrinsics": pose((-90.5, 1.0, -89.0), (2.0, 0.05, 1.4)),
        "lidar_extrinsics": pose((-89.0, 0.5, -0.4), (1.1, -0.1, 1.9)),
        "intrinsics": [[2500.0, 0.0, 1921.0, 0.0], [0.0, 2498.0, 1081.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        "distortion": [0.03, -0.02, 0.004, -0.0005],
        "undistortion": [0.0, 0.0, 0.0, 0.0],
        "image_dimensions": [3848, 2168],
        "field_of_view": [100.0, 60.0],
    }
}


def name_of(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def sweep_s(index: int) -> float:
    return START_S + index * PERIOD_S


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A sequence of a car that drives at 20 m/s and turns at 0.5 rad/s, with 100 poses a second."""
    folder = tmp_path / "zod/sequences/000002"
    for name in ("lidar_velodyne", "camera_front_blur"):
        (folder / name).mkdir(parents=True)
    (folder / "calibration.json").write_text(json.dumps(CALIBRATION))
    times_s = START_S - 0.205 + 0.01 * np.arange(90)
    since = times_s - START_S
    turns = np.degrees(0.5 * since)
    places = np.column_stack([20.0 * since, 3.0 * since, 0.1 * since])
    nothing = np.zeros((len(since), 3)).tolist()
    motion = {
        "poses": [pose((turn, 1.0, 0.5), tuple(place)) for turn, place in zip(turns, places, strict=True)],
        "timestamps": times_s.tolist(),
        **dict.fromkeys(("velocities", "accelerations", "angular_rates"), nothing),
        "origin_lat_lon": [57.7, 11.9],
    }
    (folder / "ego_motion.json").write_text(json.dumps(motion))
    rng = np.random.default_rng(2)
    for index in range(NUM_SWEEPS):
        points = rng.uniform((-30.0, 4.0, -3.0), (30.0, 60.0, 5.0), (400, 3)).astype(np.float32)
        sweep = LidarData(
            points,
            sweep_s(index) + rng.integers(-75_000, 25_000, 400) * 1e-6,
            rng.integers(0, 255, 400).astype(np.uint8),
            rng.integers(0, 127, 400).astype(np.uint8),
            sweep_s(index),
        )
        sweep.to_npy(str(folder / f"lidar_velodyne/000002_romeo_{name_of(sweep_s(index))}.npy"))
        image = Image.new("L", (3848, 2168))
        for delay_s in (DELAY_S, DELAY_S + PERIOD_S / 3.0):
            image.save(folder / f"camera_front_blur/000002_romeo_{name_of(sweep_s(index) + delay_s)}.jpg")
    return tmp_path / "zod"


def imported(root: Path, out: Path) -> Drive:
    return read_drive(write_drive(read(Request(root)), FrameChoice(), out).path)


def test_points_lie_where_the_devkit_projects_them(root: Path, tmp_path: Path) -> None:
    drive, folder = imported(root, tmp_path / "drive"), root / "sequences/000002"
    calibration = Calibration.from_json_path(str(folder / "calibration.json"))
    motion = EgoMotion.from_json_path(str(folder / "ego_motion.json"))
    assert (drive.camera.model, drive.camera.width, drive.camera.height) == ("fisheye", 3848, 2168)
    assert (drive.synchronization, len(drive.frames)) == ("stamps", NUM_SWEEPS)
    T = np.array(drive.T_camera_lidar)
    expected_T = np.linalg.inv(calibration.cameras[Camera.FRONT].extrinsics.transform)
    np.testing.assert_allclose(
        T, expected_T @ calibration.lidars[Lidar.VELODYNE].extrinsics.transform, atol=1e-9
    )
    clouds = compensated(drive, read_clouds(drive, None))
    for index, (frame, cloud) in enumerate(zip(drive.frames, clouds, strict=True)):
        sweep = LidarData.from_npy(str(drive.resolve(frame.points)), remove_ego_lidar_returns=False)
        assert frame.points_stamp == pytest.approx(sweep.core_timestamp, abs=1e-6)
        assert frame.image_stamp == pytest.approx(sweep_s(index) + DELAY_S, abs=1e-6)
        assert frame.image.endswith(f"{name_of(sweep_s(index) + DELAY_S)}.jpg")
        moved = motion_compensate_pointwise(
            sweep, motion, calibration.lidars[Lidar.VELODYNE], sweep_s(index) + DELAY_S
        )
        np.testing.assert_allclose(cloud.points, moved.points, atol=TOLERANCE_M)
        pixels, mask = project_lidar_to_image(moved, calibration)
        found = core.project_points(core_camera(drive.camera), moved.points.astype(np.float32), T).pixels
        is_inside = np.isfinite(found[mask]).all(axis=1)  # semcal leaves out what is beside the image
        assert is_inside.sum() > 100
        np.testing.assert_allclose(found[mask][is_inside], pixels[is_inside, :2], atol=TOLERANCE_PX)


def test_the_command_imports_a_sequence(root: Path, tmp_path: Path) -> None:
    """As installed: the entry point is found."""
    command = [
        sys.executable,
        "-m",
        "semcal_cli",
        "import",
        "zod",
        str(root),
        "--sequence",
        "sequences/000002",
    ]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "drive")], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert f"wrote {tmp_path / 'drive/drive.yaml'}: {NUM_SWEEPS} frames" in done.stderr


def test_sweeps_without_poses_are_left_out(root: Path) -> None:
    """A pose is needed 0.1 s before and after each sweep."""
    path = root / "sequences/000002/ego_motion.json"
    motion = json.loads(path.read_text())
    for count, num_frames in ((32, 1), (42, 2)):
        path.write_text(json.dumps(motion | {key: motion[key][:count] for key in ("poses", "timestamps")}))
        recording = read(Request(root))
        assert len(recording.frames) == num_frames
        assert f"left out {NUM_SWEEPS - num_frames} frames without poses around them" in recording.remarks
    path.write_text(json.dumps(motion | {"poses": [], "timestamps": []}))
    with pytest.raises(
        InputError, match=r"ego_motion\.json: found no poses before and after the sweep and the image"
    ):
        read(Request(root))


@pytest.mark.parametrize(
    ("file", "keys", "value", "said"),
    [
        (
            "calibration.json",
            ("FC", "lidar_extrinsics"),
            [[1.0]],
            "FC.lidar_extrinsics[0]: found a list of 1, needed 4",
        ),
        ("calibration.json", ("FC", "extrinsics"), 3, "FC.extrinsics: found 3, expected rows of numbers"),
        (
            "calibration.json",
            ("FC", "distortion"),
            [0.1],
            "FC.distortion: found a list of 1, needed 4 numbers",
        ),
        (
            "calibration.json",
            ("FC", "image_dimensions"),
            [0, 1],
            "FC.image_dimensions: found 0.0, expected a whole",
        ),
        ("calibration.json", ("FC",), None, "FC: found nothing, expected a value"),
        (
            "ego_motion.json",
            ("poses",),
            [],
            "poses: found a list of 0, needed 90 poses, one for each of the timesta",
        ),
        ("ego_motion.json", ("timestamps",), ["now"], "timestamps: found 'now', expected a number"),
    ],
)
def test_wrong_values_are_named(
    root: Path, file: str, keys: tuple[str, ...], value: object, said: str
) -> None:
    path = root / "sequences/000002" / file
    document = json.loads(path.read_text())
    place = document
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    path.write_text(json.dumps(document))
    with pytest.raises(InputError) as error:
        read(Request(root))
    assert str(error.value).startswith(f"{path}: {said}")


@pytest.mark.parametrize("asked", ["camera", "sequence"])
def test_unknown_names_are_named(root: Path, asked: str) -> None:
    with pytest.raises(InputError, match=f"{asked}: found 'roof', expected"):
        read(Request(root, **{asked: "roof"}))


def test_images_of_another_time_or_none_are_refused(root: Path) -> None:
    folder = root / "sequences/000002/camera_front_blur"
    for image in folder.iterdir():
        image.rename(folder / image.name.replace("2022", "2023"))
    with pytest.raises(
        InputError, match=r"000002: found no sweep with an image of front_blur within 0\.05 s"
    ):
        read(Request(root))
    (folder / "1.jpg").write_bytes(b"")
    with pytest.raises(
        InputError, match="expected sweeps and images of front_blur, all with a time in their names"
    ):
        read(Request(root))
