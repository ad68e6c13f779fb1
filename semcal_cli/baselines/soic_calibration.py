"""Calibration by SOIC, for comparison; it gives no uncertainty of the pose."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from time import perf_counter

from semcal_cli import _core
from semcal_cli.assessment.pose_checks import check_distance, check_motion, check_shutter
from semcal_cli.baselines.config import SoicConfig
from semcal_cli.baselines.soic import Soic
from semcal_cli.checks.convergence import SOIC
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import make_calibration
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.stage import StageResult
from semcal_cli.stages import Stages


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
    start = perf_counter()
    soic = Soic(data.observations, SoicConfig())
    initial = _initialize(data, soic, initial_pose, config.refinement.max_baseline_m, start, on_event)
    refined = _minimize(data, soic, initial.T_camera_lidar, on_event)
    of_shutter, notes = check_shutter(data.drive, data.observations, is_compensated=False)
    return make_calibration(
        data,
        Stages(
            initial,
            refined,
            of_data=(*check_motion(data.observations.motion_error_px), *of_shutter),
            notes_on_data=notes,
            of_comparison=check_distance(refined.T_camera_lidar, config.refinement.max_baseline_m),
        ),
        config,
        initial_pose=initial_pose,
        relative_to=relative_to,
        hashes=hashes,
    )


def _initialize(
    data: LoadedDrive,
    soic: Soic,
    initial_pose: InitialPose | None,
    max_baseline_m: float,
    start: float,
    on_event: Listener,
) -> StageResult:
    if initial_pose is None:
        on_event(Progress("trying semantic centroids"))
    T = soic.initialize(max_baseline_m) if initial_pose is None else initial_pose.T_camera_lidar
    found = StageResult(
        T_camera_lidar=T,
        agreement=_core.agreement(data.observations.core, T),
        settings={"soic": asdict(soic.config)},
    )
    origin = "semantic centroids" if initial_pose is None else initial_pose.name
    details = f"from {origin}, {soic.cost(T):.2f} px"
    note = "started at semantic centroids" if initial_pose is None else "started at the given transform"
    on_event(StageDone("initial", perf_counter() - start, note, found.agreement, details=details))
    return found


def _minimize(data: LoadedDrive, soic: Soic, T_init: Pose, on_event: Listener) -> StageResult:
    start = perf_counter()
    on_event(Progress("moving points to their classes"))
    settled = soic.minimize(T_init)
    T = settled.T_camera_lidar
    unsettled = SOIC.finding(f"SOIC had not settled after {soic.config.max_restarts} restarts")
    found = StageResult(
        T_camera_lidar=T,
        agreement=_core.agreement(data.observations.core, T),
        findings=() if settled.converged else (unsettled,),
    )
    note = "" if settled.converged else "still moving at the end"
    details = f"soic, {settled.cost_px:.2f} px after {settled.num_evaluations} evaluations"
    moved = compare_poses(T, T_init)
    on_event(StageDone("refined", perf_counter() - start, note, found.agreement, moved, details))
    return found
