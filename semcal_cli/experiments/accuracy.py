"""Error against the truth, over sensors, lenses, labels and starts, with both estimators."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from semcal_cli.config import EDGE_BAND_PX, Estimator, InitializationConfig, RefinementConfig
from semcal_cli.drive.cues.table import load_cues
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.reading import mend, read_observations
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.distribution import MEASURES, draw_groups, errors_in_groups
from semcal_cli.experiments.experiment import Experiment
from semcal_cli.experiments.plot_style import ACCENT, ORANGE, make_logarithmic
from semcal_cli.experiments.pool import Pool, consecutive
from semcal_cli.experiments.result_files import Report
from semcal_cli.experiments.rows import Case, Degrade, calibrate_from, wrong
from semcal_cli.experiments.rows import cases as rows_on_seeds
from semcal_cli.experiments.summary import ERRORS, NUMBER, Column, common, count, digits, grouped, median, of
from semcal_cli.geometry.poses import Pose, compare_poses
from semcal_cli.geometry.twists import displaced
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import initialize
from semcal_cli.result.stage import StageResult
from semcal_cli.synthetic.label_noise import as_by_a_network, with_disjoint_ontologies, with_ragged_things

if TYPE_CHECKING:
    from matplotlib.figure import Figure

START_SEEDS = 2.5
"""Factor on the number of seeds, for rows that start off the truth."""


@dataclass(frozen=True)
class Row:
    """A row of the table: a rig, a change of its labels, and a start."""

    rig: str = "default"
    num_pairs: int = 20
    degrade: Degrade = lambda observations, rng: observations
    cue: Literal["labels", "segments"] = "labels"
    """What points and pixels are compared by."""
    start: tuple[float, float] | None = None
    """Distance of the start from the truth, degrees about a random axis and metres; None starts without a guess."""
    right: tuple[float, float] = (0.06, 1.5)
    """Errors in degrees and centimetres within which a result is right; any other should say `not_trusted`."""


RIGS: dict[str, dict[str, object]] = {
    "default": {},
    "backward": {"camera_azimuth_deg": 180.0},
    "16_channels": {"channels": 16},
    "rosette": {"pattern": "rosette"},
    "narrow": {"lens": "narrow"},
    "wide": {"lens": "wide"},
}


def _ragged(grow_px: int) -> Degrade:
    return lambda observations, rng: with_ragged_things(observations, grow_px)


SEGMENT_START = 2.0, 0.2
"""Start of the rows of segments, degrees and metres off."""


def _segments(rig: str = "default", twice: float = 1.0) -> Row:
    return Row(rig, cue="segments", start=SEGMENT_START, right=(0.05 * twice, 1.5 * twice))


ROWS: dict[str, Row] = {
    "clean labels, 20 pairs": Row(right=(0.05, 1.2)),
    "clean labels, 1 pair": Row(num_pairs=1, right=(0.24, 7.5)),
    "20 % wrong labels on both sides": Row(degrade=wrong(0.2), right=(0.18, 3.6)),
    "50 % wrong labels on both sides": Row(degrade=wrong(0.5), right=(0.45, 9.0)),
    "camera backward": Row(rig="backward"),
    "16 channels": Row(rig="16_channels"),
    "rosette pattern": Row(rig="rosette"),
    "35-degree lens": Row(rig="narrow"),
    "100-degree lens": Row(rig="wide"),
    "disjoint ontologies": Row(degrade=with_disjoint_ontologies),
    "network-like labels": Row(degrade=as_by_a_network, right=(0.36, 7.5)),
    "things dilated by 2 px": Row(degrade=_ragged(2)),
    "things eroded by 2 px": Row(degrade=_ragged(-2)),
    "start 5 degrees and 1 m off": Row(start=(5.0, 1.0)),
    "start 10 degrees and 0.5 m off": Row(start=(10.0, 0.5)),
    "start 20 degrees and 0.5 m off": Row(start=(20.0, 0.5)),
    "segments, from nothing": Row(cue="segments", right=(0.05, 1.5)),
    "segments": _segments(),
    "segments, network-like labels": replace(_segments(), degrade=as_by_a_network, right=(0.15, 3.0)),
    "segments, 16 channels": _segments("16_channels", 2.0),
    "segments, rosette pattern": _segments("rosette", 2.0),
    "segments, 35-degree lens": _segments("narrow", 2.0),
    "segments, 100-degree lens": _segments("wide", 2.0),
}
"""Rows; where a bound on a median is wanted, the limit of a right result is three times that bound."""


COLORS = {"exact": ACCENT, "mine": ORANGE}
"""Colour of each estimator in plots."""


def cases(seeds: range, rows: Sequence[str] = tuple(ROWS)) -> list[Case]:
    """List the cases of some rows, seed by seed; those that start off the truth have more seeds."""
    more = range(seeds.start, seeds.start + round(START_SEEDS * len(seeds)))
    return [
        case for case in rows_on_seeds(rows, more) if case.seed in seeds or ROWS[case.row].start is not None
    ]


@dataclass(frozen=True)
class Result:
    """The error of one calibration against the truth."""

    row: str
    seed: int
    estimator: str
    rotation_deg: float
    """Rotation error; infinite, as the other errors are, if the calibration failed."""
    camera_center_cm: float
    is_right: bool
    """Whether the errors are within the row's limits."""
    status: str
    """Status of the calibration, or the reason why it failed."""
    initial_deg: float
    initial_cm: float
    refine_s: float

    @property
    def is_missed(self) -> bool:
        """Whether the calibration is wrong, but trusted."""
        return not self.is_right and math.isfinite(self.rotation_deg) and self.status != "not_trusted"


