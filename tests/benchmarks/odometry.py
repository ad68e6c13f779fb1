"""Prints Markdown tables: how well sweeps tell the motion by KISS-ICP.

    python tests/benchmarks/odometry.py [--seeds 3] [--kitti DIR]

A rig drives three seconds along a synthetic street, at 30 twisted sweeps; the way is that from the first to the last
sweep. Velocities are those in the middles of the sweeps: the error of a frame, and its mean over a drive, which all
frames share (root mean squares over the axes). In a jam, lorries that move along hide a share of what the LiDAR sees.
`--kitti` is a folder of KITTI raw, whose sweeps are set beside its inertial poses (oxts) over all frames that are
there, ten a second. Needs the extra `odometry`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmark import script, table
from moving_street import NUM_SWEEPS, SWEEP_S, MovingStreet, stamp_s

from semcal_cli import core
from semcal_cli.config.nanoseconds import NS
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, rotation_error_deg
from semcal_cli.importing.kitti_motion import T_LIDAR_IMU
from semcal_cli.importing.sweep_odometry import Odometry, twist_from

STREETS = ((5.0, 0.3, 0.0), (10.0, -0.2, 0.0), (15.0, 0.15, 0.0), (10.0, 0.2, 0.3))
"""Speeds and turns, metres and radians a second, and the share by which both rise and fall."""
NUM_LORRIES, LORRY_M, LORRY_TOP_M = 6, 4.0, 2.0
"""Lorries around the rig, their distance, and their height above the LiDAR."""
EARTH_M = 6378137.0


def estimated(street: MovingStreet, hidden: float = 0.0) -> dict[int, Pose]:
    """Poses by the sweeps, without those before and after."""
    odometry = Odometry()
    for index in range(NUM_SWEEPS):
        sweep = street.sweep(index)
        points = in_jam(sweep.points, hidden) if hidden else sweep.points
        odometry.add(points, sweep.times_s, round(stamp_s(index) * NS))
    return dict(list(odometry.poses().items())[1:-1])


def row(speed_m_s: float, turn_rad_s: float, change: float, seeds: range, points: int) -> tuple[str, ...]:
    ways, turns, errors = [], [], []
    for seed in seeds:
        street = MovingStreet(speed_m_s, turn_rad_s, seed, points, width=16, change=change)
        poses = estimated(street)
        way, turn = street.errors(poses)
        ways.append(way / (speed_m_s * SWEEP_S * (NUM_SWEEPS - 1)))
        turns.append(turn)
        found = core.Trajectory.through([stamp / NS for stamp in poses], list(poses.values()))
        middles_s = [stamp_s(index) + 0.5 * SWEEP_S for index in range(1, NUM_SWEEPS - 1)]
        errors.append([np.subtract(found.twist_at(each), _true_twist(street, each)) for each in middles_s])
    of_frames = np.array(errors)
    common = of_frames.mean(axis=1)
    cells = (
        f"{_rms(of_frames[..., axes]):.{digits}f}, {_rms(common[..., axes]):.{digits}f}"
        for axes, digits in ((slice(3), 3), (slice(3, 6), 4))
    )
    name = f"{speed_m_s:g} m/s"
    if change:
        name = f"{speed_m_s * (1.0 - change):g} to {speed_m_s * (1.0 + change):g} m/s"
    return name, f"{median(ways):.2%}", f"{median(turns):.2f}", *cells


def _true_twist(street: MovingStreet, time_s: float) -> list[float]:
    return twist_from(street.pose(time_s - 0.005), street.pose(time_s + 0.005), 0.01)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def in_jam(points: np.ndarray, hidden: float) -> np.ndarray:
    """Hide a share of the azimuths behind the flat sides of lorries that stay where they are beside the LiDAR."""
    azimuths, level_m = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
    parts = azimuths / (2.0 * np.pi) * NUM_LORRIES
    middles = (np.floor(parts) + 0.5 * hidden) * 2.0 * np.pi / NUM_LORRIES
    sides_m = LORRY_M / np.cos(azimuths - middles)
    nearer = sides_m / level_m
    is_hidden = (parts % 1.0 < hidden) & (nearer < 1.0) & (points[:, 2] * nearer < LORRY_TOP_M)
    return np.where(is_hidden[:, None], points * nearer[:, None], points).astype(np.float32)


def jam_row(hidden: float, seeds: range, points: int) -> tuple[str, ...]:
    speeds = []
    for speed_m_s in (1.0, 3.0):
        found = []
        for seed in seeds:
            poses = estimated(MovingStreet(speed_m_s, 0.0, seed, points, width=16), hidden)
            ends = list(poses.items())[:: max(len(poses) - 1, 1)]
            if len(ends) == 2:
                (start_ns, start), (end_ns, end) = ends
                way_m = np.linalg.norm((inverse(start) @ end)[:3, 3])
                found.append(float(way_m) * NS / (end_ns - start_ns))
        speeds.append(f"{median(found):.2f}" if found else "none")
    return f"{hidden:.0%}", *speeds


def kitti_poses(folder: Path) -> tuple[dict[int, Pose], list[Pose]]:
    """Poses of the LiDAR in a KITTI raw drive: of its sweeps by nanoseconds, one more at each end, and of its oxts."""
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
    return odometry.poses(), truth


def kitti_row(folder: Path) -> tuple[str, ...]:
    found_by, truth = kitti_poses(folder)
    poses = list(found_by.values())[1:-1]
    found, true = (inverse(each[0]) @ each[-1] for each in (poses, truth))
    off_cm = 100.0 * np.linalg.norm(found[:3, 3] - true[:3, 3])
    way_m = np.linalg.norm(true[:3, 3])
    turn_deg, seconds = rotation_error_deg(found, true), 0.1 * (len(truth) - 1)
    axes = seconds * np.sqrt(3.0)
    rates = f"{0.01 * off_cm / axes:.3f}, {np.radians(turn_deg) / axes:.4f}"
    return folder.name, f"{way_m:.2f}", f"{off_cm:.1f}", f"{turn_deg:.2f}", rates


def _turn(angle: float, axis: int) -> np.ndarray:
    """Rotation (3, 3) about an axis."""
    a, b = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(3)
    R[a, a] = R[b, b] = np.cos(angle)
    R[a, b], R[b, a] = -np.sin(angle), np.sin(angle)
    return R


def main(*, seeds: int = 3, first_seed: int = 300, points: int = 40_000, kitti: str = "") -> Iterator[str]:
    """Print the tables, that of KITTI if its folder is given."""
    of_seeds = range(first_seed, first_seed + seeds)
    header = "speed | error of the way | error of the turn, deg | of a frame, of a drive: m/s | rad/s"
    yield from table(header, (row(*street, of_seeds, points) for street in STREETS))
    yield ""
    header = "hidden by lorries in a jam | found of 1 m/s | of 3 m/s"
    yield from table(header, (jam_row(hidden, of_seeds, points) for hidden in (0.5, 0.7, 0.85)))
    if kitti:
        folders = sorted(path.parent for path in Path(kitti).glob("*/*_sync/oxts"))
        yield ""
        header = "KITTI raw | way, m | error, cm | error, deg | of an axis: m/s, rad/s"
        yield from table(header, map(kitti_row, folders))


if __name__ == "__main__":
    script(main)
