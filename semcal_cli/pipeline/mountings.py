"""The choice between mountings that ground and objects alone cannot distinguish."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from semcal_cli.checks import few_scenes
from semcal_cli.checks.other_mounting import MIN_RUNNER_UP_MARGIN
from semcal_cli.checks.other_pose import OTHER_POSE
from semcal_cli.config import ExactConfig, InitializationConfig, PolishConfig
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import Refinement
from semcal_cli.estimation.refine.several_starts import SeveralStarts
from semcal_cli.estimation.search.mounting import Mounting
from semcal_cli.estimation.search.mounting_search import Initialization, with_best
from semcal_cli.estimation.uncertainty.information import sigmas_behind
from semcal_cli.events import Listener, Progress
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.loading import LoadedDrive


def resolve_mountings(
    data: LoadedDrive,
    initial: Initialization,
    refined: Refinement,
    refine: Callable[[Pose], Refinement],
    seed: int,
    on_event: Listener,
) -> tuple[Initialization, Refinement, bool]:
    """Decide between mountings that ground and objects alone cannot distinguish, by the cues that refine poses.

    The mounting is clear if all others are behind it by enough standard errors. Those that are not once coarse blocks
    are ascended and finished are refined in full, and the better one is taken, up to the first that stays unclear.

    Args:
        data: The drive, whose cues are refined from several starts.
        initial: The hypotheses of the search.
        refined: The best of them, refined.
        refine: Refines another one from its pose (4, 4).
        seed: Seed of the starts.
        on_event: Called with what is compared.

    Returns:
        The search with the mounting that is taken as its best, that one refined, and whether it is clear.
    """
    observations, starts = data.observations, data.observations.starts
    assert starts is not None
    if not data.policy.needs_near_start and len(set(observations.scenes)) < few_scenes.FEW_SCENES.limit():
        # Segments of few scenes make no mounting clear, and take minutes for that.
        return initial, refined, False
    best = mounting = initial.hypotheses[0]
    rivals = [
        other for other in initial.hypotheses if _is_rival(best, other, InitializationConfig.runner_up_deg)
    ]
    is_clear, limit = bool(rivals), OTHER_POSE.limit()
    for rival in rivals:
        on_event(Progress(f"comparing a mounting {rival.rotation_from_best_deg:.0f} degrees away"))
        # A mounting in which sweeps and images do not overlap is none.
        with suppress(CalibrationError):
            several = SeveralStarts(observations, ExactConfig(), seed, starts)
            T_coarse = newton(
                observations, several.coarse_maximum(rival.T_camera_lidar), PolishConfig()
            ).T_camera_lidar
            if sigmas_behind(observations, refined.T_camera_lidar, [T_coarse])[0] >= limit:
                continue
            refined_rival = refine(rival.T_camera_lidar)
            (behind,) = sigmas_behind(observations, refined.T_camera_lidar, [refined_rival.T_camera_lidar])
            if behind < 0.0:
                mounting, refined = rival, refined_rival
            is_clear &= abs(behind) >= limit
        if not is_clear:
            break  # The mounting is doubted, whichever of the others is best.
    return with_best(initial, mounting, data.searched_by), refined, is_clear


def _is_rival(best: Mounting, other: Mounting, min_deg: float) -> bool:
    """Whether a hypothesis is another mounting that is not far enough behind the best one."""
    return other.rotation_from_best_deg >= min_deg and best.margin(other) < MIN_RUNNER_UP_MARGIN
