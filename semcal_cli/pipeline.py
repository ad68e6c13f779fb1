"""The stages of a calibration, in order: initialize, refine, assess."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from time import perf_counter

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment import findings as reasons
from semcal_cli.assessment.consistency import doubts
from semcal_cli.assessment.priors import Fused, Prior, fuse, hold
from semcal_cli.assessment.uncertainty import Uncertainty, estimate_uncertainty, label_bleed
from semcal_cli.baselines.soic import Soic
from semcal_cli.config import (
    EDGE_BAND_PX,
    FAR_DEG,
    LABELS,
    MAX_BASELINE_M,
    MAX_FRAMES,
    Cue,
    Estimator,
    ExactConfig,
    InitializationConfig,
    PolishConfig,
    PyramidConfig,
    SoicConfig,
)
from semcal_cli.drive.cues import choose_frames, describe_cues, files_of, load_cues
from semcal_cli.drive.document import Drive, Motion
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.point_clouds import Sweeps
from semcal_cli.geometry.pose_error import PoseError, compare_poses
from semcal_cli.geometry.poses import Pose, rotation_error_deg
from semcal_cli.initialization.search import Hypothesis, initialize, margin, runner_up
from semcal_cli.refinement.polish import Polish, polish
from semcal_cli.refinement.pyramid import Climb, ExactClimb, Level, refine
from semcal_cli.result.calibration import (
    Calibration,
    HypothesisRecord,
    LabelBleed,
    PolishRecord,
    Quality,
    Repeatability,
    Settings,
    Stage,
    Status,
    UncertaintyRecord,
)
from semcal_cli.result.provenance import describe_input, versions

INITIAL_DEG, INITIAL_M = 5.0, 0.5
"""How far a hypothesis of the initial calibration may be off, to be compared with what is known."""


@dataclass(frozen=True)
class StageReport:
    """What a stage arrived at, for the user who watches."""

    name: str
    seconds: float
    agreement: _core.Agreement | None = None
    moved: PoseError | None = None
    """How far its pose is from the one that it began with."""
    note: str = ""


@dataclass(frozen=True)
class RefinementConfig:
    """Which estimator climbs, and whether its pose is polished."""

    estimator: Estimator = "exact"
    device: str = "cpu"
    """Where the network of `mine` computes, `cpu` or `cuda`."""
    is_polished: bool = True
    max_baseline_m: float = MAX_BASELINE_M
    edge_band_px: int = EDGE_BAND_PX
    priors: tuple[Prior, ...] = ()
    """What is known of the pose; needs the polish."""
    is_assessed: bool = True
    """Whether it is told how sure a polished pose is, and what speaks against it ..."""
    with_label_bleed: bool = True
    """... and what labels that bleed would do."""


@dataclass(frozen=True)
class Given:
    """A transform that the user knows something about."""

    T_camera_lidar: Pose
    name: str
    """What to call it."""
    source: Path | None = None
    """The file it is from; None if it was typed."""


@dataclass
class Run:
    """One calibration under way."""

    drive: Drive
    seed: int
    max_frames: int = MAX_FRAMES
    """Of a longer drive, so many frames are used."""
    cues: tuple[Cue, ...] = LABELS
    """What points and pixels are compared by."""
    sweeps: Sweeps | None = None
    """Sweeps that other cameras of a rig have read; None: they are read for this run alone ..."""
    hashes: dict[str, str] = field(default_factory=dict)
    """... and hashes of files."""
    report: Callable[[StageReport], None] = lambda report: None
    progress: Callable[[str], None] = lambda doing: None
    stages: dict[str, Stage] = field(default_factory=dict)
    polish_record: PolishRecord | None = None
    uncertainty: UncertaintyRecord | None = None
    repeatability: Repeatability | None = None
    hypotheses: tuple[HypothesisRecord, ...] = ()
    runner_up_margin: float | None = None
    reasons: list[str] = field(default_factory=list)
    options: dict[str, object] = field(default_factory=dict)
    given: Given | None = None
    max_baseline_m: float = math.inf
    """How far the camera may be from the LiDAR, if that was asked."""
    is_assessed: bool = False
    """Whether everything was looked at that may speak against the pose."""

    def calibrate(
        self,
        folder: Path,
        initialization: InitializationConfig | None = None,
        given: Given | None = None,
        refinement: RefinementConfig | None = None,
        num_seeds: int = 1,
    ) -> Calibration:
        """Run every stage.

        Args:
            folder: Where the result will lie: the drive's path is given relative to it.
            initialization: How to search.
            given: Where to search, or the only pose to start at: see `initialize`.
            refinement: How to refine what was found.
            num_seeds: With more than one, the seeds that follow are tried, too, to see where they lead.
        """
        initialization, refinement = (
            initialization or InitializationConfig(),
            refinement or RefinementConfig(),
        )
        observations = self.load()
        hypotheses = self.initialize(observations, initialization, given, refinement.priors)
        T_camera_lidar = self.refine(observations, hypotheses[0].T_camera_lidar, refinement)
        if num_seeds > 1:
            self._repeat(observations, T_camera_lidar, initialization, given, refinement, num_seeds)
        return self.result(observations, T_camera_lidar, folder)

    def calibrate_by_soic(
        self, folder: Path, given: Given | None = None, max_baseline_m: float = MAX_BASELINE_M
    ) -> Calibration:
        """Calibrate as SOIC does, for comparison; how sure its pose is stays open.

        Args:
            folder: As of `calibrate`.
            given: Where to start instead of the semantic centroids.
            max_baseline_m: Semantic centroids put the camera no farther from the LiDAR, and a result that does is not
                trusted.
        """
        observations, config = self.load(), SoicConfig()
        self.reasons += reasons.motion(observations.motion_error_px)
        start = perf_counter()
        self._take(given)
        self.options["soic"] = asdict(config)
        self.progress("computing distances to classes")
        soic = Soic(observations, config)
        if given is None:
            self.progress("trying semantic centroids")
        T_init = soic.initialize(max_baseline_m) if given is None else given.T_camera_lidar
        origin = "semantic centroids" if given is None else given.name
        self._finish("initial", start, observations, T_init, f"from {origin}, {soic.cost(T_init):.2f} px")
        start = perf_counter()
        self.progress("moving points to their classes")
        found = soic.minimize(T_init)
        if not found.converged:
            self.reasons.append(f"SOIC had not settled after {config.max_restarts} restarts")
        self.reasons += reasons.distance(found.T_camera_lidar, max_baseline_m)
        note = f"soic, {found.cost_px:.2f} px after {found.num_evaluations} evaluations"
        self._finish("refined", start, observations, found.T_camera_lidar, note)
        return self.result(observations, found.T_camera_lidar, folder)

    def _repeat(
        self,
        observations: Observations,
        T_camera_lidar: Pose,
        initialization: InitializationConfig,
        given: Given | None,
        refinement: RefinementConfig,
        num_seeds: int,
    ) -> None:
        """Calibrate with the seeds that follow, and compare."""
        start = perf_counter()
        found = [np.zeros(6)]
        for seed in range(self.seed + 1, self.seed + num_seeds):
            self.progress(f"repeating with seed {seed}")
            other = Run(self.drive, seed, self.max_frames, self.cues)
            try:
                hypotheses = other.initialize(observations, initialization, given, refinement.priors)
                T_init = hypotheses[0].T_camera_lidar
                T = other.refine(observations, T_init, replace(refinement, is_assessed=False))
            except CalibrationError:
                continue
            difference = compare_poses(T, T_camera_lidar)
            center_m = [0.01 * x for x in difference.camera_center_xyz_cm]
            found.append(np.array([*center_m, *difference.rotation_xyz_deg]))
        differences = np.array(found)
        spread = differences.std(axis=0, ddof=1).tolist() if len(found) > 1 else None
        self.repeatability = Repeatability(
            num_seeds=num_seeds,
            num_failed=num_seeds - len(found),
            spread_camera_center_m=spread and spread[:3],
            spread_rotation_deg=spread and spread[3:],
            farthest_camera_center_m=float(np.linalg.norm(differences[:, :3], axis=1).max()),
            farthest_rotation_deg=float(np.linalg.norm(differences[:, 3:], axis=1).max()),
        )
        self.options["num_seeds"] = num_seeds
        self.reasons += reasons.repeatability(self.repeatability, differences, self.uncertainty)
        self.report(StageReport("repeated", perf_counter() - start, note=f"{num_seeds} seeds"))

    def load(self) -> Observations:
        """Read the drive, or as many frames as are used of it."""
        start = perf_counter()
        num_frames = len(self.drive.frames)
        self.progress(f"looking through {num_frames} frames")
        self.drive = choose_frames(self.drive, self.cues, self.max_frames)
        self.options["max_frames"] = self.max_frames
        self.progress(f"reading {len(self.drive.frames)} frames")
        observations = load_cues(self.drive, self.cues, self.sweeps)
        num_used = len(self.drive.frames)
        # With several cues frames are there several times.
        num_points = sum(map(len, observations.points[:num_used]))
        chosen = f" of {num_frames:,}" if num_used < num_frames else ""
        note = (
            f"{num_used}{chosen} frames, {num_points:,} points, "
            f"{len(observations.point_class_names)} point classes, "
            f"{len(observations.image_class_names)} image classes"
        )
        if self.cues != LABELS:
            self.options["cues"] = describe_cues(self.cues)
            note += f", by {' and '.join(self.cues)}"
        if observations.speckle > 0.0:
            note += f", {observations.speckle:.2%} isolated pixels mended"
        if self.drive.motion is not None:
            note += f", motion {_compensation(self.drive.motion, observations.motion_error_px)}"
        self.report(StageReport("load", perf_counter() - start, note=note))
        return observations

    def initialize(
        self,
        observations: Observations,
        config: InitializationConfig,
        given: Given | None = None,
        priors: Sequence[Prior] = (),
    ) -> list[Hypothesis]:
        """Search all mounting directions, or where the user says; what priors rule out is left out, if all is not."""
        start = perf_counter()
        self._take(given)
        if given is None:
            self.progress("searching all mounting directions")
        else:
            self.progress(
                f"starting at {given.name}" if config.search_deg is None else f"searching around {given.name}"
            )
        T_given = None if given is None else given.T_camera_lidar
        hypotheses = initialize(observations, config, self.seed, T_given)
        self.options["initialization"] = asdict(config)
        possible = [
            hypothesis
            for hypothesis in hypotheses
            if all(p.allows(hypothesis.T_camera_lidar, INITIAL_M, math.radians(INITIAL_DEG)) for p in priors)
        ]
        is_ruled_out = 0 < len(possible) < len(hypotheses)
        hypotheses = possible or hypotheses
        best, other = hypotheses[0], runner_up(hypotheses, config)
        self.hypotheses = tuple(_record(hypothesis, best) for hypothesis in hypotheses)
        note = f"{len(hypotheses)} hypotheses" if len(hypotheses) > 1 else "1 hypothesis"
        if other is not None:
            self.runner_up_margin = margin(best, other)
            self.reasons += reasons.runner_up(best, other, self.runner_up_margin)
            note += f", runner-up {self.runner_up_margin:.1f} standard errors behind"
        elif given is None and not is_ruled_out:
            self.reasons.append(
                "no other mounting was left to compare with: nothing tells that this one is right"
            )
        self._finish("initial", start, observations, best.T_camera_lidar, note)
        return hypotheses

    def start_at(self, observations: Observations, given: Given) -> None:
        """Take a given pose for the initial one, as it is."""
        self._take(given)
        self._finish("initial", perf_counter(), observations, given.T_camera_lidar, f"from {given.name}")

    def refine(
        self, observations: Observations, T_init: Pose, config: RefinementConfig, *, from_afar: bool = False
    ) -> Pose:
        """Climb the mutual information from a pose; `from_afar` from one that may be 20 degrees off."""
        start = perf_counter()
        self.reasons += reasons.motion(observations.motion_error_px)
        self.max_baseline_m = config.max_baseline_m
        pyramid = PyramidConfig(coarsest_block_deg=FAR_DEG) if from_afar else PyramidConfig()
        climb, settings = self._climb(observations, config)

        def on_level(level: Level, num_levels: int) -> None:
            moved = compare_poses(level.T_camera_lidar, T_init)
            self.progress(
                f"refining: {level.factor}-pixel blocks done, {level.information_nats:.4f} nats, moved "
                f"{moved.rotation_deg:.3f} deg, {moved.camera_center_cm:.2f} cm"
            )

        refinement = refine(
            observations, T_init, climb, pyramid, on_level, lambda pose: hold(pose, config.priors)
        )
        T_camera_lidar = refinement.T_camera_lidar
        self.options["refinement"] = {"pyramid": asdict(pyramid), **settings}
        if config.priors:
            self.options["priors"] = [_prior_record(prior) for prior in config.priors]
        note = (
            f"{config.estimator}, {len(refinement.levels)} levels, "
            f"{'settled' if refinement.converged else 'not settled'}"
        )
        self._finish("refined", start, observations, T_camera_lidar, note)
        # The polish is of the exact mutual information, which vectors have none of.
        is_polished = config.is_polished and not observations.point_vectors
        polished = self._polish(observations, T_camera_lidar, config) if is_polished else None
        if polished is None:
            self.reasons += reasons.convergence(refinement)
            return T_camera_lidar
        if config.priors:
            T_start = polished.T_camera_lidar if polished.is_accepted else T_camera_lidar
            return self._fuse(observations, T_start, polished, config)
        self.reasons += reasons.polish(polished)
        if not polished.is_accepted:
            self.reasons += reasons.convergence(refinement)
            return T_camera_lidar
        if config.is_assessed:
            self._assess(observations, polished.T_camera_lidar, config)
        return polished.T_camera_lidar

    def _fuse(
        self, observations: Observations, T_start: Pose, polished: Polish, config: RefinementConfig
    ) -> Pose:
        """Put together what labels say and what is known."""
        self.progress("weighing what is known")
        start = perf_counter()
        fused = fuse(observations, T_start, config.priors, edge_band_px=config.edge_band_px)
        T_camera_lidar = fused.T_camera_lidar
        note = ", ".join(prior.name for prior in config.priors)
        self._finish("fused", start, observations, T_camera_lidar, note)
        if fused.is_alone:
            # Otherwise it is no wonder that labels lead nowhere.
            self.reasons += reasons.polish(polished)
        if not fused.is_settled:
            self.reasons.append("the pose that labels and what is known determine together had not settled")
        self.reasons += fused.conflicts
        if config.is_assessed:
            self._assess(observations, T_camera_lidar, config, fused)
        return T_camera_lidar

    def _climb(self, observations: Observations, config: RefinementConfig) -> tuple[Climb, dict[str, object]]:
        """Make the estimator, and tell its settings; torch is loaded only where it is needed.

        Raises:
            InputError: the exact mutual information of features is asked for, or a device that is not there.
        """
        if observations.point_vectors and config.estimator == "exact":
            raise InputError("--estimator exact: features are vectors, which have no histogram, needed mine")
        if config.estimator == "exact":
            exact = ExactConfig(max_baseline_m=config.max_baseline_m, edge_band_px=config.edge_band_px)
            return ExactClimb(observations, exact, self.seed), {"exact": asdict(exact)}
        self.progress("loading torch")
        from semcal_cli.config import MINE_WITH_VECTORS, MineConfig
        from semcal_cli.refinement.mine import MineClimb

        usual = MINE_WITH_VECTORS if observations.point_vectors else MineConfig()
        mine = replace(usual, max_baseline_m=config.max_baseline_m, edge_band_px=config.edge_band_px)
        climb = MineClimb(observations, mine, self.seed, config.device)
        return climb, {"mine": asdict(mine), "device": config.device}

    def _polish(self, observations: Observations, T_camera_lidar: Pose, config: RefinementConfig) -> Polish:
        self.progress("polishing")
        start = perf_counter()
        settings = PolishConfig(max_baseline_m=config.max_baseline_m, edge_band_px=config.edge_band_px)
        polished = polish(observations, T_camera_lidar, settings)
        self.options["polish"] = asdict(settings)
        sigma = polished.sigma_nats if math.isfinite(polished.sigma_nats) else None
        self.polish_record = PolishRecord(
            accepted=polished.is_accepted, held_out_gain_nats=polished.gain_nats, held_out_sigma_nats=sigma
        )
        verdict = "accepted" if polished.is_accepted else "rejected, the refined pose stays"
        note = f"{verdict}: held out {polished.gain_nats:+.4f} +- {polished.sigma_nats:.4f} nats"
        self._finish("polished", start, observations, polished.T_camera_lidar, note)
        return polished

    def _assess(
        self,
        observations: Observations,
        T_camera_lidar: Pose,
        config: RefinementConfig,
        fused: Fused | None = None,
    ) -> None:
        """Tell how sure a polished pose is, and what speaks against it."""
        self.progress("assessing")
        start = perf_counter()
        found = (
            estimate_uncertainty(observations, T_camera_lidar, edge_band_px=config.edge_band_px)
            if fused is None
            else fused.uncertainty
        )
        # Of several cues, the first: pictures of one say nothing beside points of another.
        alone = observations.of_frames(range(len(self.drive.frames))) if len(self.cues) > 1 else observations
        against = doubts(alone, T_camera_lidar)
        if found is None:
            nothing = "labels do not determine the pose: information does not fall in every direction"
            together = "labels and what is known do not determine the pose together"
            against.insert(0, nothing if fused is None else together)
        else:
            against += found.undetermined
            settings = PolishConfig(max_baseline_m=config.max_baseline_m, edge_band_px=config.edge_band_px)
            gain = None if fused is None else fused.label_gain
            bleed = (
                label_bleed(observations, T_camera_lidar, settings, gain)
                if config.with_label_bleed and self.cues == LABELS
                else None
            )
            self.uncertainty = _uncertainty_record(found, bleed)
        self.reasons += against
        self.is_assessed = True
        note = f"{len(against)} doubts" if len(against) > 1 else "1 doubt" if against else "no doubt"
        self.report(StageReport("assessed", perf_counter() - start, note=note))

    def result(self, observations: Observations, T_camera_lidar: Pose, folder: Path) -> Calibration:
        """Assess a pose and put everything into a calibration."""
        agreement = _core.agreement(observations.core, T_camera_lidar)
        against = [
            *self.reasons,
            *reasons.baseline(T_camera_lidar, self.max_baseline_m),
            *reasons.overlap(agreement),
            *reasons.information(agreement),
        ]
        status: Status = "not_trusted" if against else "trusted" if self.is_assessed else "not_assessed"
        return Calibration.from_pose(
            T_camera_lidar,
            status=status,
            reasons=tuple(against),
            quality=Quality(
                mutual_information_nats=agreement.mutual_information,
                bias_nats=agreement.bias,
                label_agreement=agreement.label_agreement,
                overlap=agreement.overlap,
                num_points=agreement.num_inside - agreement.num_hidden,
                num_frames=len(self.drive.frames),
                runner_up_margin=self.runner_up_margin,
            ),
            stages=self.stages,
            uncertainty=self.uncertainty,
            repeatability=self.repeatability,
            polish=self.polish_record,
            hypotheses=self.hypotheses,
            input=describe_input(
                self.drive,
                self.given.source if self.given else None,
                folder,
                files_of(self.cues),
                self.hashes,
            ),
            settings=Settings.model_validate(
                {"options": _plain(self.options), "seed": self.seed, "versions": versions()}
            ),
        )

    def _take(self, given: Given | None) -> None:
        self.given = given
        if given is not None and given.source is None:
            self.options["given"] = given.name

    def _finish(
        self, name: str, start: float, observations: Observations, T_camera_lidar: Pose, note: str
    ) -> None:
        seconds = perf_counter() - start
        agreement = _core.agreement(observations.core, T_camera_lidar)
        before = next(reversed(self.stages.values()), None)
        moved = None if before is None else compare_poses(T_camera_lidar, np.array(before.T_camera_lidar))
        self.stages[name] = Stage(
            T_camera_lidar=_rows(T_camera_lidar), mutual_information_nats=agreement.mutual_information
        )
        self.report(StageReport(name, seconds, agreement, moved, note))


def _compensation(motion: Motion, error_px: float | None) -> str:
    if motion.speed_m_s is None:
        return "compensated"
    if error_px is None:
        return "not compensated: clouds have no times"
    return f"not compensated: half of the points are {error_px:.1f} pixels off or more"


def _record(hypothesis: Hypothesis, best: Hypothesis) -> HypothesisRecord:
    return HypothesisRecord(
        T_camera_lidar=_rows(hypothesis.T_camera_lidar),
        mutual_information_nats=hypothesis.mutual_information_nats,
        bias_nats=hypothesis.bias_nats,
        sigma_nats=hypothesis.sigma_nats if math.isfinite(hypothesis.sigma_nats) else None,
        overlap=hypothesis.overlap,
        num_pairs=hypothesis.num_pairs,
        num_inliers=hypothesis.num_inliers,
        rotation_from_best_deg=rotation_error_deg(hypothesis.T_camera_lidar, best.T_camera_lidar),
    )


def _uncertainty_record(found: Uncertainty, bleed: npt.NDArray[np.float64] | None) -> UncertaintyRecord:
    half_widths = found.half_widths.tolist()
    moved = None if bleed is None else bleed.tolist()
    return UncertaintyRecord(
        covariance=found.covariance.tolist(),
        degrees_of_freedom=found.degrees_of_freedom.tolist(),
        sigma_camera_center_m=found.sigma_camera_center_m.tolist(),
        sigma_translation_m=found.sigma_translation_m.tolist(),
        sigma_rotation_deg=found.sigma_rotation_deg.tolist(),
        half_width_95_camera_center_m=half_widths[:3],
        half_width_95_rotation_deg=half_widths[3:],
        weak_directions=tuple(found.weak_directions),
        label_bleed=moved and LabelBleed(camera_center_m=moved[:3], rotation_deg=moved[3:]),
    )


def _prior_record(prior: Prior) -> dict[str, object]:
    sigmas = [sigma if math.isfinite(sigma) else None for sigma in prior.sigmas]
    return {
        "name": prior.name,
        "T_camera_lidar": prior.T_camera_lidar.tolist(),
        "sigma_camera_center_m": sigmas[:3],
        "sigma_rotation_deg": [None if sigma is None else math.degrees(sigma) for sigma in sigmas[3:]],
    }


def _rows(T: Pose) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in T.tolist())


def _plain(value: object) -> object:
    """Tuples as lists, as both file formats read them back."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def set_threads(num_threads: int | None) -> None:
    """Run the Rust stages on so many threads; on as many as the process may use if None."""
    if num_threads is not None:
        _core.set_num_threads(num_threads)
