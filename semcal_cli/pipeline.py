"""The stages of a calibration: load, initialize, refine, polish, estimate_jointly, fuse, assess, make_calibration.

Each stage is a function of data and settings. It returns a frozen result with its own quality and findings, and reports
its progress to a listener. `calibrate` runs all stages; `verification`, `rig` and the experiments call the same
functions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from semcal_cli import _core, stage_words
from semcal_cli.assessment.assess import assess as assess_pose
from semcal_cli.assessment.assess import assess_rejected
from semcal_cli.assessment.clock_error import covariance_of_clock
from semcal_cli.assessment.fusion import Fused
from semcal_cli.assessment.fusion import fuse as fuse_pose
from semcal_cli.assessment.guide import check_guide
from semcal_cli.assessment.joint import Joint
from semcal_cli.assessment.joint import estimate_jointly as estimate
from semcal_cli.assessment.joint_checks import check_beside_pose, is_polished
from semcal_cli.assessment.pose_checks import check_motion, check_shutter
from semcal_cli.assessment.priors import Prior, clamp
from semcal_cli.assessment.remedies import advise
from semcal_cli.assessment.repeatability import compare_seeds
from semcal_cli.assessment.rivals import sigmas_behind
from semcal_cli.checks.mounting import OTHER_POSE
from semcal_cli.config import (
    FAR_DEG,
    CalibrationConfig,
    ExactConfig,
    InitializationConfig,
    PolishConfig,
    PyramidConfig,
    RefinementConfig,
)
from semcal_cli.drive.cues import files_of
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.shutter import can_be_unrolled
from semcal_cli.errors import CalibrationError, InputError, about
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.initialization.search import Initialization, as_given, is_rival, led_by
from semcal_cli.initialization.search import initialize as search
from semcal_cli.refinement.estimators import make_estimator
from semcal_cli.refinement.polish import Polish, newton
from semcal_cli.refinement.polish import polish as polish_pose
from semcal_cli.refinement.pyramid import Level, Refinement
from semcal_cli.refinement.pyramid import refine as refine_pose
from semcal_cli.refinement.several_starts import SeveralStarts, pyramid_of
from semcal_cli.result.assembly import assemble
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.provenance import describe_input
from semcal_cli.result.stage import StageResult
from semcal_cli.stages import Stages, findings_of, settings_of

NO_START = (
    "edges tell no mountings apart, needed a start within 5 degrees and 0.3 m without --search-deg, from --init "
    "or --init-rpy-xyz, or labels of the pictures, with --cue segments,edges"
)
"""What is missing where a search is asked for by edges without labels of the pictures."""

INITIAL_DEG, INITIAL_M = 5.0, 0.5
"""Largest error of a hypothesis of the initial calibration, in degrees and metres, when it is compared with priors."""


def calibrate(
    drive: LoadedDrive | Drive | Path | str,
    config: CalibrationConfig | None = None,
    *,
    initial_pose: InitialPose | None = None,
    priors: Sequence[Prior] = (),
    relative_to: Path = Path(),
    on_event: Listener = ignore,
    hashes: dict[str, str] | None = None,
) -> Calibration:
    """Calibrate the camera and the LiDAR of a drive.

    Args:
        drive: A drive, its folder, its drive.yaml, or the result of `load` with the same settings.
        config: All settings; the defaults if not given.
        initial_pose: Pose to search around or to start from; see `initialize`.
        priors: Known axes of the pose.
        relative_to: Folder of the result, which names the drive relative to it.
        on_event: Called with each event.
        hashes: SHA-256 by the real paths of files; missing ones are added.

    Raises:
        InputError: the drive or one of its files is missing or wrong.
        CalibrationError: the data give no answer.
    """
    config = config or CalibrationConfig()
    data = load(drive, config, on_event)
    check_beside_pose(data, config.refinement, priors)
    initial = initialize(data, config.initialization, config.seed, initial_pose, priors, on_event)
    given = () if initial_pose is None else (initial_pose.T_camera_lidar,)
    stages = _refine_and_polish(data, initial, config.refinement, config.seed, priors, on_event, others=given)
    stages = assess(data, stages, config.refinement, on_event)
    if config.num_seeds > 1:
        stages = repeat(data, stages, config, initial_pose, priors, on_event)
    return make_calibration(
        data, stages, config, initial_pose=initial_pose, priors=priors, relative_to=relative_to, hashes=hashes
    )


def initialize(
    data: LoadedDrive,
    config: InitializationConfig,
    seed: int = 0,
    initial_pose: InitialPose | None = None,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
) -> Initialization:
    """Search all mounting directions, or those around an initial pose (Alg. 2).

    Hypotheses that priors rule out are left out, unless priors rule out all. Without `config.search_deg`, an initial
    pose is only improved.

    Raises:
        CalibrationError: sweeps and images do not overlap, or no placement leads to a pose.
        InputError: the points do not lie in the field of view of the drive's `lidar:` block, or a search is asked for
            by edges without labels of the pictures.
    """
    start = perf_counter()
    if initial_pose is None:
        on_event(Progress("searching all mounting directions"))
    else:
        way = "starting at" if config.search_deg is None else "searching around"
        on_event(Progress(f"{way} {initial_pose.name}"))

    def is_possible(T_camera_lidar: Pose) -> bool:
        return all(prior.allows(T_camera_lidar, INITIAL_M, math.radians(INITIAL_DEG)) for prior in priors)

    T_given = None if initial_pose is None else initial_pose.T_camera_lidar
    is_searched = initial_pose is None or config.search_deg is not None
    if is_searched and not data.tells_mountings:
        raise InputError(f"{data.drive.path}: {NO_START}")
    with about(data.drive.path):
        if T_given is not None and not is_searched and data.is_refined_by_edges:
            found = as_given(data.observations, T_given, config)
        else:
            found = search(data.for_search, config, seed, T_given, is_possible)
    on_event(stage_words.initial(found, perf_counter() - start, is_searched=is_searched))
    return found


def start_at(data: LoadedDrive, initial_pose: InitialPose, on_event: Listener = ignore) -> StageResult:
    """Use a given pose as the result of the initial calibration."""
    start, T = perf_counter(), initial_pose.T_camera_lidar
    found = StageResult(T_camera_lidar=T, agreement=_core.agreement(data.observations.core, T))
    on_event(stage_words.started(found, perf_counter() - start, initial_pose.name))
    return found


def refine_and_polish(
    data: LoadedDrive,
    initial: StageResult,
    config: RefinementConfig,
    seed: int = 0,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
    *,
    from_afar: bool = False,
) -> Stages:
    """Refine and polish the initial pose, and fuse it with priors.

    If the shutter rolls, the refined pose tells the line of each point; with points moved to the moments of their lines
    it is refined again, and all later stages see those points.

    Poses from features are not polished, because the polish needs the exact mutual information, which vectors lack.

    Raises:
        InputError: as `refine` and `check_beside_pose`.
        CalibrationError: as `refine`.
    """
    check_beside_pose(data, config, priors)
    return _refine_and_polish(data, initial, config, seed, priors, on_event, from_afar=from_afar)


def _refine_and_polish(
    data: LoadedDrive,
    initial: StageResult,
    config: RefinementConfig,
    seed: int,
    priors: Sequence[Prior],
    on_event: Listener,
    *,
    from_afar: bool = False,
    others: Sequence[Pose] = (),
) -> Stages:
    """Refine and polish by settings that are checked."""
    of_shutter, notes = check_shutter(data.drive, data.observations)
    of_data = (*check_motion(data.observations.motion_error_px), *of_shutter)
    refined = refine(
        data, initial.T_camera_lidar, config, seed, priors, on_event, from_afar=from_afar, others=others
    )
    if data.observations.starts is not None and isinstance(initial, Initialization) and initial.findings:
        initial, refined = _decided_in_full(data, initial, refined, config, seed, priors, on_event)
    seen = None
    if can_be_unrolled(data.observations):
        refined = refine(
            data.unrolled(refined.T_camera_lidar), refined.T_camera_lidar, config, seed, priors, on_event
        )
        data = data.unrolled(refined.T_camera_lidar)
        seen = data.observations
    found = Stages(initial, refined, unrolled=seen, of_data=of_data, notes_on_data=notes)
    if not is_polished(data.observations, config):
        return found
    polished = polish(data, refined.T_camera_lidar, config, on_event)
    found = replace(found, polished=polished)
    if config.jointly.is_asked:
        return replace(found, joint=estimate_jointly(data, polished.T_camera_lidar, config, on_event))
    if priors:
        return replace(found, fused=fuse(data, polished.T_camera_lidar, config, priors, on_event))
    return found


def _decided_in_full(
    data: LoadedDrive,
    initial: Initialization,
    refined: Refinement,
    config: RefinementConfig,
    seed: int,
    priors: Sequence[Prior],
    on_event: Listener,
) -> tuple[Initialization, Refinement]:
    """Decide by what refines poses between mountings that ground and objects alone cannot tell apart.

    The mounting is clear if all others are behind it by enough standard errors. Those that are not once coarse blocks
    are ascended and finished are refined in full, and the best one is taken.
    """
    assert data.observations.starts is not None
    best = taken = initial.hypotheses[0]
    rivals = [
        other for other in initial.hypotheses if is_rival(best, other, InitializationConfig.runner_up_deg)
    ]
    is_clear, exact = bool(rivals), ExactConfig(max_baseline_m=config.max_baseline_m)
    least, polish_config = OTHER_POSE.limit(), _polish_config(config)
    for rival in rivals:
        on_event(Progress(f"comparing a mounting {rival.rotation_from_best_deg:.0f} degrees away"))
        # A mounting in which sweeps and pictures do not overlap is none.
        with suppress(CalibrationError):
            several = SeveralStarts(data.observations, exact, seed, data.observations.starts)
            T_coarse = newton(data.observations, several.coarse_top(rival.pose), polish_config).T_camera_lidar
            if sigmas_behind(data.observations, refined.T_camera_lidar, [T_coarse])[0] >= least:
                continue
            found = refine(data, rival.pose, config, seed, priors)
            (behind,) = sigmas_behind(data.observations, refined.T_camera_lidar, [found.T_camera_lidar])
            if behind < 0.0:
                taken, refined = rival, found
            is_clear &= abs(behind) >= least
    return replace(
        led_by(initial, taken, data.for_search), findings=() if is_clear else initial.findings
    ), refined


def refine(
    data: LoadedDrive,
    T_init: Pose,
    config: RefinementConfig,
    seed: int = 0,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
    *,
    from_afar: bool = False,
    others: Sequence[Pose] = (),
) -> Refinement:
    """Ascend the mutual information from a pose (Alg. 1).

    Args:
        data: The drive, as `load` returns it.
        T_init: (4, 4) pose to start from, metres.
        config: Settings of the refinement.
        seed: Seed of every random choice.
        priors: Known axes, to which the pose is clamped.
        on_event: Called with each event.
        from_afar: Whether the start may be off by 20 degrees.
        others: (4, 4) poses that stay candidates beside the start, where it is refined from several.

    Raises:
        InputError: the exact estimator is asked for with features, or the device does not exist.
        CalibrationError: too few labelled points are on labelled pixels.
    """
    start = perf_counter()
    pyramid = _pyramid(data.observations, from_afar=from_afar)
    estimator, settings = make_estimator(data.observations, config, seed, on_event, others)

    def on_level(level: Level, num_levels: int) -> None:
        moved = compare_poses(level.T_camera_lidar, T_init)
        on_event(Progress(f"refining: {level.factor}-pixel blocks done, {stage_words.movement(moved)}"))

    with about(data.drive.path):
        found = refine_pose(
            data.observations, T_init, estimator, pyramid, on_level, lambda pose: clamp(pose, priors)
        )
    on_event(stage_words.refined(found, perf_counter() - start, T_init, config.estimator))
    return replace(found, settings={"refinement": {**found.settings, **settings}})


def polish(
    data: LoadedDrive, T_refined: Pose, config: RefinementConfig, on_event: Listener = ignore
) -> Polish:
    """Polish a pose that is about one pixel off with Newton's method; held-out data decide whether it is accepted."""
    on_event(Progress("polishing"))
    start = perf_counter()
    found = polish_pose(data.observations, T_refined, _polish_config(config))
    on_event(stage_words.polished(found, perf_counter() - start, T_refined, data.observations.unit))
    return found


