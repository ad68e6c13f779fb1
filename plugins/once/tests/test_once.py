"""A tiny sequence becomes a drive whose points lie where the devkit of ONCE projects them."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from semcal_once.dataset import read

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.importing.recording import Request
from semcal_cli.observations.motion import compensated, displacements
from semcal_cli.observations.reading import read_clouds

SEQUENCE = "000076"
STAMPS_MS = [1_616_343_527_200 + 500 * index for index in range(8)]
WITHOUT_IMAGE, WITHOUT_SWEEP = 3, 5
KEPT = [1, 2, 4, 6]
"""Those with a sweep, an image, and poses before and after them."""
SIZE = (1920, 1020)
AXES = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
"""Axes of a camera that looks forward, as columns, in the LiDAR frame: x left, y back, z up."""
TOLERANCE_PX = 2e-3
"""Points are float32, 4 micrometres at 60 m, and 1,500 pixels are a radian."""
TOLERANCE_M = 5e-5
"""Displacements are float32, too: 0.4 microradians over 100 m."""
UNTIL = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9)
"""When OpenCV stops to undistort points."""


def cam_to_velo(turn: tuple[float, float, float], place: tuple[float, float, float]) -> list[list[float]]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("ZYX", turn, degrees=True).as_matrix() @ AXES, place
    return T.tolist()


CALIB = {
    "cam01": {
        "cam_to_velo": cam_to_velo((1.5, -0.7, 2.0), (0.1, -0.9, -0.3)),
        "cam_intrinsic": [[1520.0, 0.0, 955.0], [0.0, 1518.0, 513.0], [0.0, 0.0, 1.0]],
        "distortion": [-0.32, 0.11, 0.0007, -0.0004, -0.02],
    },
    "cam05": {
        "cam_to_velo": cam_to_velo((118.0, 1.0, -1.0), (0.8, 0.2, -0.4)),
        "cam_intrinsic": [[905.0, 0.0, 961.0], [0.0, 904.0, 508.0], [0.0, 0.0, 1.0]],
        "distortion": [-0.29, 0.08, -0.0003, 0.0006, -0.01],
    },
}


def lidar_pose(index: int) -> np.ndarray:
    """T_world_lidar of a car that drives at 8 m/s and turns at 0.3 rad/s."""
    seconds = 0.5 * index
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("ZYX", (0.3 * seconds, 0.01, -0.02)).as_matrix()
    T[:3, 3] = 12.0 + 8.0 * np.array([np.sin(0.1 * seconds), -seconds, 0.01 * seconds])
    return T


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A sequence of 4 s through a world of points that stand still."""
    folder = tmp_path / f"once/data/{SEQUENCE}"
    for name in ("lidar_roof", *CALIB):
        (folder / name).mkdir(parents=True)
    world = np.random.default_rng(2).uniform((-40.0, -60.0, -3.0), (40.0, 40.0, 8.0), (3000, 3))
    frames = []
    for index, stamp_ms in enumerate(STAMPS_MS):
        T = lidar_pose(index)
        quaternion = Rotation.from_matrix(T[:3, :3]).as_quat()
        # Of frames without annotations the time is a number.
        frame_id = str(stamp_ms) if index % 2 else stamp_ms
        frames.append(
            {"sequence_id": SEQUENCE, "frame_id": frame_id, "pose": [*quaternion, *T[:3, 3].tolist()]}
        )
        points = (world - T[:3, 3]) @ T[:3, :3]
        if index != WITHOUT_SWEEP:
            sweep = np.column_stack([points, np.linspace(0.0, 255.0, len(points))])
            sweep.astype(np.float32).tofile(folder / f"lidar_roof/{stamp_ms}.bin")
        if index != WITHOUT_IMAGE:
            for camera in CALIB:
                Image.new("L", SIZE).save(folder / f"{camera}/{stamp_ms}.jpg")
    document = {"meta_info": {"weather": "sunny"}, "calib": CALIB, "frames": frames}
    (folder / f"{SEQUENCE}.json").write_text(json.dumps(document))
    return tmp_path / "once"


def imported(root: Path, out: Path, **asked: str) -> Drive:
    return read_drive(write_drive(read(Request(root, **asked)), FrameChoice(), out).path)


def devkit_points(root: Path, index: int) -> np.ndarray:
    """As the devkit's load_point_cloud."""
    path = root / f"data/{SEQUENCE}/lidar_roof/{STAMPS_MS[index]}.bin"
    return np.fromfile(path, dtype=np.float32).reshape(-1, 4)


def devkit_pixels(points: np.ndarray, calib: dict[str, list]) -> tuple[np.ndarray, np.ndarray]:
    """As the devkit's project_lidar_to_image: pixels in the undistorted image, and whether points lie in front."""
    homogeneous = np.hstack([points, np.ones((len(points), 1))])
    points_camera = (homogeneous @ np.linalg.inv(calib["cam_to_velo"]).T)[:, :3]
    pixels = points_camera @ np.array(calib["cam_intrinsic"]).T
    return pixels[:, :2] / pixels[:, 2:], points_camera[:, 2] > 0.0


