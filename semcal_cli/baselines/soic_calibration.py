"""Calibration by SOIC, for comparison; it gives no uncertainty of the pose."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path

from semcal_cli import _core
from semcal_cli.assessment.pose_checks import check_distance
from semcal_cli.baselines.config import SoicConfig
from semcal_cli.baselines.result import calibration_of
from semcal_cli.baselines.soic import Soic
from semcal_cli.checks.convergence import SOIC
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.initialization.search import GIVEN
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.stage import StageResult, announced


def calibrate_by_soic(
    data: LoadedDrive,
    config: CalibrationConfig,
    *,
    initial_pose: InitialPose | None = None,
    relative_to: Path = Path(),
    on_event: Listener = ignore,
    hashes: dict[str, str] | None = None,
) -> Calibration:
    """Calibrate with SOIC; arguments and errors are those of `pipeline.calibrate`.

    The semantic centroids put the camera no farther from the LiDAR than `config.refinement.max_baseline_m`. An initial
    pose replaces them. A result whose camera is farther away is not trusted.
    """
    on_event(Progress("computing distances to classes"))
    observations, max_baseline_m = data.observations, config.refinement.max_baseline_m
    soic = Soic(observations, SoicConfig())
    doing = "trying semantic centroids" if initial_pose is None else f"starting at {initial_pose.name}"
    start = partial(_start, observations, soic, initial_pose, max_baseline_m)
    initial = announced("initial", doing, start, on_event)
    T_init = initial.T_camera_lidar
    minimize = partial(_minimize, observations, soic, T_init)
    refined = announced("refined", "moving points to their classes", minimize, on_event, T_init)
    return calibration_of(
        data,
        config,
        initial,
        refined,
        check_distance(refined.T_camera_lidar, max_baseline_m),
        initial_pose=initial_pose,
        relative_to=relative_to,
        hashes=hashes,
    )


def _start(
    observations: Observations, soic: Soic, initial_pose: InitialPose | None, max_baseline_m: float
) -> StageResult:
    """Start at semantic centroids, or at a given pose."""
    T = soic.initialize(max_baseline_m) if initial_pose is None else initial_pose.T_camera_lidar
    origin = "semantic centroids" if initial_pose is None else initial_pose.name
    return StageResult(
        T_camera_lidar=T,
        agreement=_core.agreement(observations.core, T),
        settings={"soic": asdict(soic.config)},
        note="started at semantic centroids" if initial_pose is None else GIVEN,
        details=f"from {origin}, {soic.cost(T):.2f} px",
    )


def _minimize(observations: Observations, soic: Soic, T_init: Pose) -> StageResult:
    """Minimise the cost from a pose (4, 4)."""
    found = soic.minimize(T_init)
    unsettled = SOIC.finding(f"SOIC had not settled after {soic.config.max_restarts} restarts")
    return StageResult(
        T_camera_lidar=found.T_camera_lidar,
        agreement=_core.agreement(observations.core, found.T_camera_lidar),
        findings=() if found.converged else (unsettled,),
        note="" if found.converged else "still moving at the end",
        details=f"soic, {found.cost_px:.2f} px after {found.num_evaluations} evaluations",
    )