def estimate_jointly(
    data: LoadedDrive, T_polished: Pose, config: RefinementConfig, on_event: Listener = ignore
) -> Joint:
    """Estimate intrinsics and the offset of the clock together with the pose; see `semcal_cli.assessment.joint`."""
    on_event(Progress("estimating intrinsics" if config.jointly.intrinsics else "estimating the clock"))
    start = perf_counter()
    settings = config.jointly, _polish_config(config)
    found = estimate(data.observations, T_polished, *settings, data.drive.time_offset_s)
    on_event(stage_words.estimated_jointly(found, perf_counter() - start, T_polished))
    return found


def fuse(
    data: LoadedDrive,
    T_polished: Pose,
    config: RefinementConfig,
    priors: Sequence[Prior],
    on_event: Listener = ignore,
) -> Fused:
    """Fuse the labels' evidence with priors."""
    on_event(Progress("weighing what is known"))
    start = perf_counter()
    found = fuse_pose(
        data.observations,
        T_polished,
        priors,
        edge_band_px=config.edge_band_px,
        of_clock=covariance_of_clock(data.drive, T_polished),
    )
    on_event(stage_words.fused(found, perf_counter() - start, T_polished, priors))
    return found


def assess(
    data: LoadedDrive,
    stages: Stages,
    config: RefinementConfig,
    on_event: Listener = ignore,
    *,
    with_label_bleed: bool = True,
    with_remedies: bool = True,
) -> Stages:
    """Estimate the uncertainty of a polished or fused pose and look for findings.

    Where intrinsics or clocks look wrong, they are estimated once, unless `with_remedies` is false.

    A pose whose polish was rejected has no uncertainty, and is checked otherwise. One that was not polished stays as it
    is.
    """
    if stages.fused is None and stages.polished is None:
        return stages
    on_event(Progress("assessing"))
    start = perf_counter()
    T_camera_lidar, agreement = stages.T_camera_lidar, list(stages.poses.values())[-1].agreement
    joint = stages.joint if stages.is_joint else None
    data = replace(data, observations=stages.seen or data.observations)
    is_rejected = stages.polished is not None and not stages.polished.is_accepted
    polish_config = _polish_config(config)
    if stages.fused is None and joint is None and is_rejected:
        found = assess_rejected(data, T_camera_lidar, agreement)
    else:
        found = assess_pose(
            data,
            T_camera_lidar,
            agreement,
            polish_config,
            stages.fused,
            stages.joint,
            with_label_bleed=with_label_bleed and {*data.cues} <= {"labels", "segments"},
        )
    if data.guide is not None and data.is_refined_by_edges:
        found = found.with_measured(check_guide(data.guide, T_camera_lidar, stages.initial.T_camera_lidar))
    if with_remedies:
        findings = advise(
            found.findings,
            data.observations,
            T_camera_lidar,
            polish_config,
            done=config.jointly,
            with_priors=stages.fused is not None,
            time_offset_s=data.drive.time_offset_s,
        )
        found = replace(found, findings=findings)
    stages = replace(stages, assessment=found)
    on_event(stage_words.assessed(findings_of(stages, config), perf_counter() - start))
    return stages


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
    others: list[Pose | None] = []
    given = () if initial_pose is None else (initial_pose.T_camera_lidar,)
    for seed in range(config.seed + 1, config.seed + config.num_seeds):
        on_event(Progress(f"repeating with seed {seed}"))
        try:
            initial = initialize(data, config.initialization, seed, initial_pose, priors)
            found = _refine_and_polish(data, initial, config.refinement, seed, priors, ignore, others=given)
            others.append(found.T_camera_lidar)
        except CalibrationError:
            others.append(None)
    label_gain = None if stages.fused is None else stages.fused.label_gain
    of_clock = covariance_of_clock(data.drive, stages.T_camera_lidar, label_gain)
    repeatability, findings = compare_seeds(stages.T_camera_lidar, others, stages.uncertainty, of_clock)
    on_event(stage_words.repeated(config.num_seeds, findings, perf_counter() - start))
    return replace(stages, repeatability=repeatability, of_comparison=findings)


