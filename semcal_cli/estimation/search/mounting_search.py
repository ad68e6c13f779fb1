"""Search for the initial pose over all mountings (Alg. 2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace

import numpy as np

from semcal_cli import core
from semcal_cli.config import InitializationConfig
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.search.hand_eye import HandEye
from semcal_cli.estimation.search.mounting import Mounting, describe, measured_from, runner_up
from semcal_cli.estimation.search.registration import Candidate, register
from semcal_cli.estimation.stage import StageResult
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, rotation_error_deg
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.observations import NO_CLASS, Observations

GIVEN = "started at the given transform"
"""Note on a pose that was not searched for."""

FAR_RUNNER_UPS = 2.0
"""Distance in multiples of `runner_up_deg` at which another mounting is kept while poses ascend, so that one remains to
compare with. With a 35-degree lens, levels turn poses by up to 9 degrees."""

FARTHEST_M = 1.0
"""Maximum distance from a given pose to one that ground and objects lead to. Two classes hardly constrain distances:
with a 35-degree lens, they led to a pose 2 m away."""

MIN_POINTS_OF_MAX = 0.02
"""Minimum number of points of a hypothesis, relative to the hypothesis with the most points. Others are dropped."""


@dataclass(frozen=True, kw_only=True)
class Initialization(StageResult):
    """Result of the initial calibration. Its pose is that of the first hypothesis."""

    hypotheses: tuple[Mounting, ...]
    """Hypotheses, best first."""
    runner_up_margin: float | None
    """Standard errors by which the runner-up is behind; None if no other mounting was compared."""
    runner_up: Mounting | None = None
    """Best hypothesis of another mounting; None if there is none."""
    is_exhaustive: bool = False
    """Whether all mountings were searched, and priors left out none of them."""
    by_motion: HandEye | None = None
    """The motion of camera and LiDAR that tells the pose; None where something else does."""


def search_mountings(
    observations: Observations,
    config: InitializationConfig,
    seed: int,
    T_start: Pose | None = None,
    is_possible: Callable[[Pose], bool] = lambda T_camera_lidar: True,
) -> Initialization:
    """Search all mountings, or those around a given pose (Alg. 2).

    The label images are registered with the spherical images, and PnP is solved for each of the best placements. The
    registration finds rotations and almost no translation, so the poses then ascend the mutual information over SE(3)
    on coarse label images. Finally, the exact mutual information at full resolution ranks them, so that a false maximum
    of the coarse images does not win.

    Args:
        observations: Labelled points and label images.
        config: Settings of the search.
        seed: Seed of every random choice.
        T_start: (4, 4) T_camera_lidar to start from. The search covers rotations within `config.search_deg` of it, and
            the spherical images are centred at its camera. Without `config.search_deg` nothing is searched, and only
            this pose ascends.
        is_possible: Whether priors allow a pose. Hypotheses that they exclude are left out, unless they exclude all.

    Raises:
        CalibrationError: sweeps and images do not overlap, or no placement leads to a pose.
        InputError: the points are not in the field of view of the drive's `lidar:` block.
    """
    observations = few_frames(observations, config.max_frames)
    is_searched = T_start is None or config.search_deg is not None
    candidates = _candidates(observations, config, seed, T_start)
    ranked = _rank(observations, candidates, config.min_overlap)[: None if is_searched else 1]
    kept = [pair for pair in ranked if is_possible(pair[0].T_camera_lidar)] or ranked
    best, agreement_of_best = kept[0]
    T_best = best.T_camera_lidar
    hypotheses = tuple(describe(candidate, agreement, T_best) for candidate, agreement in kept)
    other = runner_up(hypotheses, config.runner_up_deg)
    margin = None if other is None else hypotheses[0].margin(other)
    return Initialization(
        T_camera_lidar=T_best,
        agreement=agreement_of_best,
        settings=recorded(config, observations),
        note="" if is_searched else GIVEN,
        details="" if margin is None else f"runner-up {margin:.1f} standard errors behind",
        hypotheses=hypotheses,
        runner_up_margin=margin,
        runner_up=other,
        is_exhaustive=T_start is None and len(kept) == len(ranked),
    )


def _candidates(
    observations: Observations, config: InitializationConfig, seed: int, T_start: Pose | None
) -> list[Candidate]:
    """Find poses to rank: by a registration, or by an ascent from a given pose without a search around it."""
    if T_start is not None and config.search_deg is None:
        return _align_from_start(observations, Candidate(T_start), config, seed)
    counts = np.sum(
        [np.bincount(cloud.classes, minlength=NO_CLASS + 1) for cloud in observations.clouds], axis=0
    )
    # With points of one class, no placement of the image is better than another.
    if len(classes := np.flatnonzero(counts[:NO_CLASS]).tolist()) < 2:
        class_words = (
            "".join(f"only {observations.point_class_names[index]}" for index in classes) or "no class"
        )
        raise CalibrationError(f"no initial calibration: found points of {class_words}, expected two classes")
    around = None if T_start is None else (T_start, math.radians(config.search_deg or 0.0))
    return _align(observations, register(observations, config, seed, around), config, seed)


def unsearched(observations: Observations, T_start: Pose, config: InitializationConfig) -> Initialization:
    """Take a given pose (4, 4) unchanged, for cues whose refinement starts from several poses around it."""
    agreement = core.agreement(observations.core, T_start)
    return Initialization(
        T_camera_lidar=T_start,
        agreement=agreement,
        settings=recorded(config, observations),
        note=GIVEN,
        hypotheses=(describe(Candidate(T_start), agreement, T_start),),
        runner_up_margin=None,
    )


def with_best(initial: Initialization, best: Mounting, observations: Observations) -> Initialization:
    """Put the mounting first that something other than the search has chosen."""
    if best is initial.hypotheses[0]:
        return initial
    T, others = best.T_camera_lidar, (other for other in initial.hypotheses if other is not best)
    hypotheses = measured_from(T, (best, *others))
    other = runner_up(hypotheses, InitializationConfig.runner_up_deg)
    few = few_frames(observations, InitializationConfig.max_frames)
    return replace(
        initial,
        T_camera_lidar=T,
        agreement=core.agreement(few.core, T),
        hypotheses=hypotheses,
        runner_up_margin=None if other is None else hypotheses[0].margin(other),
        runner_up=other,
    )


def _rank(
    observations: Observations, candidates: Sequence[Candidate], min_overlap: float
) -> list[tuple[Candidate, core.Agreement]]:
    """Rank candidates by the exact mutual information at full resolution, less its bias."""
    scored = [
        (candidate, core.agreement(observations.core, candidate.T_camera_lidar)) for candidate in candidates
    ]
    covering = [(candidate, agreement) for candidate, agreement in scored if agreement.overlap >= min_overlap]
    return sorted(covering or scored, key=lambda pair: pair[1].bias - pair[1].mutual_information)


def recorded(config: InitializationConfig, observations: Observations) -> dict[str, object]:
    """Return what a result records of the settings of the search."""
    settings = asdict(config)
    settings["alignment"]["max_baseline_m"] = observations.max_baseline_m
    return {"initialization": settings}


def _align_from_start(
    observations: Observations, start: Candidate, config: InitializationConfig, seed: int
) -> list[Candidate]:
    """Ascend from a given pose with the levels for a far start and those for a near one, and keep the pose itself.

    The exact mutual information ranks the three later. If the two ascents end apart, at least one has not found the
    optimum, and the directions around the pose are searched as well.
    """
    candidates = [start]
    for blocks_across in (config.alignment.blocks_across_given, config.alignment.blocks_across_near):
        levels = replace(config.alignment, blocks_across=blocks_across, num_kept=(1,) * len(blocks_across))
        candidates += _align(observations, [start], replace(config, alignment=levels), seed)
    _, *ascended = candidates
    if _angle_deg(ascended[0], ascended[-1]) > config.meeting_deg:
        around = start.T_camera_lidar, math.radians(config.around_given_deg)
        with suppress(CalibrationError):
            candidates += _align(observations, register(observations, config, seed, around), config, seed)
    if not observations.by_classes:
        return candidates
    T_start = start.T_camera_lidar
    return [
        candidate
        for candidate in candidates
        if compare_poses(candidate.T_camera_lidar, T_start).camera_center_m <= FARTHEST_M
    ]


def _align(
    observations: Observations, candidates: Sequence[Candidate], config: InitializationConfig, seed: int
) -> list[Candidate]:
    """Ascend over SE(3), level by level, and keep the best candidates after each level.

    The first level is fine, because coarse blocks would lose the right pose if sweep and image overlap in a narrow
    band. The coarse level after it moves poses out of local maxima.
    """
    levels = config.alignment
    # Blocks this coarse have no edge band, whatever its width at pixels.
    without_band = observations.without_edge_band.core
    width, height = observations.camera.width, observations.camera.height
    for blocks_across, num_kept in zip(levels.blocks_across, levels.num_kept, strict=True):
        aligned = core.align(
            without_band,
            [candidate.T_camera_lidar for candidate in candidates],
            levels,
            factor=2 ** int(math.log2(max(min(width / blocks_across, height), 1.0))),
            visible_only=False,
            seed=seed,
        )
        max_points = max(end.num_points for end in aligned)
        ranked = sorted(
            (-end.value, index)
            for index, end in enumerate(aligned)
            if end.num_points >= MIN_POINTS_OF_MAX * max_points
        )
        moved = [
            replace(candidates[index], T_camera_lidar=aligned[index].T_camera_lidar) for _, index in ranked
        ]
        candidates = _best_apart(moved, num_kept, config)
    return list(candidates)


def _best_apart(ranked: Sequence[Candidate], num_kept: int, config: InitializationConfig) -> list[Candidate]:
    """Drop candidates at the same pose as a better one, and keep the best ones and always a runner-up.

    A runner-up near the best may end at the same pose after the next levels, so one farther away is kept as well.
    """
    apart: list[Candidate] = []
    for candidate in ranked:
        if all(_angle_deg(candidate, better) > config.alignment.same_deg for better in apart):
            apart.append(candidate)
    kept, others = apart[:num_kept], apart[num_kept:]
    for min_deg in (FAR_RUNNER_UPS * config.runner_up_deg, config.runner_up_deg):
        if all(_angle_deg(candidate, apart[0]) < min_deg for candidate in kept):
            kept += [candidate for candidate in others if _angle_deg(candidate, apart[0]) >= min_deg][:1]
    return kept


def _angle_deg(a: Candidate, b: Candidate) -> float:
    return rotation_error_deg(a.T_camera_lidar, b.T_camera_lidar)
