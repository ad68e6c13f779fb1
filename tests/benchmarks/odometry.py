"""Prints Markdown tables: the motion that sweeps tell by KISS-ICP, and what calibrations gain by it.

    python tests/benchmarks/odometry.py [--seeds 3] [--kitti DIR]

A rig drives three seconds along a synthetic street, at 30 twisted sweeps; the way is that from the first to the last
sweep. Drives are calibrated from nothing with the true motion, with that of the sweeps, and without any: median errors
of the rotation and of the camera centre. `--kitti` is a folder of KITTI raw, whose sweeps are set beside its inertial
poses (oxts) over all frames that are there, ten a second. Needs the extra `odometry`.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmark import script, table
from moving_street import NUM_SWEEPS, SWEEP_S, MovingStreet

from semcal_cli.datasets.odometry import NS, Odometry, drive_motion, tum_text
from semcal_cli.drive.document import Drive, Motion, read_drive
from semcal_cli.drive.loading import load
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.geometry.poses import Pose, compare_poses, inverse, rotation_error_deg
from semcal_cli.pipeline import calibrate

STREETS = {5.0: 0.3, 10.0: -0.2, 15.0: 0.15}
"""Turns by speeds, radians and metres a second."""
EARTH_M = 6378137.0
T_LIDAR_IMU = np.array(
    [
        [0.9999976, 7.553071e-4, -2.035826e-3, -0.8086759],
        [-7.854027e-4, 0.9998898, -1.482298e-2, 0.3195559],
        [2.024406e-3, 1.482454e-2, 0.9998881, -0.7997231],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""KITTI's calib_imu_to_velo.txt of 2011-09-26."""


def error(drive: Drive, poses: str | None, truth: Pose) -> tuple[float, float]:
    """Calibrate with a file of poses, or without motion; degrees and centimetres."""
    motion = None if poses is None else Motion(poses=poses)
    found = compare_poses(calibrate(load(drive.model_copy(update={"motion": motion}))).pose, truth)
    return found.rotation_deg, found.camera_center_cm


def row(speed_m_s: float, seeds: range, points: int, width: int) -> tuple[str, ...]:
    ways, turns, errors = [], [], {name: list[tuple[float, float]]() for name in ("true", "estimated", "not")}
    for seed in seeds:
        street = MovingStreet(speed_m_s, STREETS[speed_m_s], seed, points, width)
        with tempfile.TemporaryDirectory() as name:
            drive = read_drive(street.write(Path(name) / "drive"))
            poses = drive_motion(drive).poses
            drive.resolve("estimated.txt").write_text(tum_text(poses))
            for motion, found in errors.items():
                file = None if motion == "not" else f"{motion}.txt"
                found.append(error(drive, file, street.T_camera_lidar))
        way, turn = street.errors(dict(list(poses.items())[1:-1]))
        ways.append(way / (speed_m_s * SWEEP_S * (NUM_SWEEPS - 1)))
        turns.append(turn)
    cells = (
        ", ".join(f"{median(each):.3f}" for each in zip(*found, strict=True)) for found in errors.values()
    )
    return f"{speed_m_s:g} m/s", f"{median(ways):.2%}", f"{median(turns):.2f}", *cells


def kitti_row(folder: Path) -> tuple[str, ...]:
    odometry, truth, scale = Odometry(), list[Pose](), 0.0
    for number, cloud in enumerate(sorted(folder.glob("velodyne_points/data/*.bin"))):
        (read,) = read_point_clouds([(cloud, None)])
        odometry.add(read.points, None, (number + 1) * NS // 10)
        lat, lon, alt, roll, pitch, yaw = np.loadtxt(folder / f"oxts/data/{cloud.stem}.txt")[:6]
        scale = scale or float(np.cos(np.radians(lat)))  # Mercator, as in KITTI's development kit.
        north = np.log(np.tan(np.pi * (90.0 + lat) / 360.0))
        T = np.eye(4)
        turns = ((yaw, 2), (pitch, 1), (roll, 0))
        T[:3, :3] = np.linalg.multi_dot([_turn(angle, axis) for angle, axis in turns])
        T[:3, 3] = scale * EARTH_M * np.radians(lon), scale * EARTH_M * north, alt
        truth.append(T @ inverse(T_LIDAR_IMU))
    poses = list(odometry.poses().values())[1:-1]
    found, true = (inverse(each[0]) @ each[-1] for each in (poses, truth))
    off_cm = 100.0 * np.linalg.norm(found[:3, 3] - true[:3, 3])
    way_m = np.linalg.norm(true[:3, 3])
    return folder.name, f"{way_m:.2f}", f"{off_cm:.1f}", f"{rotation_error_deg(found, true):.2f}"


def _turn(angle: float, axis: int) -> np.ndarray:
    """Rotation (3, 3) about an axis."""
    a, b = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(3)
    R[a, a] = R[b, b] = np.cos(angle)
    R[a, b], R[b, a] = -np.sin(angle), np.sin(angle)
    return R


def main(
    *, seeds: int = 3, first_seed: int = 300, points: int = 40_000, width: int = 640, kitti: str = ""
) -> Iterator[str]:
    """Print the tables, that of KITTI if its folder is given."""
    header = "speed | error of the way | error of the turn, deg | true motion: deg, cm | motion of the sweeps | none"
    yield from table(
        header, (row(speed, range(first_seed, first_seed + seeds), points, width) for speed in STREETS)
    )
    if kitti:
        folders = sorted(path.parent for path in Path(kitti).glob("*/*_sync/oxts"))
        yield ""
        yield from table("KITTI raw | way, m | error, cm | error, deg", map(kitti_row, folders))


if __name__ == "__main__":
    script(main)