@pytest.mark.parametrize("camera", [*CALIB])
def test_points_lie_where_the_devkit_projects_them(root: Path, tmp_path: Path, camera: str) -> None:
    drive, calib = imported(root, tmp_path / "drive", camera=camera), CALIB[camera]
    K, distortion, T_velo_cam = (
        np.array(calib[key]) for key in ("cam_intrinsic", "distortion", "cam_to_velo")
    )
    assert (drive.camera.model, *drive.camera.size) == ("plumb_bob", *SIZE)
    np.testing.assert_allclose(drive.T_camera_lidar, np.linalg.inv(T_velo_cam), atol=1e-9)
    clouds = read_clouds(drive, None)
    assert len(clouds) == len(KEPT)
    for index, frame, cloud in zip(KEPT, drive.frames, clouds, strict=True):
        points = devkit_points(root, index)[:, :3]
        np.testing.assert_array_equal(cloud.points, points)
        assert frame.image.endswith(f"{SEQUENCE}/{camera}/{STAMPS_MS[index]}.jpg")
        found = core.project_points(core_camera(drive.camera), points, np.array(drive.T_camera_lidar)).pixels
        is_seen = np.isfinite(found).all(axis=1)  # semcal leaves out what is beside the image
        T = np.linalg.inv(T_velo_cam)
        rotation, _ = cv2.Rodrigues(T[:3, :3])
        seen = points[is_seen].astype(np.float64)
        recorded, _ = cv2.projectPoints(seen, rotation, T[:3, 3], K, distortion)
        np.testing.assert_allclose(found[is_seen], recorded[:, 0], atol=TOLERANCE_PX)
        # The devkit projects into the undistorted image.
        undistorted, is_in_front = devkit_pixels(points, calib)
        is_drawn = is_seen & is_in_front & ((undistorted > 0.0) & (undistorted < SIZE)).all(axis=1)
        straight = cv2.undistortPoints(found[is_drawn, None], K, distortion, P=K, criteria=UNTIL)[:, 0]
        np.testing.assert_allclose(straight, undistorted[is_drawn], atol=TOLERANCE_PX)
        assert is_in_front[is_seen].all()
        assert is_drawn.sum() > 100


def test_poses_are_the_motion(root: Path, tmp_path: Path) -> None:
    """Points that stand still come to lie on one another, as the devkit's frame_concat lays them."""
    drive = imported(root, tmp_path / "drive")
    assert (drive.synchronization, drive.motion.point_times) == ("stamps", "relative")
    assert drive.time_offset_sigma_s == pytest.approx(0.1 / 12**0.5)
    for index, frame in zip(KEPT, drive.frames, strict=True):
        assert frame.points_stamp == frame.image_stamp == STAMPS_MS[index] / 1_000
    pairs = [(drive.frames[0], frame) for frame in drive.frames]
    for index, T_first_second in zip(KEPT, displacements(drive, pairs), strict=True):
        points = devkit_points(root, index)[:, :3] @ T_first_second[:3, :3].T + T_first_second[:3, 3]
        np.testing.assert_allclose(points, devkit_points(root, KEPT[0])[:, :3], atol=TOLERANCE_M)
    # The image has the time of the sweep: points stay where they are, and the clock has a velocity to be wrong at.
    for cloud, moved in zip(clouds := read_clouds(drive, None), compensated(drive, clouds), strict=True):
        np.testing.assert_allclose(moved.points, cloud.points, atol=TOLERANCE_M)
        assert np.linalg.norm(moved.twist_per_s[:3]) == pytest.approx(8.0, abs=0.1)


def test_the_command_imports_a_sequence(root: Path, tmp_path: Path) -> None:
    """As installed: the entry point is found."""
    command = [sys.executable, "-m", "semcal_cli", "import", "once", str(root), "--sequence", SEQUENCE]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "drive")], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert f"wrote {tmp_path / 'drive/drive.yaml'}: {len(KEPT)} frames" in done.stderr


def change(root: Path, keys: tuple[str | int, ...], value: object) -> Path:
    """Replace a value of the sequence's document."""
    path = root / f"data/{SEQUENCE}/{SEQUENCE}.json"
    document = json.loads(path.read_text())
    place = document
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    path.write_text(json.dumps(document))
    return path


def test_frames_beside_a_gap_are_left_out(root: Path) -> None:
    """Of frame 2, no pose is known: there is none half a second after frame 1 and before frame 3."""
    change(root, ("frames", 2, "pose"), [0.0] * 7)
    recording = read(Request(root))
    assert [frame.name for frame in recording.frames] == [str(STAMPS_MS[index]) for index in (4, 6)]
    assert "left out 4 frames without poses around them" in recording.remarks


def test_a_sequence_without_poses_has_no_motion(root: Path) -> None:
    for index in range(len(STAMPS_MS)):
        change(root, ("frames", index, "pose"), [0.0] * 7)
    recording = read(Request(root))
    assert (recording.motion, recording.poses) == (None, None)
    assert len(recording.frames) == len(STAMPS_MS) - 2


