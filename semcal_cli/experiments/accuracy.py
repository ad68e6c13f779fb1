"""Error against the truth, over sensors, lenses, labels and starts, with both estimators."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Literal

import numpy as np

from semcal_cli.config import (
    EDGE_BAND_PX,
    CalibrationConfig,
    Estimator,
    InitializationConfig,
    RefinementConfig,
)
from semcal_cli.drive.cues import load_cues
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import mend, read_observations
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.distribution import (
    ERROR_COLUMNS,
    MEASURES,
    draw_groups,
    error_cells,
    error_distributions,
    errors_in_groups,
    grouped,
)
from semcal_cli.experiments.plot_style import ACCENT, ORANGE, make_logarithmic
from semcal_cli.experiments.pool import Pool
from semcal_cli.experiments.result_files import machine, markdown_table, write_results
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import displaced
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import assess, initialize, make_calibration, refine_and_polish
from semcal_cli.result.stage import StageResult
from semcal_cli.synthetic.label_noise import (
    as_by_a_network,
    with_disjoint_ontologies,
    with_ragged_things,
    with_wrong_labels,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Degrade = Callable[[Observations, np.random.Generator], Observations]

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


def _wrong(share: float) -> Degrade:
    return lambda observations, rng: with_wrong_labels(observations, share, rng)


def _ragged(grow_px: int) -> Degrade:
    return lambda observations, rng: with_ragged_things(observations, grow_px)


SEGMENT_START = 2.0, 0.2
"""Start of the rows of segments, degrees and metres off."""


def _segments(rig: str = "default", twice: float = 1.0) -> Row:
    return Row(rig, cue="segments", start=SEGMENT_START, right=(0.05 * twice, 1.5 * twice))


ROWS: dict[str, Row] = {
    "clean labels, 20 pairs": Row(right=(0.05, 1.2)),
    "clean labels, 1 pair": Row(num_pairs=1, right=(0.24, 7.5)),
    "20 % wrong labels on both sides": Row(degrade=_wrong(0.2), right=(0.18, 3.6)),
    "50 % wrong labels on both sides": Row(degrade=_wrong(0.5), right=(0.45, 9.0)),
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


@dataclass(frozen=True)
class Case:
    """A row on one seed."""

    row: str
    """Key of `ROWS`."""
    seed: int
    """Seed of the drive."""


def cases(seeds: range, rows: Sequence[str] = tuple(ROWS)) -> list[Case]:
    """List the cases of some rows, seed by seed, so that a stopped run has results of all rows."""
    more = range(seeds.start, seeds.start + round(START_SEEDS * len(seeds)))
    return [Case(row, seed) for seed in more for row in rows if seed in seeds or ROWS[row].start is not None]


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
class Experiment:
    """The settings shared by all cases; a call runs one case. It can be pickled for other processes."""

    pool: Pool
    estimators: tuple[Estimator, ...]
    edge_band_px: int = EDGE_BAND_PX

    def __call__(self, case: Case) -> list[Result]:
        """Calibrate without a guess, or from a wrong start, with each estimator."""
        row = ROWS[case.row]
        drive, truth = self.pool.read(row.rig, RIGS[row.rig], case.seed)
        if row.num_pairs < len(drive.frames):
            chosen = case.seed % len(drive.frames)
            drive = drive.model_copy(update={"frames": drive.frames[chosen : chosen + row.num_pairs]})
        rng = np.random.default_rng((case.seed, list(ROWS).index(case.row)))
        data = _load(drive, row, rng)
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
            stages = assess(data, refine_and_polish(data, initial, config), config)
            calibration = make_calibration(data, stages, CalibrationConfig(refinement=config))
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


@dataclass(frozen=True)
class Summary:
    """The distribution of errors over the seeds of a row."""

    row: str
    """Key of `ROWS`."""
    estimator: str
    """Estimator that refined."""
    n: int
    """Number of calibrations."""
    rotation_deg: tuple[float, float, float]
    """Median, 95 % quantile and worst."""
    camera_center_cm: tuple[float, float, float]
    num_right: int
    """Number of results within the row's limits."""
    num_not_trusted: int
    """Number that the calibration itself did not trust."""
    num_missed: int
    """Number of wrong results that are not reported as such."""
    num_failed: int
    """Number that gave no pose."""
    refine_s: float
    """Median time in seconds from the initial pose to the end."""


def summarise(results: Iterable[Result]) -> list[Summary]:
    """Summarise the results of each row and estimator, in the order of the results."""
    return [
        Summary(
            row,
            estimator,
            len(found),
            *error_distributions(found),
            sum(r.is_right for r in found),
            sum(r.status == "not_trusted" for r in found),
            sum(r.is_missed for r in found),
            sum(not math.isfinite(r.rotation_deg) for r in found),
            float(np.median([r.refine_s for r in found])),
        )
        for (row, estimator), found in grouped(results, lambda r: (r.row, r.estimator)).items()
    ]


def markdown(summaries: Sequence[Summary]) -> str:
    """Format the table."""
    header = f"| | estimator | n | {ERROR_COLUMNS} | right | not trusted | wrong, not said | failed | refinement, s |"
    rows = [
        (
            *(s.row, s.estimator, s.n, *error_cells(s)),
            *(s.num_right, s.num_not_trusted, s.num_missed, s.num_failed, f"{s.refine_s:.1f}"),
        )
        for s in summaries
    ]
    return markdown_table(header, rows)


def write_accuracy(results: Sequence[Result], num_jobs: int, folder: Path) -> str:
    """Write CSV, JSON, table and plot into a folder, and return the table."""
    summaries = summarise(results)
    table = markdown(summaries)
    document = {"experiment": "accuracy", "machine": machine(), "jobs": num_jobs}
    write_results(document, results, summaries, table, lambda: _plot(results), folder)
    return table


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
