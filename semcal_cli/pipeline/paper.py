"""The method as published: Alg. 2 gives a pose, and MINE ascends from it (Alg. 1). Nothing of ours is added to either.

Source: Jiang, Osteen and Saripalli, *Calibrating LiDAR and Camera using Semantic Mutual Information*, arXiv 2104.12023.

The start is the best placement of the registration, and the only objective is the Donsker-Varadhan bound over the label
pyramid: hypotheses do not climb, isolated pixels stay, borders have full weight, hidden points count, and nothing is
polished. The exact mutual information only shows afterwards whether another placement would have been as good.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial

from semcal_cli import core
from semcal_cli.checks.other_mounting import check_mountings
from semcal_cli.config import CalibrationConfig, Device
from semcal_cli.config.paper_config import PaperConfig
from semcal_cli.errors import check_torch, torch_import
from semcal_cli.estimation.refine.pyramid import Refinement, refine_pose
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.search.mounting import describe, measured_from, runner_up
from semcal_cli.estimation.search.mounting_search import Initialization, recorded
from semcal_cli.estimation.search.registration import Candidate, register
from semcal_cli.estimation.stage import StageResult, announced
from semcal_cli.events import Listener, ignore
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.pipeline import make_calibration, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.calibration_document import CalibrationDocument


def calibrate_as_published(
    data: LoadedDrive,
    config: CalibrationConfig,
    paper: PaperConfig,
    *,
    initial_pose: InitialPose | None = None,
    on_event: Listener = ignore,
) -> CalibrationDocument:
    """Calibrate with the paper's method; arguments and errors are those of `pipeline.calibrate`.

    The drive is loaded with `config.is_raw`. An initial pose replaces Alg. 2. The result has no uncertainty; it is not
    trusted if the pose has not settled or another placement of Alg. 2 agrees about as well.
    """
    observations = data.observations
    initial: StageResult
    if initial_pose is None:
        doing = "registering label images with spherical images"
        register_labels = partial(_placements, observations, paper, config.seed)
        initial = announced("initial", doing, register_labels, on_event)
    else:
        initial = start_at(data, initial_pose, on_event)
    T_init, device = initial.T_camera_lidar, config.refinement.device

    def ascend() -> Refinement:
        refinement = refine(observations, T_init, paper, config.seed, device)
        details = f"mine, {refinement.details}, bound {refinement.bound_nats:.4f} nats"
        mine = asdict(paper.mine) | observations.without_edge_band.shared_settings
        settings = {**refinement.settings, "paper": {"mine": mine, "device": device}}
        return replace(refinement, details=details, settings=settings)

    refined = announced("refined", "ascending the bound", ascend, on_event, T_init)
    of_comparison: tuple[Finding, ...] = ()
    if isinstance(initial, Initialization):
        initial, of_comparison = _compared(initial, refined, paper)
    stages = Stages.from_refined(
        data,
        initial,
        refined,
        is_compensated=False,
        of_comparison=of_comparison,
    )
    return make_calibration(data, stages, config, initial_pose=initial_pose)


def initialize(observations: Observations, paper: PaperConfig, seed: int) -> list[Candidate]:
    """Run Alg. 2 with the paper's zoom; the best placement comes first, and its pose is the paper's answer.

    Raises:
        CalibrationError: sweeps and images do not overlap, or no placement leads to a pose.
        InputError: the points do not lie in the field of view of the drive's `lidar:` block.
    """
    return register(observations, paper.initialization, seed)


def refine(
    observations: Observations, T_init: Pose, paper: PaperConfig, seed: int, device: Device = "cpu"
) -> Refinement:
    """Run Alg. 1 from a pose: ascend the Donsker-Varadhan bound over the whole pyramid.

    Raises:
        InputError: the device does not exist, or torch is not installed.
        CalibrationError: too few labelled points land on labelled pixels.
    """
    check_torch("--method paper")
    with torch_import():
        from semcal_cli.estimation.refine.mine import MineEstimator

    estimator = MineEstimator(observations.without_edge_band, paper.mine, seed, device)
    return refine_pose(observations, T_init, estimator, paper.pyramid)


def _placements(observations: Observations, paper: PaperConfig, seed: int) -> Initialization:
    """Take the best placement, and describe the others."""
    candidates = initialize(observations, paper, seed)
    T_first = candidates[0].T_camera_lidar
    agreements = [core.agreement(observations.core, candidate.T_camera_lidar) for candidate in candidates]
    hypotheses = tuple(
        describe(candidate, agreement, T_first)
        for candidate, agreement in zip(candidates, agreements, strict=True)
    )
    return Initialization(
        T_camera_lidar=T_first,
        agreement=agreements[0],
        settings=recorded(paper.initialization, observations),
        note=f"the best of {len(hypotheses)} placements",
        details=f"{hypotheses[0].num_inliers} inliers of PnP",
        hypotheses=hypotheses,
        runner_up_margin=None,
    )


def _compared(
    initial: Initialization, refined: Refinement, paper: PaperConfig
) -> tuple[Initialization, tuple[Finding, ...]]:
    """Compare the refined pose with the other, unrefined placements of Alg. 2.

    The registration of few pairs may prefer a wrong mounting, from which the ascent settles at a false optimum. The
    right mounting is then usually among the other placements, and agrees as well even unrefined.
    """
    best = describe(Candidate(refined.T_camera_lidar), refined.agreement, refined.T_camera_lidar)
    ranked = sorted(initial.hypotheses, key=lambda hypothesis: -hypothesis.corrected_nats)
    other = runner_up(measured_from(refined.T_camera_lidar, ranked), paper.initialization.runner_up_deg)
    if other is not None:
        initial = replace(initial, runner_up_margin=best.margin(other), runner_up=other)
    return initial, check_mountings(initial, best)
