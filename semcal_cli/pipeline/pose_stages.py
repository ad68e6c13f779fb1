"""The stages that estimate a pose: initialize, refine, deskew_sweeps, polish, estimate_jointly and fuse.

Each stage is a function of data and settings. It returns a frozen result with its own quality, and reports its progress
to a listener. `refine_and_polish` runs all of them but the first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from semcal_cli import core
from semcal_cli.checks.other_mounting import check_mountings, describe_mountings
from semcal_cli.config import (
    FAR_DEG,
    InitializationConfig,
    PyramidConfig,
    RefinementConfig,
)
from semcal_cli.drive.camera import check_intrinsic_names
from semcal_cli.errors import InputError, name_in_errors
from semcal_cli.estimation.adjust.clock import ClockUncertainty
from semcal_cli.estimation.adjust.deskewed import Deskewed, deskew
from semcal_cli.estimation.adjust.joint import JointEstimate, fit_jointly
from semcal_cli.estimation.adjust.joint_fit import SpeedErrors
from semcal_cli.estimation.adjust.priors import Fused, Prior, clamp, fuse_with_priors
from semcal_cli.estimation.refine.estimators import make_estimator
from semcal_cli.estimation.refine.higher_maxima import has_other_maxima
from semcal_cli.estimation.refine.polish import Polish, polish_pose
from semcal_cli.estimation.refine.pyramid import Refinement, refine_pose
from semcal_cli.estimation.refine.several_starts import pyramid_of
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.search.mounting_search import GIVEN, Initialization, search_mountings, unsearched
from semcal_cli.estimation.search.start_by_motion import start_by_motion, what_finds_mountings
from semcal_cli.estimation.stage import StageResult, announced
from semcal_cli.estimation.uncertainty.motion_error import covariance_of_motion
from semcal_cli.estimation.uncertainty.sensitivity import sum_of
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.motion import twists_per_s
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.skew import Skew
from semcal_cli.pipeline.mountings import resolve_mountings
from semcal_cli.pipeline.stages import Stages

INITIAL_DEG, INITIAL_M = 5.0, 0.5
"""Error that a hypothesis of the initial calibration may have when it is compared with priors, degrees and metres."""


def initialize(
    data: LoadedDrive,
    config: InitializationConfig,
    seed: int = 0,
    initial_pose: InitialPose | None = None,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
) -> Initialization:
    """Search all mounting directions, or those around an initial pose (Alg. 2).

    Edges alone cannot distinguish mountings: without an initial pose, they start from the motion of camera and LiDAR.
    Hypotheses that priors rule out are dropped, unless priors rule out all of them. Without `config.search_deg`, an
    initial pose is only improved.

    Raises:
        CalibrationError: sweeps and images do not overlap, or no placement leads to a pose.
        NoStartError: a start is needed, and motion gives none.
        InputError: the points do not lie in the field of view of the drive's `lidar:` block, or a search by edges is
            requested without image labels.
    """
    if initial_pose is None and not data.policy.can_find_mounting:
        start = partial(
            start_by_motion, data.observations, data.recorded or data.drive, config, data.policy.near_only
        )
        return announced("initial", "comparing the motion of camera and LiDAR", start, on_event)
    T_start = None if initial_pose is None else initial_pose.T_camera_lidar
    is_searched = T_start is None or config.search_deg is not None
    if is_searched and not data.policy.can_find_mounting:
        cues = " and ".join(data.policy.near_only)
        raise InputError(
            f"{data.drive.path}: found a search by {cues}, which cannot find the mounting; leave out --search-deg "
            f"(`search_deg`), or add {what_finds_mountings(data.drive)}"
        )

    def is_possible(T_camera_lidar: Pose) -> bool:
        return all(prior.allows(T_camera_lidar, INITIAL_M, math.radians(INITIAL_DEG)) for prior in priors)

    search = partial(search_mountings, data.searched_by, config, seed, T_start, is_possible)
    if T_start is not None and not is_searched and data.policy.needs_near_start:
        search = partial(unsearched, data.observations, T_start, config)
    doing = "searching all mounting directions"
    if initial_pose is not None:
        doing = f"{'searching around' if is_searched else 'starting at'} {initial_pose.name}"
    with name_in_errors(data.drive.path):
        return announced("initial", doing, lambda: _described(search()), on_event)


def _described(search: Initialization) -> Initialization:
    """Describe in a note what a search compared, unless its pose was given."""
    return search if search.note else replace(search, note=describe_mountings(search))


def start_at(data: LoadedDrive, initial_pose: InitialPose, on_event: Listener = ignore) -> StageResult:
    """Use a given pose as the result of the initial calibration."""
    T, name = initial_pose.T_camera_lidar, initial_pose.name

    def start() -> StageResult:
        agreement = core.agreement(data.observations.core, T)
        return StageResult(T_camera_lidar=T, agreement=agreement, note=GIVEN, details=f"from {name}")

    return announced("initial", f"starting at {name}", start, on_event)


def refine_and_polish(
    data: LoadedDrive,
    initial: StageResult,
    config: RefinementConfig,
    seed: int = 0,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
    *,
    from_afar: bool = False,
    candidates: Sequence[Pose] = (),
) -> Stages:
    """Refine and polish the initial pose, then fuse it with priors, or estimate intrinsics and the clock with it.

    Image gradients are taken along the scan lines, as the initial pose projects them. With a rolling shutter, the
    refined pose gives the image row of each point. The points are moved to the moments of their rows and the pose is
    refined again; all later stages use those gradients and points.

    Poses from features are not polished: the polish needs the exact mutual information, which features do not have.

    `initial` is the result of `initialize` or `start_at`; the other arguments are those of `refine`.

    Raises:
        InputError: as `refine`; there are priors without a polish; or intrinsics or the clock are to be estimated, but
            the lens lacks one of these intrinsics, the drive has no motion for the offset of the clock, or priors,
            features or a missing polish exclude the estimate.
        CalibrationError: as `refine`.
    """
    check_options(data, config, priors)
    given, data = data, data.along_scans(initial.T_camera_lidar)
    refine_from = partial(refine, config=config, seed=seed, priors=priors)
    T_initial = initial.T_camera_lidar
    refined = refine_from(data, T_initial, on_event=on_event, from_afar=from_afar, candidates=candidates)
    of_search = check_mountings(initial) if isinstance(initial, Initialization) else ()
    if data.observations.is_multimodal and isinstance(initial, Initialization) and of_search:
        initial, refined, is_clear = resolve_mountings(
            data, initial, refined, partial(refine_from, data), seed, on_event
        )
        of_search = () if is_clear else of_search
        along = data.along_scans(refined.T_camera_lidar)
        if along is not data:
            data, refined = along, refine_from(along, refined.T_camera_lidar, on_event=on_event)
    unrolled = data.unrolled(refined.T_camera_lidar)
    if unrolled is not data:
        refined = refine_from(unrolled, refined.T_camera_lidar, on_event=on_event)
        # A point may lie on another row at the new pose.
        unrolled = data.unrolled(refined.T_camera_lidar)
    stages = Stages.from_refined(
        data,
        initial,
        refined,
        is_compensated=True,
        of_search=of_search,
    )
    stages = replace(stages, seen_refined=None if unrolled is given else unrolled.observations)
    if not is_polished(data.observations, config):
        return stages
    unrolled, stages = deskew_sweeps(
        unrolled,
        stages,
        on_event,
        seed,
        with_priors=bool(priors),
        intrinsics=config.jointly.intrinsics,
    )
    return _finish(unrolled, stages, config, priors, on_event)


def deskew_sweeps(
    data: LoadedDrive,
    stages: Stages,
    on_event: Listener = ignore,
    seed: int = 0,
    *,
    with_priors: bool = False,
    intrinsics: Sequence[str] = (),
) -> tuple[LoadedDrive, Stages]:
    """Deskew sweeps by the speed that they show at the last pose, if the LiDAR turns and the drive gives no motion.

    Where other maxima are beside the pose, the highest at each speed is searched for, unless priors hold the pose or
    the speed is found together with the principal point: an error of it looks like a speed, so that is done where it is
    among the `intrinsics` to estimate.
    """
    T, observations = stages.T_camera_lidar, data.observations
    if (skew := Skew.of(data.drive, T)) is None:
        return data, stages
    rng, with_center = np.random.default_rng(seed), skew.center in intrinsics

    def estimate() -> Deskewed:
        if with_priors or with_center:
            has_others = False
        elif stages.refined is not None:
            has_others = stages.refined.levels[-1].has_other_maxima
        else:
            has_others = has_other_maxima(observations, observations.starts, T, rng)
        return deskew(observations, skew, T, rng if has_others else None, with_center=with_center)

    deskewed = announced("deskewed", "estimating the speed", estimate, on_event, T)
    return replace(data, observations=deskewed.observations), replace(stages, deskewed=deskewed)


def _finish(
    data: LoadedDrive, stages: Stages, config: RefinementConfig, priors: Sequence[Prior], on_event: Listener
) -> Stages:
    """Polish a pose, then estimate intrinsics and the clock with it, or fuse it with priors, if requested."""
    polished = polish(data, stages.T_camera_lidar, config, on_event)
    stages, T_polished = replace(stages, polished=polished), polished.T_camera_lidar
    if not config.jointly.is_empty:
        errors = None if stages.deskewed is None else stages.deskewed.errors
        joint = estimate_jointly(data, T_polished, config, on_event, speed_errors=errors)
        return replace(stages, joint=joint)
    if not priors:
        return stages
    covariance = None if stages.deskewed is None else stages.deskewed.covariance
    return replace(
        stages, fused=fuse(data, T_polished, config, priors, on_event, speed_covariance=covariance)
    )


def is_polished(observations: Observations, config: RefinementConfig) -> bool:
    """Whether the polish ends the refinement of these observations."""
    return config.is_polished and not observations.has_vectors


def check_options(data: LoadedDrive, config: RefinementConfig, priors: Sequence[Prior]) -> None:
    """Check that priors, intrinsics and the clock are compatible with the drive and the polish."""
    path, jointly = data.drive.path, config.jointly
    has_polish = is_polished(data.observations, config)
    if priors and not has_polish:
        raise InputError(
            f"{priors[0].name}: priors need the polish, which features and is_polished=False exclude"
        )
    if jointly.is_empty:
        return
    option = "--refine-intrinsics" if jointly.intrinsics else "--estimate-delay"
    check_intrinsic_names(jointly.intrinsics, data.observations.camera, f"{path}: --refine-intrinsics")
    if not has_polish:
        raise InputError(f"{option}: needs the polish, which features and is_polished=False exclude")
    if priors:
        raise InputError(
            f"{option}: found {priors[0].name}, expected no prior: the two cannot be combined yet"
        )
    if jointly.with_delay and twists_per_s(data.observations) is None:
        raise InputError(
            f"{path}: motion: found no direction of motion, expected poses or a twist for --estimate-delay"
        )


def refine(
    data: LoadedDrive,
    T_init: Pose,
    config: RefinementConfig,
    seed: int = 0,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
    *,
    from_afar: bool = False,
    candidates: Sequence[Pose] = (),
) -> Refinement:
    """Ascend the mutual information from a pose (Alg. 1).

    Args:
        data: The drive, as `load` returns it.
        T_init: (4, 4) pose to start from, metres.
        config: Settings of the refinement.
        seed: Seed of every random choice.
        priors: Known axes, to which the pose is clamped.
        on_event: Called with each event.
        from_afar: Whether the start may be off by up to 20 degrees.
        candidates: (4, 4) poses to compare besides those found from the start, if several starts are refined.

    Raises:
        InputError: the exact estimator is requested with features, or the device does not exist.
        CalibrationError: too few labelled points are on labelled pixels.
    """
    observations = data.observations
    pyramid = PyramidConfig(coarsest_block_deg=FAR_DEG) if from_afar else PyramidConfig()
    # A single ascent, as MINE's, needs blocks as coarse as beside other cues.
    starts = observations.starts if config.estimator == "exact" else data.policy.starts_together
    if starts is not None:
        pyramid = pyramid_of(starts)

    def on_level(num_done: int, num_levels: int) -> None:
        on_event(Progress("refining", num_done, num_levels))

    def ascend() -> Refinement:
        estimator, settings = make_estimator(observations, config, seed, on_event, candidates)
        with name_in_errors(data.drive.path):
            refined = refine_pose(
                observations, T_init, estimator, pyramid, on_level, lambda pose: clamp(pose, priors)
            )
        settings = {"refinement": {**refined.settings, **settings}}
        settings |= {"priors": [prior.describe() for prior in priors]} if priors else {}
        return replace(refined, details=f"{config.estimator}, {refined.details}", settings=settings)

    return announced("refined", "refining", ascend, on_event, T_init)


def polish(
    data: LoadedDrive, T_refined: Pose, config: RefinementConfig, on_event: Listener = ignore
) -> Polish:
    """Polish a pose that is about one pixel off, by Newton's method; held-out data decide whether it is accepted."""
    stage = partial(polish_pose, data.observations, T_refined, config.polish)
    return announced("polished", "polishing", stage, on_event, T_refined)


