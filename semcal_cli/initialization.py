"""The initial calibration, from nothing (Alg. 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from semcal_cli import _core
from semcal_cli.errors import CalibrationError
from semcal_cli.observations import Observations
from semcal_cli.pnp import PnpConfig, solve_pnp
from semcal_cli.poses import Pose

Grid: TypeAlias = tuple[int, int, float, float]
"""Rows, columns, elevation of the upper border and height of a cell of a spherical image; radians."""


@dataclass(frozen=True)
class InitializationConfig:
    """How the mounting direction is searched for."""

    zoom: str = "exact"
    """How the label image is brought to the angular grid: `exact`, through K and the lens, or as the `paper` does."""
    grid_cell_deg: float = 0.4
    """Cell of the spherical image where the drive has no `lidar:` block."""
    coarse_cell_deg: float = 2.0
    """Cell of the exhaustive search."""
    fine_cell_deg: float = 0.8
    """Cell of Powell's refinement."""
    max_roll_deg: float = 15.0
    """In-plane rotations from minus this to plus this are searched."""
    roll_step_deg: float = 5.0
    min_overlap: float = 0.1
    """A placement counts only with this share of the best overlapping one's cells."""
    num_hypotheses: int = 8
    separation_deg: float = 15.0
    """Smallest rotation between two hypotheses."""
    num_correspondences: int = 2000
    pnp: PnpConfig = field(default_factory=PnpConfig)


@dataclass(frozen=True)
class Hypothesis:
    """A pose that the camera may have."""

    T_camera_lidar: Pose
    mutual_information_nats: float
    """Of the projected points in full resolution, all frames."""
    overlap: float
    """Share of the picture's area that visible points cover."""
    num_cells: int
    """Cells of the spherical images that overlapped the pictures in the registration."""
    num_inliers: int
    """Pairs that PnP agreed on."""


def initialize(observations: Observations, config: InitializationConfig, seed: int) -> list[Hypothesis]:
    """Search all mounting directions.

    Registers the label images with the spherical images, solves PnP for each of the best placements, and ranks the
    poses by the exact mutual information in full resolution, so that a wrong peak among coarse cells is caught.

    The registration turns the picture and moves it nowhere, so with the exact zoom its pairs hold a pure rotation, and
    PnP returns just that; the paper's zoom is no rotation, and there PnP finds the pose that fits best.

    Returns:
        Hypotheses, best first.

    Raises:
        CalibrationError: sweeps and pictures do not overlap, or no placement leads to a pose.
    """
    grid = _grid(observations, config)
    found: list[Hypothesis] = []
    complaint = "no placement of the picture"
    for placement in _register(observations, grid, config):
        points, pixels = _core.sample_correspondences(
            observations.core, grid, config.zoom, placement, config.num_correspondences, seed
        )
        try:
            T_camera_lidar, num_inliers = solve_pnp(points, pixels, observations.camera, config.pnp)
        except CalibrationError as error:
            complaint = str(error)
            continue
        agreement = _core.agreement(observations.core, T_camera_lidar)
        found.append(
            Hypothesis(
                T_camera_lidar=T_camera_lidar,
                mutual_information_nats=agreement.mutual_information - agreement.bias,
                overlap=agreement.overlap,
                num_cells=placement.num_cells,
                num_inliers=num_inliers,
            )
        )
    if not found:
        raise CalibrationError(f"no initial calibration: {complaint}")
    return sorted(found, key=lambda hypothesis: -hypothesis.mutual_information_nats)


def _grid(observations: Observations, config: InitializationConfig) -> Grid:
    lidar = observations.lidar
    if lidar is None:
        return _core.estimate_grid(observations.core, float(np.radians(config.grid_cell_deg)))
    fov_up, fov_down = np.radians([lidar.fov_up_deg, lidar.fov_down_deg]).tolist()
    return _core.scan_grid(lidar.channels, lidar.columns, fov_up, fov_down)


def _register(
    observations: Observations, grid: Grid, config: InitializationConfig
) -> Sequence[_core.Hypothesis]:
    return _core.register(
        observations.core,
        grid,
        zoom=config.zoom,
        coarse_cell=float(np.radians(config.coarse_cell_deg)),
        fine_cell=float(np.radians(config.fine_cell_deg)),
        max_roll=float(np.radians(config.max_roll_deg)),
        roll_step=float(np.radians(config.roll_step_deg)),
        min_overlap=config.min_overlap,
        num_hypotheses=config.num_hypotheses,
        separation=float(np.radians(config.separation_deg)),
    )
