"""The whole pipeline: initialize, refine_and_polish, assess, compare_speed, compare_motion and make_calibration.

Cross-validation and repetition with other seeds follow the assessment, on request. `verification`, `many/rig` and the
experiments call the same stages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from semcal_cli.checks.folds_disagree import compare_folds
from semcal_cli.checks.seeds import compare_seeds
from semcal_cli.config import CalibrationConfig
from semcal_cli.errors import CalibrationError, InputError, counted
from semcal_cli.estimation.adjust.priors import Prior
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline.assessment import assess
from semcal_cli.pipeline.conclusion import make_calibration
from semcal_cli.pipeline.cross_validation import estimate_folds, split_scenes
from semcal_cli.pipeline.motion_assessment import compare_motion, compare_speed
from semcal_cli.pipeline.pose_stages import check_options, initialize, is_polished, refine_and_polish
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.calibration_document import CalibrationDocument


def calibrate(
    data: LoadedDrive,
    config: CalibrationConfig | None = None,
    *,
    initial_pose: InitialPose | None = None,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
) -> CalibrationDocument:
    """Calibrate the camera and the LiDAR of a drive.

    Args:
        data: The drive, as `load` returns it with the same settings.
        config: All settings; the defaults if not given.
        initial_pose: Pose to search around or to start from; see `initialize`.
        priors: Known axes of the pose.
        on_event: Called with each event.

    Returns:
        The calibration, without the hashes of its files: `result.provenance.with_provenance` adds them.

    Raises:
        InputError: a setting is out of range, or the drive was loaded by other cues or does not allow a setting.
        CalibrationError: the data give no answer.
    """
    config = CalibrationConfig() if config is None else config
    data = load(data, config)
    check_options(data, config.refinement, priors)
    _check_folds(data, config, priors)
    if initial_pose is not None:
        data = data.along_scans(initial_pose.T_camera_lidar)
    initial = initialize(data, config.initialization, config.seed, initial_pose, priors, on_event)
    candidates = () if initial_pose is None else (initial_pose.T_camera_lidar,)
    stages = refine_and_polish(
        data, initial, config.refinement, config.seed, priors, on_event, candidates=candidates
    )
    stages = assess(data, stages, config.refinement, on_event)
    stages = compare_speed(data, stages)
    stages = compare_motion(data, stages, on_event)
    if config.num_folds > 1:
        stages = cross_validate(data, stages, config, on_event)
    if config.num_seeds > 1:
        stages = repeat(data, stages, config, initial_pose, priors, on_event)
    return make_calibration(data, stages, config, initial_pose=initial_pose)


def repeat(
    data: LoadedDrive,
    stages: Stages,
    config: CalibrationConfig,
    initial_pose: InitialPose | None = None,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
) -> Stages:
    """Calibrate with the next seeds, and compare the poses."""
    start = perf_counter()
    poses: list[Pose | None] = []
    candidates = () if initial_pose is None else (initial_pose.T_camera_lidar,)
    for seed in range(config.seed + 1, config.seed + config.num_seeds):
        on_event(Progress("repeating with other seeds", seed - config.seed - 1, config.num_seeds - 1))
        try:
            initial = stages.searched
            if initial is None or initial.by_motion is None:
                initial = initialize(data, config.initialization, seed, initial_pose, priors)
            rerun = refine_and_polish(data, initial, config.refinement, seed, priors, candidates=candidates)
            poses.append(rerun.T_camera_lidar)
        except CalibrationError:
            poses.append(None)
    motion_covariance = None if stages.assessment is None else stages.assessment.motion_covariance
    repeatability, findings = compare_seeds(
        stages.T_camera_lidar, poses, stages.uncertainty, motion_covariance
    )
    count = len(findings)
    doubts = {0: "the pose is the same", 1: "1 more doubt"}.get(count, f"{count} more doubts")
    note = f"{config.num_seeds} seeds compared, {doubts}"
    on_event(StageDone("repeated", perf_counter() - start, note))
    return replace(stages, repeatability=repeatability, of_comparison=(*stages.of_comparison, *findings))


def cross_validate(
    data: LoadedDrive, stages: Stages, config: CalibrationConfig, on_event: Listener = ignore
) -> Stages:
    """Polish the pose by parts of the drive alone, and compare them with their intervals.

    A pose whose polish was rejected is not at a maximum, and is left as it is.
    """
    if stages.polished is None or stages.is_rejected:
        on_event(StageDone("folds", 0.0, "not done: the polish was rejected"))
        return stages
    start, observations = perf_counter(), stages.seen or data.observations
    on_event(Progress(f"cross-validating {config.num_folds} parts of the drive"))
    parts = split_scenes(observations.scenes, config.num_folds)
    folds = estimate_folds(observations, stages.T_camera_lidar, config.refinement.polish, parts)
    known = [fold for fold in folds if fold.sigmas is not None]
    compared, findings = compare_folds(
        np.array([fold.offsets_from(stages.T_camera_lidar) for fold in known]),
        np.array([fold.sigmas for fold in known]),
        np.array([fold.degrees_of_freedom for fold in known]),
        len(folds) - len(known),
    )
    pulls = "" if compared.pulls is None else f", pulls {' '.join(f'{pull:.2f}' for pull in compared.pulls)}"
    on_event(StageDone("folds", perf_counter() - start, f"{config.num_folds} parts{pulls}"))
    return replace(stages, cross_validation=compared, of_comparison=(*stages.of_comparison, *findings))


def _check_folds(data: LoadedDrive, config: CalibrationConfig, priors: Sequence[Prior]) -> None:
    """Check that a drive can be divided, and that its parts alone give poses like that of the whole."""
    if config.num_folds < 2:
        return
    if (
        priors
        or not config.refinement.jointly.is_empty
        or not is_polished(data.observations, config.refinement)
    ):
        raise InputError(
            "num_folds: found features, priors, intrinsics or a delay to estimate, or no polish; parts of a drive need "
            "the polish by exact mutual information alone"
        )
    if (num_scenes := len(set(data.observations.scenes))) < config.num_folds:
        raise InputError(
            f"{data.drive.path}: --cross-validate: found {counted(num_scenes, 'scene')}, needed at least "
            f"{config.num_folds}, one for each part, of the frames that are used"
        )
