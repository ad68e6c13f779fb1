"""Calibrations of one rig that scatter as they say, and to which something happened."""

import json
from pathlib import Path

import numpy as np
from conftest import make_pose

from semcal_cli.fleet.fleet_drives import FleetDrive
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import pose_at

TRUTH = make_pose((1.2, -0.3, 0.8), (0.4, -0.2, 0.7))
SIGMAS = np.array([0.004, 0.003, 0.006, *np.radians([0.02, 0.03, 0.01])])


def fleet(
    rng: np.random.Generator, count: int, extra: float = 0.0
) -> tuple[list[Pose], np.ndarray, np.ndarray]:
    """Calibrations that scatter as they say, and by `extra` times as much again; covariances; coordinates."""
    scales = rng.uniform(0.5, 2.0, count)
    off = rng.standard_normal((count, 6)) * SIGMAS * scales[:, None]
    off += extra * rng.standard_normal((count, 6)) * SIGMAS
    covariances = np.array([np.diag((SIGMAS * scale) ** 2) for scale in scales])
    return [pose_at(TRUTH, coordinates) for coordinates in off], covariances, off


def fleet_drives(poses: list[Pose], covariances: np.ndarray) -> list[FleetDrive]:
    """Drives, one every half a day."""
    return [
        FleetDrive(f"{index:03d}", 1.7e9 + 43_200.0 * index, T, covariance, None)
        for index, (T, covariance) in enumerate(zip(poses, covariances, strict=True))
    ]


def series_of(kind: str, count: int = 24, seed: int = 8) -> list[FleetDrive]:
    """A fleet to which something happened."""
    rng = np.random.default_rng(seed)
    _, covariances, series = fleet(rng, count, 1.0)
    if kind == "change":
        series[15:, [1, 4]] += [0.08, np.radians(0.6)]
    if kind == "drift":
        series[:, 3] += np.radians(np.linspace(0.0, 0.8, count))
    if kind == "outlier":
        series[9, [0, 5]] += [0.2, np.radians(1.0)]
    if kind == "small change":
        series[15:, 4] += np.radians(0.22)
    return fleet_drives([pose_at(TRUTH, coordinates) for coordinates in series], covariances)


def line(fleet_drive: FleetDrive, /, **changes: object) -> dict:
    """A line of a batch's summary."""
    assert fleet_drive.T_camera_lidar is not None
    assert fleet_drive.covariance is not None
    entry = {"drive": f"drives/{fleet_drive.name}", "status": "trusted", "exit_code": 0, "reasons": []}
    entry |= {"stamp": fleet_drive.stamp, "T_camera_lidar": fleet_drive.T_camera_lidar.tolist()}
    entry |= {"covariance": fleet_drive.covariance.tolist(), "mutual_information_nats": 1.5}
    entry |= {"camera": "a", "result": f"{fleet_drive.name}/calibration.yaml"}
    return entry | changes


def write_summary(folder: Path, lines: list[dict]) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "summary.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in lines))
    return folder