def estimate_jointly(
    data: LoadedDrive,
    T_polished: Pose,
    config: RefinementConfig,
    on_event: Listener = ignore,
    *,
    speed_errors: SpeedErrors | None = None,
) -> JointEstimate:
    """Estimate intrinsics and the offset of the clock together with the pose; see `adjust.joint`."""
    doing = "estimating intrinsics" if config.jointly.intrinsics else "estimating the clock"
    settings = config.jointly, config.polish, data.drive.time_offset_s, speed_errors
    stage = partial(fit_jointly, data.observations, T_polished, *settings)
    return announced("joint", doing, stage, on_event, T_polished)


def fuse(
    data: LoadedDrive,
    T_polished: Pose,
    config: RefinementConfig,
    priors: Sequence[Prior],
    on_event: Listener = ignore,
    *,
    speed_covariance: Matrix | None = None,
) -> Fused:
    """Fuse the estimate from the data, with its covariance (6, 6) by errors of a speed that they show, with priors."""
    clock = ClockUncertainty.of(data, T_polished, config.polish)
    clock_covariance = None if clock is None else clock.covariance()
    stage = partial(
        fuse_with_priors,
        data.observations,
        T_polished,
        priors,
        motion_covariance=sum_of(clock_covariance, covariance_of_motion(data, T_polished), speed_covariance),
    )
    return announced("fused", "combining with priors", stage, on_event, T_polished)
