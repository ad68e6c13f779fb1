"""The stages of a calibration, in order: initialize, refine, assess."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from semcal_cli import _core
from semcal_cli.calibration import Calibration, Quality, Settings, Stage, Status
from semcal_cli.drive import Drive
from semcal_cli.initialization import Hypothesis, InitializationConfig, initialize
from semcal_cli.observations import Observations, load_observations
from semcal_cli.poses import Pose
from semcal_cli.provenance import describe_input, versions

if TYPE_CHECKING:
    from semcal_cli.refinement import Level, Refinement

MIN_OVERLAP = 0.03
"""An answer whose points cover less of the picture than this is not trusted."""


@dataclass(frozen=True)
class StageReport:
    """What a stage arrived at, for the user who watches."""

    name: str
    seconds: float
    T_camera_lidar: Pose | None = None
    agreement: _core.Agreement | None = None
    note: str = ""


@dataclass
class Run:
    """One calibration under way."""

    drive: Drive
    seed: int
    report: Callable[[StageReport], None] = lambda report: None
    progress: Callable[[str], None] = lambda doing: None
    stages: dict[str, Stage] = field(default_factory=dict)
    options: dict[str, object] = field(default_factory=dict)
    init: Path | None = None

    def calibrate(
        self,
        folder: Path,
        given: tuple[Pose, Path] | None = None,
        initialization: InitializationConfig | None = None,
        device: str = "cpu",
    ) -> Calibration:
        """Run every stage.

        Args:
            folder: Where the result will lie: the drive's path is given relative to it.
            given: T_camera_lidar to start at and the file it is from; None searches all mounting directions.
            initialization: How to search.
            device: Where the refinement computes, `cpu` or `cuda`.
        """
        observations = self.load()
        if given:
            T_init, source = given
            self.start_at(observations, T_init, source)
        else:
            config = initialization or InitializationConfig()
            T_init = self.initialize(observations, config)[0].T_camera_lidar
        refinement = self.refine(observations, T_init, device)
        return self.result(observations, refinement.T_camera_lidar, _convergence_reasons(refinement), folder)

    def load(self) -> Observations:
        """Read every file of the drive."""
        self.progress(f"reading {len(self.drive.frames)} frames")
        start = perf_counter()
        observations = load_observations(self.drive)
        num_points = sum(map(len, observations.points))
        note = (
            f"{observations.num_frames} frames, {num_points:,} points, "
            f"{len(observations.point_class_names)} point classes, "
            f"{len(observations.image_class_names)} image classes"
        )
        self.report(StageReport("load", perf_counter() - start, note=note))
        return observations

    def initialize(self, observations: Observations, config: InitializationConfig) -> list[Hypothesis]:
        """Search all mounting directions."""
        self.progress("searching all mounting directions")
        start = perf_counter()
        hypotheses = initialize(observations, config, self.seed)
        self.options["initialization"] = asdict(config)
        self._finish("initial", start, observations, hypotheses[0].T_camera_lidar, _runner_up(hypotheses))
        return hypotheses

    def start_at(self, observations: Observations, T_init: Pose, source: Path) -> None:
        """Take a given pose for the initial one."""
        self.init = source
        self._finish("initial", perf_counter(), observations, T_init, f"from {source}")

    def refine(self, observations: Observations, T_init: Pose, device: str) -> Refinement:
        """Climb the mutual information from a pose."""
        self.progress("loading torch")
        start = perf_counter()
        from semcal_cli.refinement import RefinementConfig, check_device, refine

        check_device(device)

        config = RefinementConfig()

        def on_level(level: Level, num_levels: int) -> None:
            self.progress(f"refining: {level.factor}-pixel blocks done, bound {level.bound_nats:.4f} nats")

        refinement = refine(observations, T_init, config, self.seed, device, on_level)
        self.options["refinement"] = asdict(config) | {"device": device}
        note = f"{len(refinement.levels)} levels, {'settled' if refinement.converged else 'not settled'}"
        self._finish("refined", start, observations, refinement.T_camera_lidar, note)
        return refinement

    def result(
        self,
        observations: Observations,
        T_camera_lidar: Pose,
        reasons: Sequence[str],
        folder: Path,
    ) -> Calibration:
        """Assess a pose and put everything into a calibration."""
        agreement = _core.agreement(observations.core, T_camera_lidar)
        reasons = [*reasons, *_overlap_reasons(agreement), *_information_reasons(agreement)]
        status: Status = "not_trusted" if reasons else "not_assessed"
        return Calibration.from_pose(
            T_camera_lidar,
            status=status,
            reasons=tuple(reasons),
            quality=Quality(
                mutual_information_nats=agreement.mutual_information,
                label_agreement=agreement.label_agreement,
                overlap=agreement.overlap,
                num_points=agreement.num_inside - agreement.num_hidden,
                num_frames=observations.num_frames,
            ),
            stages=self.stages,
            input=describe_input(self.drive, self.init, folder),
            settings=Settings.model_validate(
                {"options": _plain(self.options), "seed": self.seed, "versions": versions()}
            ),
        )

    def _finish(
        self, name: str, start: float, observations: Observations, T_camera_lidar: Pose, note: str
    ) -> None:
        agreement = _core.agreement(observations.core, T_camera_lidar)
        rows = tuple(tuple(row) for row in T_camera_lidar.tolist())
        self.stages[name] = Stage(T_camera_lidar=rows, mutual_information_nats=agreement.mutual_information)
        self.report(StageReport(name, perf_counter() - start, T_camera_lidar, agreement, note))


def _convergence_reasons(refinement: Refinement) -> list[str]:
    """Say why a refinement's pose cannot be trusted, if so."""
    if refinement.converged:
        return []
    return [
        f"the refinement had not settled: the pose still moved points by {refinement.levels[-1].drift:.1f} pixels "
        f"over the last quarters of the finest level"
    ]


def _overlap_reasons(agreement: _core.Agreement) -> list[str]:
    if agreement.overlap >= MIN_OVERLAP:
        return []
    return [
        f"visible labelled points cover {agreement.overlap:.1%} of the picture, needed are {MIN_OVERLAP:.0%}"
    ]


def _information_reasons(agreement: _core.Agreement) -> list[str]:
    if agreement.mutual_information > agreement.bias:
        return []
    return [
        f"labels share {agreement.mutual_information:.4f} nats, no more than unrelated labels do by chance"
    ]


def _runner_up(hypotheses: Sequence[Hypothesis]) -> str:
    if len(hypotheses) == 1:
        return "1 hypothesis"
    second = hypotheses[1].mutual_information_nats
    return f"{len(hypotheses)} hypotheses, runner-up {second:.4f} nats"


def _plain(value: object) -> object:
    """Tuples as lists, as both file formats read them back."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def set_threads(num_threads: int | None) -> None:
    """Run the Rust stages on so many threads; on as many as the process may use if None."""
    if num_threads is not None:
        _core.set_num_threads(num_threads)
