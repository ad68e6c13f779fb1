"""The plane of the ground under the vehicle, in each sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.errors import CalibrationError
from semcal_cli.geometry.arrays import Matrix, Numbers, Vector, Vectors

NEAR_M = 1.0
"""Nearer returns may be the vehicle's own."""
REACH = 8.0
MIN_REACH_M, MAX_REACH_M = 5.0, 15.0
"""Ground within this many heights of the sensor counts, within limits: farther on, roads slope and bend."""
NEAR_PLANE_M = 0.4
"""Largest distance of the ground under the vehicle from that of all frames."""
CELL_M = 0.5
"""Side of the cells that each count as one point, at the median height of their returns."""
MAX_CELLS = 1000
"""More cells than are in a row."""
MIN_SCALE_M = 0.003
"""Smallest standard deviation of the heights of cells."""
TUKEY = 4.685
"""Distance in standard deviations beyond which Tukey's biweight is zero."""
NUM_ROUNDS = 20
MIN_CELLS = 40
MIN_SPREAD_M = 0.7
"""Smallest standard deviation of the cells along the ground, in any direction: a narrow strip has no tilt across."""
MIN_SHARE_ON = 0.4
"""Smallest share of cells near the plane that lie on it."""
MAX_TILT_DEG = 6.0
"""Largest angle between the ground of one frame and that of all."""


class Ground(NamedTuple):
    """The plane of the ground in one sweep."""

    up: Vector
    """(3,) unit vector away from the ground, LiDAR frame."""
    height_m: float
    """Distance of the origin of the LiDAR frame from the ground, metres."""


def find_ground(sweeps: Sequence[npt.NDArray[np.float32]]) -> list[Ground | None]:
    """Find the ground under the vehicle in each sweep (N, 3), metres, LiDAR frame, for any mounting of the LiDAR.

    The plane with nearly all returns on one side, over all sweeps together, is the start in each (see
    `rust/segmentation/up.rs`).

    Returns:
        The ground of each sweep; None where too little of it is seen.

    Raises:
        CalibrationError: no plane has nearly all returns on one side.
    """
    start = core.estimate_up(sweeps)
    if start is None:
        raise CalibrationError(
            "found no ground in the sweeps, expected a plane that nearly all returns are above"
        )
    first = Ground(np.asarray(start.direction), start.height_m)
    return [_fit(points, first) for points in sweeps]


def level_axes(up: Vector) -> Matrix:
    """Compute R_level_lidar (3, 3), whose third row is `up`: R = Ry(pitch) Rx(roll), with no yaw (REP 103)."""
    x, y, z = up.tolist()
    cos_pitch = float(np.hypot(y, z))
    if cos_pitch < 1e-6:  # The LiDAR's x axis is vertical: roll is taken as zero.
        y, z, cos_pitch = 0.0, 1e-6, 1e-6
    sin_roll, cos_roll = y / cos_pitch, z / cos_pitch
    return np.array(
        [
            [cos_pitch, -x * sin_roll, -x * cos_roll],
            [0.0, cos_roll, -sin_roll],
            [x, cos_pitch * sin_roll, cos_pitch * cos_roll],
        ]
    )


def _fit(points: npt.NDArray[np.float32], start: Ground) -> Ground | None:
    """Fit z = a x + b y + c to cells of the ground by Tukey's biweight, in axes whose z is that of `start`."""
    R_start_lidar = level_axes(start.up)
    cells = _cells(points.astype(np.float64) @ R_start_lidar.T, start.height_m)
    if len(cells) < MIN_CELLS or np.linalg.eigvalsh(np.cov(cells[:, :2].T))[0] < MIN_SPREAD_M**2:
        return None
    A = np.column_stack([cells[:, :2], np.ones(len(cells))])
    plane, weights = np.array([0.0, 0.0, -start.height_m]), np.ones(len(cells))
    for _ in range(NUM_ROUNDS):
        off = cells[:, 2] - A @ plane
        scale = max(1.4826 * float(np.median(np.abs(off))), MIN_SCALE_M)
        weights = np.square(np.clip(1.0 - np.square(off / (TUKEY * scale)), 0.0, None))
        root = np.sqrt(weights)
        plane = np.linalg.lstsq(root[:, None] * A, root * cells[:, 2])[0]
    normal = np.array([-plane[0], -plane[1], 1.0])
    length = float(np.linalg.norm(normal))
    tilt_deg = float(np.degrees(np.arccos(1.0 / length)))
    if np.mean(weights > 0.0) < MIN_SHARE_ON or tilt_deg > MAX_TILT_DEG:
        return None
    return Ground(R_start_lidar.T @ (normal / length), -float(plane[2]) / length)


def _cells(points: Vectors, height_m: float) -> Vectors:
    """Take one point (M, 3) of each cell of the ground near the sensor: its centre of mass, at its median height."""
    reach_m = float(np.clip(REACH * height_m, MIN_REACH_M, MAX_REACH_M))
    distances: Numbers = np.hypot(points[:, 0], points[:, 1])
    is_near = (distances > NEAR_M) & (distances < reach_m) & (np.abs(points[:, 2] + height_m) < NEAR_PLANE_M)
    near = points[is_near]
    column, row = np.floor(near[:, :2].T / CELL_M).astype(np.int64)
    _, cell = np.unique(column * MAX_CELLS + row, return_inverse=True)
    order = np.lexsort((near[:, 2], cell))
    counts = np.bincount(cell)
    starts, heights_m = np.cumsum(counts) - counts, near[order, 2]
    medians_m = 0.5 * (heights_m[starts + (counts - 1) // 2] + heights_m[starts + counts // 2])
    means = [np.bincount(cell, near[:, axis]) / counts for axis in (0, 1)]
    return np.column_stack([*means, medians_m])
