"""`semcal base`: the LiDAR on its vehicle, on sweeps and motions with a known truth."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import invoke
from vehicle_sweeps import CAMERA, driven, pose, sweeps

from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.estimation.vehicle.ground import find_ground, level_axes
from semcal_cli.estimation.vehicle.mounting_on_base import VehicleMounting, estimate_mounting
from semcal_cli.estimation.vehicle.scatter import independent_share, trimmed_mean
from semcal_cli.estimation.vehicle.travel import yaw_from_poses, yaw_from_twist
from semcal_cli.formats import read_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.poses import quaternion_xyzw, rpy

FLAT_DEG, FLAT_M = 0.1, 0.01  # 2 cm of noise on each return, 500 returns on each ring
MIN_INSIDE = 0.85  # of 72 axes, 95 % intervals hold all but 8 with a probability of 0.98
MOUNTINGS = {
    "upright": (1.5, -2.0, 0.0),
    "turned": (-0.7, 1.2, 90.0),
    "tilted forward": (2.0, 25.0, 10.0),
    "upside down": (178.5, 2.0, -35.0),
    "backward": (0.5, 0.3, 179.0),
}


def errors(mounting: VehicleMounting, T_base_lidar: np.ndarray) -> list[tuple[float, float | None]]:
    """List the errors of roll, pitch and height with the half widths of their intervals."""
    roll, pitch, _ = rpy(T_base_lidar)
    return [
        (math.remainder(mounting.roll_rad.value - roll, 2.0 * math.pi), mounting.roll_rad.half_width_95),
        (mounting.pitch_rad.value - pitch, mounting.pitch_rad.half_width_95),
        (mounting.height_m.value - float(T_base_lidar[2, 3]), mounting.height_m.half_width_95),
    ]


def made(points: list[np.ndarray]) -> Drive:
    return Drive.from_arrays(camera=CAMERA, points=points)


@pytest.mark.parametrize("name", MOUNTINGS)
def test_flat_ground_shows_roll_pitch_and_height(name: str, rng: np.random.Generator) -> None:
    T_base_lidar = pose(MOUNTINGS[name], (0.0, 0.0, 1.73))
    mounting = estimate_mounting(made(sweeps(rng, T_base_lidar, 4)))
    (roll, _), (pitch, _), (height_m, _) = errors(mounting, T_base_lidar)
    assert max(abs(math.degrees(roll)), abs(math.degrees(pitch))) < FLAT_DEG
    assert abs(height_m) < FLAT_M
    assert mounting.num_frames == 4
    T = mounting.T_base_lidar(math.radians(MOUNTINGS[name][2]), 0.0, 0.0)
    np.testing.assert_allclose(T, T_base_lidar, atol=FLAT_M)


def test_intervals_hold_the_truth_where_the_vehicle_leans() -> None:
    inside = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        angles = (*rng.uniform(-12.0, 12.0, 2), rng.uniform(-180.0, 180.0))
        T_base_lidar = pose(angles, (0.0, 0.0, rng.uniform(0.8, 2.2)))
        mounting = estimate_mounting(made(sweeps(rng, T_base_lidar, int(rng.integers(4, 12)), 0.4, 0.01)))
        inside += [width is not None and abs(off) <= width for off, width in errors(mounting, T_base_lidar)]
    assert np.mean(inside) >= MIN_INSIDE


def test_sweeps_of_one_place_count_once(rng: np.random.Generator) -> None:
    T_base_lidar = pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.7))
    points = sweeps(rng, T_base_lidar, 2)
    copies = [one + rng.normal(0.0, 0.01, one.shape).astype(np.float32) for one in points for _ in range(3)]
    mounting = estimate_mounting(made(copies))
    assert (mounting.num_frames, mounting.num_scenes) == (6, 2)
    alone = estimate_mounting(made(copies[:3]))
    assert alone.num_scenes == 1
    assert alone.height_m.half_width_95 is None


def test_a_drive_without_ground_is_refused(rng: np.random.Generator) -> None:
    ball = rng.normal(size=(5000, 3))
    ball = 5.0 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    with pytest.raises(CalibrationError, match="arrays: found no ground in the sweeps"):
        estimate_mounting(made([ball.astype(np.float32)]))
    seen = sweeps(rng, pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.7)), 1)[0]
    strip = seen[(np.abs(seen[:, 1]) < 0.5) & (seen[:, 0] > 0.0)]
    with pytest.raises(CalibrationError, match=r"arrays: found (too little|no) ground"):
        estimate_mounting(made([strip]))
    walls = [seen if index == 1 else ball.astype(np.float32) for index in range(4)]
    with pytest.raises(CalibrationError, match=r"arrays: found (no ground|ground in only 1 of 4 sweeps)"):
        estimate_mounting(made(walls))
    with pytest.raises(
        CalibrationError, match=r"m above the ground, needed .*: clouds must be in the LiDAR's own frame"
    ):
        estimate_mounting(made([seen + np.float32([0.0, 0.0, 1.72])]))


def test_ground_that_one_frame_does_not_show_is_left_out(rng: np.random.Generator) -> None:
    points = sweeps(rng, pose((1.0, 0.0, 0.0), (0.0, 0.0, 1.7)), 3)
    above = points[1][points[1][:, 2] > -1.0]
    assert [ground is None for ground in find_ground([points[0], above, points[2]])] == [False, True, False]


@pytest.mark.parametrize("name", MOUNTINGS)
def test_level_axes_are_those_of_urdf(name: str) -> None:
    T = pose((*MOUNTINGS[name][:2], 0.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(level_axes(T[2, :3]), T[:3, :3], atol=1e-12)
    R = level_axes(np.array([1.0, 0.0, 0.0]))  # the x axis is vertical
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-5)


@pytest.mark.parametrize("speed_m_s", [8.0, -8.0])
def test_straight_driving_shows_yaw(speed_m_s: float) -> None:
    inside = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        angles = (180.0 * (seed % 2) + 3.0, -4.0, rng.uniform(-180.0, 180.0))
        T_base_lidar = pose(angles, (rng.uniform(-1.0, 3.0), rng.uniform(-0.5, 0.5), 1.7))
        stamps, poses = driven(rng, T_base_lidar, 30.0, speed_m_s)
        travel = yaw_from_poses(stamps, poses, level_axes(T_base_lidar[2, :3]))
        backward = (
            math.pi if speed_m_s < 0.0 else 0.0
        )  # a vehicle that only drives backward is taken as turned
        off = math.remainder(travel.yaw_rad.value - math.radians(angles[2]) - backward, 2.0 * math.pi)
        assert travel.yaw_rad.half_width_95 is not None
        assert travel.yaw_rad.half_width_95 < math.radians(0.3)
        inside.append(abs(off) <= travel.yaw_rad.half_width_95)
    assert np.mean(inside) >= MIN_INSIDE


def test_a_part_that_is_driven_backward_counts(rng: np.random.Generator) -> None:
    T_base_lidar = pose((0.0, 0.0, 30.0), (1.5, 0.0, 1.7))
    R_level_lidar = level_axes(T_base_lidar[2, :3])
    stamps, poses = driven(rng, T_base_lidar, 20.0)
    _, backward = driven(rng, T_base_lidar, 10.0, speed_m_s=-8.0)
    T_between = poses[-1] @ np.linalg.inv(backward[0])
    poses = [*poses, *(T_between @ one for one in backward[1:])]
    stamps = [0.1 * index for index in range(len(poses))]
    travel = yaw_from_poses(stamps, poses, R_level_lidar)
    assert abs(math.degrees(travel.yaw_rad.value) - 30.0) < FLAT_DEG
    assert 0.2 < travel.share_backward < 0.5


def test_a_vehicle_that_turns_or_stands_shows_no_yaw(rng: np.random.Generator) -> None:
    T_base_lidar = pose((0.0, 0.0, 0.0), (1.0, 0.0, 1.7))
    for motion in ({"speed_m_s": 0.05}, {"speed_m_s": 2.0, "max_turn_deg_s": 300.0}):
        with pytest.raises(
            CalibrationError, match="of nearly straight driving in the motion, needed 5 of 2 m each"
        ):
            yaw_from_poses(*driven(rng, T_base_lidar, 4.0, **motion), np.eye(3))
    for linear in ((0.1, 0.0, 0.0), (3.0, 0.0, 0.0)):
        with pytest.raises(CalibrationError, match=r"found a twist of .* needed nearly straight driving"):
            yaw_from_twist(linear, (0.0, 0.0, 0.3), np.eye(3), None)


def test_a_motion_out_of_the_ground_shows_no_yaw(rng: np.random.Generator) -> None:
    motion = driven(rng, pose((0.0, 0.0, 0.0), (1.0, 0.0, 1.7)), 10.0)
    with pytest.raises(
        CalibrationError, match=r"found a motion that leads (89|90) degrees out of the ground"
    ):
        yaw_from_poses(*motion, level_axes(np.array([1.0, 0.0, 0.0])))


def test_a_twist_shows_yaw_as_well_as_it_is_known() -> None:
    twist = (0.0, -10.0, 0.0), (0.0, 0.0, 0.0)
    assert yaw_from_twist(*twist, np.eye(3), None).yaw_rad == (pytest.approx(0.5 * math.pi), None)
    assert yaw_from_twist(*twist, np.eye(3), 0.1).yaw_rad.half_width_95 == pytest.approx(0.0196)


@pytest.mark.parametrize(("n", "spread"), [(3, 1.0), (8, 1.0), (30, 2.0)])
def test_intervals_of_a_trimmed_mean_hold_it(n: int, spread: float, rng: np.random.Generator) -> None:
    means = [trimmed_mean(5.0 + spread * rng.standard_t(5.0, n)) for _ in range(1000)]
    inside = np.mean([abs(mean.value - 5.0) <= (mean.half_width_95 or 0.0) for mean in means])
    assert 0.93 < inside < 0.985
    assert trimmed_mean(np.array([2.0])) == (2.0, None)


def test_neighbours_that_are_alike_count_as_fewer(rng: np.random.Generator) -> None:
    steps = rng.normal(size=400)
    wander = np.convolve(steps, 0.8 ** np.arange(40), "valid")
    assert independent_share(steps) > 0.8
    assert 0.05 < independent_share(wander) < 0.25  # (1 - 0.8) / (1 + 0.8) = 0.11


@pytest.fixture
def vehicle(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, np.ndarray]:
    """Write a drive of a LiDAR 1.2 m ahead of base_link and turned by 20 degrees, with its poses."""
    T_base_lidar = pose((1.0, -2.0, 20.0), (1.2, 0.1, 1.6))
    root = tmp_path / "drive"
    root.mkdir()
    frames = []
    for index, points in enumerate(sweeps(rng, T_base_lidar, 5, 0.2, 0.005)):
        np.save(root / f"{index}.npy", points)
        frames.append({"points": f"{index}.npy"})
    lines = [
        " ".join(map(repr, [stamp, *T[:3, 3].tolist(), *quaternion_xyzw(T).tolist()]))
        for stamp, T in zip(*driven(rng, T_base_lidar, 20.0), strict=True)
    ]
    (root / "poses.txt").write_text("\n".join(lines))
    document: dict[str, Any] = {
        "semcal_drive": 1,
        "camera": CAMERA.model_dump(mode="json", exclude_unset=True),
        "frames": frames,
        "frame_ids": {"lidar": "os_sensor", "camera": "front_optical"},
        "motion": {"poses": "poses.txt"},
        "T_camera_lidar": np.linalg.inv(pose((-90.0, 0.0, -90.0), (0.2, 0.0, -0.1))).tolist(),
    }
    (root / "drive.yaml").write_text(yaml.dump(document))
    return root, T_base_lidar


def test_the_result_is_what_convert_takes(vehicle: tuple[Path, np.ndarray], tmp_path: Path) -> None:
    (root, T_base_lidar), base, out = vehicle, tmp_path / "base.yaml", tmp_path / "tf.yaml"
    done = invoke("base", root, "--xy-m", 1.2, 0.1, "-o", base)
    assert done.exit_code == 0, done.output
    lines = done.stderr.splitlines()
    assert lines[0].startswith("ground     in 5 frames of ")
    assert lines[-1] == (f"next: semcal convert calibration.yaml --to urdf --base {base} -o camera.urdf")
    assert "x, y       1.2, 0.1 m, as you state" in lines
    document = yaml.safe_load(base.read_text())
    T = np.array(document["T_base_lidar"])
    np.testing.assert_allclose(T, T_base_lidar, atol=0.02)
    assert abs(document["rpy_deg"][2] - 20.0) < document["half_width_95"]["yaw_deg"]
    assert document["lidar_frame"] == "os_sensor"
    assert document["yaw_from"] == "motion"
    done = invoke("convert", root, "--to", "tf2", "--base", base, "-o", out)
    assert done.exit_code == 0, done.output
    assert "base_link to front_optical: " in done.stderr
    T_camera_lidar = read_transform(root) @ np.linalg.inv(T)
    again = read_transform(out, None, FormatOptions(lidar="base_link"))
    np.testing.assert_allclose(again, T_camera_lidar, atol=1e-8)


def test_yaw_that_nothing_shows_is_the_users(vehicle: tuple[Path, np.ndarray], tmp_path: Path) -> None:
    root, _ = vehicle
    document = yaml.safe_load((root / "drive.yaml").read_text())
    del document["motion"]
    (root / "drive.yaml").write_text(yaml.dump(document))
    done = invoke("base", root, "-o", tmp_path / "base.yaml")
    assert "yaw        not known: the drive states no motion" in done.stderr
    assert str(done.exception) == (
        f"{root / 'drive.yaml'}: yaw is not known, because the drive states no motion; add --yaw-deg with that of the "
        "LiDAR's x axis, such as 0 if it points forward"
    )
    assert not (tmp_path / "base.yaml").exists()
    done = invoke("base", root, "--yaw-deg", 20)
    assert done.exit_code == 0, done.output
    document = yaml.safe_load(done.stdout)
    assert document["rpy_deg"][2] == pytest.approx(20.0)
    assert document["yaw_from"] == "option"
    assert "yaw_deg" not in document["half_width_95"]


def test_wrong_options_of_base_are_named(vehicle: tuple[Path, np.ndarray]) -> None:
    root, _ = vehicle
    done = invoke("base", root, "--xy-m", "nan", 0)
    assert done.exit_code == 2
    done = invoke("base", root, "--xy-m", 1e9, 0)
    assert isinstance(done.exception, InputError)
    assert "--xy-m: T_base_lidar: found a translation of 1e+09" in str(done.exception)
