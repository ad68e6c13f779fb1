"""Compares calibrations with the truth, for sensors, lenses, labels and starts, with both estimators.

    python tests/benchmarks/accuracy.py [--seeds 20] [--row NAME] [--estimator exact]

Takes about two minutes per seed. Writes results.csv, summary.json and table.md to a folder in `semcal_experiments`,
where a stopped run resumes, and keeps its drives in a pool next to it, about 45 MB each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Literal, get_args

import numpy as np
from benchmark import OUTPUT, KeptTable, run_experiment, script
from laboratory.label_errors import imitate_network, with_disjoint_ontologies, with_ragged_things
from laboratory.rigs import RIGS, Case, Degrade, consecutive, row_cases, wrong

from semcal_cli.config import EDGE_BAND_PX, Estimator, InitializationConfig, RefinementConfig
from semcal_cli.drive.document import Drive
from semcal_cli.errors import SemcalError, check_torch
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.drives import Pool, calibrate_from
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.summary import ERRORS, NUMBER, Column, common, count, digits, measure_of, median
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.reading import read_observations, remove_speckle
from semcal_cli.pipeline import initialize

START_SEEDS = 2.5
"""Factor on the number of seeds for rows that start away from the truth."""


@dataclass(frozen=True)
class Row:
    """A row of the table: a rig, a change to its labels, and a start."""

    rig: str = "default"
    num_pairs: int = 20
    degrade: Degrade = lambda observations, rng: observations
    cue: Literal["labels", "segments"] = "labels"
    """The cue by which points and pixels are compared."""
    start: tuple[float, float] | None = None
    """Distance of the start from the truth, degrees about a random axis and metres; None without an initial guess."""
    right: tuple[float, float] = (0.06, 1.5)
    """Errors in degrees and centimetres within which a result is right; any other should be `not_trusted`."""


def _ragged(grow_px: int) -> Degrade:
    return lambda observations, rng: with_ragged_things(observations, grow_px)


SEGMENTS = Row(cue="segments", right=(0.05, 1.5))
SEGMENTS_OFF = replace(SEGMENTS, start=(2.0, 0.2))
HARDER_SEGMENTS = replace(SEGMENTS_OFF, right=(0.1, 3.0))
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
    "network-like labels": Row(degrade=imitate_network, right=(0.36, 7.5)),
    "things dilated by 2 px": Row(degrade=_ragged(2)),
    "things eroded by 2 px": Row(degrade=_ragged(-2)),
    "start 5 degrees and 1 m off": Row(start=(5.0, 1.0)),
    "start 10 degrees and 0.5 m off": Row(start=(10.0, 0.5)),
    "start 20 degrees and 0.5 m off": Row(start=(20.0, 0.5)),
    "segments, from nothing": SEGMENTS,
    "segments": SEGMENTS_OFF,
    "segments, network-like labels": replace(SEGMENTS_OFF, degrade=imitate_network, right=(0.15, 3.0)),
    "segments, 16 channels": replace(HARDER_SEGMENTS, rig="16_channels"),
    "segments, rosette pattern": replace(HARDER_SEGMENTS, rig="rosette"),
    "segments, 35-degree lens": replace(HARDER_SEGMENTS, rig="narrow"),
    "segments, 100-degree lens": replace(HARDER_SEGMENTS, rig="wide"),
}
"""Rows by name. Where the median has a goal, a result is right within three times that goal."""
RowName = Literal[tuple(ROWS)]


@dataclass(frozen=True)
class Result:
    """The error of one calibration against the truth."""

    row: str
    seed: int
    estimator: str
    rotation_deg: float = math.inf
    """Rotation error; infinite, like the other errors, if the calibration failed."""
    camera_center_cm: float = math.inf
    is_right: bool = False
    """Whether the errors are within the row's limits."""
    status: str = ""
    """Status of the calibration, or the reason why it failed."""
    initial_deg: float = math.inf
    initial_cm: float = math.inf
    refine_s: float = 0.0

    @property
    def is_missed(self) -> bool:
        """Whether the calibration is wrong but trusted."""
        return not self.is_right and math.isfinite(self.rotation_deg) and self.status != "not_trusted"