def make_calibration(
    data: LoadedDrive,
    stages: Stages,
    config: CalibrationConfig,
    *,
    initial_pose: InitialPose | None = None,
    priors: Sequence[Prior] = (),
    relative_to: Path = Path(),
    hashes: dict[str, str] | None = None,
) -> Calibration:
    """Check the last pose and make the calibration; arguments are those of `calibrate`."""
    poses, initial = stages.poses, stages.initial
    searched = initial if isinstance(initial, Initialization) else None
    source = None if initial_pose is None else initial_pose.source
    return assemble(
        poses,
        findings_of(stages, config.refinement),
        settings=settings_of(data, stages, config, initial_pose, priors),
        seed=config.seed,
        num_frames=len(data.drive.frames),
        input=describe_input(data.drive, source, relative_to, files_of(data.cues), hashes),
        is_assessed=stages.assessment is not None,
        notes=stages.notes,
        parts=stages.parts,
        hypotheses=searched.hypotheses if searched else (),
        runner_up_margin=searched.runner_up_margin if searched else None,
        held_out=stages.polished.held_out if stages.polished else None,
        uncertainty=stages.uncertainty,
        repeatability=stages.repeatability,
        camera=stages.joint.camera if stages.joint else None,
        clock=stages.joint.clock if stages.joint else None,
    )


def _pyramid(observations: Observations, *, from_afar: bool) -> PyramidConfig:
    if observations.starts is not None:
        return pyramid_of(observations.starts)
    return PyramidConfig(coarsest_block_deg=FAR_DEG) if from_afar else PyramidConfig()


def _polish_config(config: RefinementConfig) -> PolishConfig:
    return PolishConfig(max_baseline_m=config.max_baseline_m, edge_band_px=config.edge_band_px)