def test_poses_too_far_apart_are_refused(root: Path) -> None:
    frames = json.loads((root / f"data/{SEQUENCE}/{SEQUENCE}.json").read_text())["frames"]
    path = change(root, ("frames",), frames[::2])
    with pytest.raises(InputError) as error:
        read(Request(root))
    assert str(error.value) == (
        f"{path}: found no poses before and after the sweep and the image of any frame"
    )


POSE = "frames[0].pose"
CAM = "calib.cam01"


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("calib",), [], "calib: found a list of 0, expected a mapping"),
        (("calib", "cam01"), None, f"{CAM}: found nothing, expected a value"),
        (
            ("calib", "cam01", "cam_to_velo"),
            [[1.0] * 4],
            f"{CAM}.cam_to_velo: found a list of 1, needed 4 rows",
        ),
        (("calib", "cam01", "cam_to_velo"), [[1.0]] * 4, f"{CAM}.cam_to_velo[0]: found a list of 1, needed"),
        (("calib", "cam01", "cam_to_velo"), np.diag([2.0, 2.0, 2.0, 1.0]).tolist(), f"{CAM}.cam_to_velo: "),
        (("calib", "cam01", "cam_to_velo", 0, 3), float("inf"), "found Infinity, expected a finite number"),
        (
            ("calib", "cam01", "cam_intrinsic"),
            [[1.0, 0.0]],
            f"{CAM}.cam_intrinsic[0]: found a list of 2, need",
        ),
        (
            ("calib", "cam01", "cam_intrinsic", 0, 0),
            -1.0,
            f"{CAM}.cam_intrinsic: found focal lengths -1.0 and",
        ),
        (
            ("calib", "cam01", "cam_intrinsic", 0, 0),
            "wide",
            f"{CAM}.cam_intrinsic[0][0]: found 'wide', expect",
        ),
        (("calib", "cam01", "distortion"), [0.1] * 8, f"{CAM}.distortion: found 8 coefficients, needed"),
        (("calib", "cam01", "distortion", 0), None, f"{CAM}.distortion[0]: found nothing, expected a n"),
        (("frames",), 3, "frames: found 3, expected a list"),
        (("frames", 0), 3, "frames[0]: found 3, expected a mapping"),
        (("frames", 0, "pose"), [1.0] * 6, f"{POSE}: found a list of 6, needed 7 numbers"),
        (("frames", 0, "pose"), [2.0] + [0.0] * 6, f"{POSE}: found a quaternion of norm 2, needed norm 1"),
        (("frames", 0, "pose", 4), 1e9, f"{POSE}: found a translation of 1e+09, needed at most 1e+08 m"),
        (("frames", 0, "pose", 4), None, f"{POSE}: found nothing, expected a number"),
        (
            ("frames", 0, "frame_id"),
            "first",
            "frames[0].frame_id: found 'first', expected a time in whole mi",
        ),
    ],
)
def test_wrong_values_are_named(root: Path, keys: tuple[str | int, ...], value: object, said: str) -> None:
    path = change(root, keys, value)
    with pytest.raises(InputError) as error:
        read(Request(root))
    assert str(error.value).startswith(f"{path}: {said}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("asked", "where"),
    [("camera", f"data/{SEQUENCE}/{SEQUENCE}.json: calib"), ("sequence", "data")],
)
def test_unknown_names_are_named(root: Path, asked: str, where: str) -> None:
    with pytest.raises(InputError) as error:
        read(Request(root, **{asked: "roof"}))
    assert str(error.value).startswith(f"{root / where}: {asked}: found 'roof', expected ")


@pytest.mark.parametrize(
    "name", ["", f"{SEQUENCE}/{SEQUENCE}.json", f"{SEQUENCE}/lidar_roof", f"{SEQUENCE}/cam01"]
)
def test_missing_files_are_named(root: Path, name: str) -> None:
    path = root / "data" / name
    path.rename(root / "elsewhere")
    with pytest.raises(InputError) as error:
        read(Request(root))
    assert str(error.value).startswith(f"{path}: no such file")


def test_a_camera_without_images_of_the_sweeps_is_refused(root: Path) -> None:
    folder = root / f"data/{SEQUENCE}"
    for image in (folder / "cam01").iterdir():
        image.rename(image.with_stem(f"9{image.stem}"))
    with pytest.raises(InputError) as error:
        read(Request(root))
    assert str(error.value) == f"{folder}: found no sweep with an image of cam01 of its name"


def test_a_file_of_no_time_is_named(root: Path) -> None:
    path = root / f"data/{SEQUENCE}/lidar_roof/{10**15}.bin"
    path.write_bytes(b"")
    with pytest.raises(InputError) as error:
        read(Request(root))
    assert str(error.value).startswith(f"{path}: found 1000000000000.0, needed at least")


def test_a_broken_image_is_named(root: Path) -> None:
    path = root / f"data/{SEQUENCE}/cam01/{STAMPS_MS[0]}.jpg"
    path.write_bytes(b"no image")
    with pytest.raises(InputError) as error:
        read(Request(root))
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)