@dataclass(frozen=True)
class Runner:
    """The settings shared by all cases; a call runs one case. It can be pickled for other processes."""

    pool: Pool
    estimators: tuple[Estimator, ...]
    edge_band_px: int = EDGE_BAND_PX

    def __call__(self, case: Case) -> list[Result]:
        """Calibrate without a guess, or from a wrong start, with each estimator."""
        row, rng = ROWS[case.row], case.rng(ROWS)
        drive, truth = self.pool.read(row.rig, RIGS[row.rig], case.seed)
        data = _load(consecutive(drive, row.num_pairs, case.seed), row, rng)
        # Segments, which differ from frame to frame, have no network.
        estimators = [each for each in self.estimators if each == "exact" or row.cue == "labels"]
        initial_pose = None if row.start is None else InitialPose(displaced(truth, *row.start, rng), "off")
        try:
            initial = initialize(data, InitializationConfig(), initial_pose=initial_pose)
        except SemcalError as failure:
            return [_failed(case, estimator, failure) for estimator in estimators]
        return [self._refine(case, estimator, data, initial, truth) for estimator in estimators]

    def _refine(
        self, case: Case, estimator: Estimator, data: LoadedDrive, initial: StageResult, truth: Pose
    ) -> Result:
        """Refine with one estimator, and compare with the truth."""
        row, start = ROWS[case.row], perf_counter()
        config = RefinementConfig(estimator, edge_band_px=self.edge_band_px)
        try:
            stages, calibration = calibrate_from(initial, data, config)
        except SemcalError as failure:
            return _failed(case, estimator, failure)
        error = compare_poses(stages.T_camera_lidar, truth)
        started = compare_poses(initial.T_camera_lidar, truth)
        return Result(
            row=case.row,
            seed=case.seed,
            estimator=estimator,
            rotation_deg=error.rotation_deg,
            camera_center_cm=error.camera_center_cm,
            is_right=error.rotation_deg <= row.right[0] and error.camera_center_cm <= row.right[1],
            status=calibration.status,
            initial_deg=started.rotation_deg,
            initial_cm=started.camera_center_cm,
            refine_s=perf_counter() - start,
        )


def _load(drive: Drive, row: Row, rng: np.random.Generator) -> LoadedDrive:
    labelled = mend(row.degrade(read_observations(drive), rng))
    if row.cue == "labels":
        return LoadedDrive(drive, labelled)
    segments = load_cues(drive, (row.cue,), is_raw=True).with_images(labelled.images)
    names = labelled.image_class_names
    return LoadedDrive(drive, replace(segments, image_class_names=names), (row.cue,))


def _failed(case: Case, estimator: Estimator, failure: SemcalError) -> Result:
    inf = math.inf
    return Result(case.row, case.seed, estimator, inf, inf, False, f"failed: {failure}", inf, inf, 0.0)


COLUMNS = (
    common("row", ""),
    common("estimator", "estimator"),
    NUMBER,
    *ERRORS,
    count("right", "num_right", lambda result: result.is_right),
    count("not trusted", "num_not_trusted", lambda result: result.status == "not_trusted"),
    count("wrong, not said", "num_missed", lambda result: result.is_missed),
    count("failed", "num_failed", lambda result: not math.isfinite(result.rotation_deg)),
    Column("refinement, s", {"refine_s": of("refine_s", median)}, digits(1)),
)


def report(results: Sequence[Result]) -> Report:
    """Sum up the results of each row and estimator."""
    return Report.of(results, COLUMNS, lambda: _plot(results))


def experiment(
    out: Path, seeds: range, rows: Sequence[str], estimators: Sequence[str], edge_band_px: int | None
) -> Experiment[Case, Result]:
    """Declare the experiment; runs with other settings resume where they were, each in its own folder.

    Args:
        out: Folder of all experiments.
        seeds: Seeds of the drives.
        rows: Keys of `ROWS`; all if empty.
        estimators: Names of estimators.
        edge_band_px: Band beside borders that is left out; None for the default.
    """
    chosen = tuple(name for name in get_args(Estimator) if name in estimators)
    band = () if edge_band_px is None else (f"band{edge_band_px}",)
    name = "_".join(["accuracy", *(chosen if len(chosen) == 1 else ()), *band])
    run = Runner(Pool(out / "pool"), chosen, EDGE_BAND_PX if edge_band_px is None else edge_band_px)
    return Experiment("accuracy", out / name, cases(seeds, rows or tuple(ROWS)), run, Result, report)


def _plot(results: Sequence[Result]) -> Figure:
    """Draw the errors of each estimator in each row."""
    from matplotlib.figure import Figure

    rows = list(dict.fromkeys(result.row for result in results))
    estimators = list(dict.fromkeys(result.estimator for result in results))
    groups = grouped(results, lambda r: (r.estimator, r.row))
    figure = Figure(figsize=(12.0, 1.5 + 0.45 * len(rows)))
    axes = figure.subplots(1, 2, sharey=True)
    for ax, (key, label) in zip(axes, MEASURES, strict=True):
        errors = errors_in_groups(groups, key, estimators, rows)
        draw_groups(ax, errors, estimators, "horizontal", [COLORS[each] for each in estimators])
        make_logarithmic(ax, "x")
        ax.set_xlabel(label)
        ax.grid(axis="x")
    axes[0].set_yticks(range(len(rows)), rows)
    axes[0].set_ylim(len(rows) - 0.5, -0.5)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    return figure
