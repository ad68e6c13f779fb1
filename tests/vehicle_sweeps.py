"""Sweeps and poses of a LiDAR with a known pose on its vehicle, over flat ground between walls and boxes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from semcal_cli.drive.camera import Camera

CAMERA = Camera.model_validate(
    {
        "model": "plumb_bob",
        "width": 64,
        "height": 48,
        "K": ((50.0, 0.0, 31.5), (0.0, 50.0, 23.5), (0.0, 0.0, 1.0)),
    }
)
CHANNELS, COLUMNS = 32, 500
UP_DEG, DOWN_DEG = 25.0, -25.0
WALL_M = 4.0
"""Height of the walls."""
NOISE_M = 0.02
MAX_RANGE_M = 60.0
NUM_BOXES = 8


def pose(rpy_deg: Sequence[float], place_m: Sequence[float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    T[:3, 3] = place_m
    return T


def sweeps(
    rng: np.random.Generator,
    T_base_lidar: np.ndarray,
    count: int,
    lean_deg: float = 0.0,
    bounce_m: float = 0.0,
) -> list[np.ndarray]:
    """Measure sweeps (N, 3) at different places, where the vehicle leans and bounces on its springs."""
    leans = [
        pose((*rng.normal(0.0, lean_deg, 2), 0.0), (0.0, 0.0, rng.normal(0.0, bounce_m)))
        for _ in range(count)
    ]
    return [_sweep(rng, lean @ T_base_lidar) for lean in leans]


def _sweep(rng: np.random.Generator, T_ground_lidar: np.ndarray) -> np.ndarray:
    elevations = np.radians(np.linspace(DOWN_DEG, UP_DEG, CHANNELS))
    azimuths = np.linspace(-math.pi, math.pi, COLUMNS, endpoint=False)
    azimuth, elevation = (axis.ravel() for axis in np.meshgrid(azimuths, elevations))
    flat = np.cos(elevation)
    rays = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    along, start = rays @ T_ground_lidar[:3, :3].T, T_ground_lidar[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = np.where(along[:, 2] < 0.0, -start[2] / along[:, 2], np.inf)
        for wall in (rng.uniform(8.0, 25.0), rng.uniform(-25.0, -8.0)):
            to_wall = (wall - start[1]) / along[:, 1]
            is_below_top = start[2] + to_wall * along[:, 2] < WALL_M
            ranges = np.where((to_wall > 0.0) & (to_wall < ranges) & is_below_top, to_wall, ranges)
        for middle in rng.uniform(-25.0, 25.0, (NUM_BOXES, 2)):
            if np.hypot(*middle) < 5.0:
                continue
            side, height = rng.uniform(0.5, 3.0, 2), rng.uniform(0.3, 3.0)
            ends = [
                (np.array(end) - start) / along
                for end in ((*(middle - side), 0.0), (*(middle + side), height))
            ]
            into, out = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
            ranges = np.where((into < out) & (into > 0.0) & (into < ranges), into, ranges)
    is_hit = ranges < MAX_RANGE_M
    measured = (ranges + rng.normal(0.0, NOISE_M, len(ranges)))[is_hit, None] * rays[is_hit]
    return measured.astype(np.float32)


def driven(
    rng: np.random.Generator,
    T_base_lidar: np.ndarray,
    seconds: float,
    speed_m_s: float = 8.0,
    max_turn_deg_s: float = 3.0,
    noise_deg: float = 0.05,
    noise_m: float = 0.01,
) -> tuple[list[float], list[np.ndarray]]:
    """Drive a bicycle, whose axle behind stands over the base, and return times and poses of its LiDAR, 10 each second.

    A negative speed drives backward. The curvature of the path wanders.
    """
    step_s, T_world_base, turn = 0.1, pose((0.0, 0.0, 40.0), (5.0, -3.0, 0.2)), 0.0
    stamps, poses = list[float](), list[np.ndarray]()
    for index in range(round(seconds / step_s)):
        off = pose(rng.normal(0.0, noise_deg, 3), rng.normal(0.0, noise_m, 3))
        stamps.append(100.0 + step_s * index)
        poses.append(T_world_base @ T_base_lidar @ off)
        turn = 0.95 * turn + 0.3 * rng.normal(0.0, max_turn_deg_s)
        half = pose((0.0, 0.0, 0.5 * step_s * turn), (0.0, 0.0, 0.0))
        T_world_base = T_world_base @ half @ pose((0.0, 0.0, 0.0), (step_s * speed_m_s, 0.0, 0.0)) @ half
    return stamps, poses