def cases(seeds: range, rows: Sequence[str] = ()) -> list[Case]:
    """List the cases of some rows, or of all, seed by seed; those that start away from the truth have more seeds."""
    more = range(seeds.start, seeds.start + round(START_SEEDS * len(seeds)))
    found = row_cases(rows or ROWS, more)
    return [case for case in found if case.seed in seeds or ROWS[case.row].start is not None]


def run(pool: Pool, estimators: Sequence[Estimator], edge_band_px: int, case: Case) -> list[Result]:
    """Calibrate with each estimator, from nothing or from a wrong start, and compare with the truth."""
    row, rng = ROWS[case.row], case.rng(ROWS)
    drive, truth = pool.read(row.rig, RIGS[row.rig], case.seed)
    data = _load(consecutive(drive, row.num_pairs, case.seed), row, rng)
    initial_pose = None if row.start is None else InitialPose(displace(truth, *row.start, rng), "off")
    initial = None
    results = []
    for estimator in estimators:
        # MINE has no network for segments, which differ from frame to frame.
        if estimator != "exact" and row.cue != "labels":
            continue
        result = Result(case.row, case.seed, estimator)
        config = RefinementConfig(estimator, edge_band_px=edge_band_px)
        data = data.with_settings(config)
        try:
            initial = initial or initialize(data, InitializationConfig(), initial_pose=initial_pose)
            start = perf_counter()
            stages, calibration = calibrate_from(initial, data, config)
        except SemcalError as failure:
            results.append(replace(result, status=f"failed: {failure}"))
            continue
        error = compare_poses(stages.T_camera_lidar, truth)
        started = compare_poses(initial.T_camera_lidar, truth)
        result = replace(
            result,
            rotation_deg=error.rotation_deg,
            camera_center_cm=error.camera_center_cm,
            is_right=error.rotation_deg <= row.right[0] and error.camera_center_cm <= row.right[1],
            status=calibration.status,
            initial_deg=started.rotation_deg,
            initial_cm=started.camera_center_cm,
            refine_s=perf_counter() - start,
        )
        results.append(result)
    return results


def _load(drive: Drive, row: Row, rng: np.random.Generator) -> LoadedDrive:
    labelled = remove_speckle(row.degrade(read_observations(drive), rng))
    if row.cue == "labels":
        return LoadedDrive(drive, labelled)
    segments = load_cues(drive, (row.cue,), is_raw=True).with_images(labelled.images)
    names = labelled.image_class_names
    return LoadedDrive(drive, replace(segments, image_class_names=names), (row.cue,))


COLUMNS = (
    common("row", ""),
    common("estimator", "estimator"),
    NUMBER,
    *ERRORS,
    count("right", lambda result: result.is_right, "num_right"),
    count("not trusted", lambda result: result.status == "not_trusted", "num_not_trusted"),
    count("wrong, not reported", lambda result: result.is_missed, "num_missed"),
    count("failed", lambda result: not math.isfinite(result.rotation_deg), "num_failed"),
    Column("refinement, s", {"refine_s": measure_of("refine_s", median)}, digits(1)),
)


def main(
    *,
    seeds: int = 20,
    first_seed: int = 10_000,
    jobs: int = 1,
    estimator: tuple[Estimator, ...] = get_args(Estimator),
    row: tuple[RowName, ...] = (),
    edge_band: int = EDGE_BAND_PX,
    output: Path = OUTPUT,
) -> KeptTable:
    """Calibrate with some estimators, in all rows or some; each choice of settings has its own folder."""
    if "mine" in estimator:
        check_torch("--estimator mine")
    chosen = tuple(name for name in get_args(Estimator) if name in estimator)
    band = () if edge_band == EDGE_BAND_PX else (f"band{edge_band}",)
    name = "_".join(["accuracy", *(chosen if len(chosen) == 1 else ()), *band])
    measured = Experiment(
        "accuracy",
        output / name,
        cases(range(first_seed, first_seed + seeds), row),
        partial(run, Pool(output / "pool"), chosen, edge_band),
        Result,
        partial(Report.of, columns=COLUMNS),
    )
    return run_experiment(measured, jobs)


if __name__ == "__main__":
    script(main)
