"""Error against the truth, over sensors, lenses, labels and starts, with both estimators."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

from semcal_cli.drive import read_drive
from semcal_cli.experiments.runner import Pool, Result
from semcal_cli.formats import read_transform
from semcal_cli.initialization import InitializationConfig
from semcal_cli.label_noise import as_by_a_network, with_disjoint_ids, with_wrong_labels
from semcal_cli.metrics import compare_poses
from semcal_cli.observations import Observations, mend, read_observations
from semcal_cli.pipeline import Given, RefinementConfig, Run
from semcal_cli.poses import Pose, camera_center
from semcal_cli.refinement import Estimator

Degrade = Callable[[Observations, np.random.Generator], Observations]

START_SEEDS = 2.5
"""Rows that start off the truth have so many times the seeds of the others."""


@dataclass(frozen=True)
class Row:
    """A case of the table."""

    rig: str = "default"
    num_pairs: int = 20
    degrade: Degrade = lambda observations, rng: observations
    start_deg: float | None = None
    """Start so far from the truth, about a random axis, and half a metre from it; from nothing if None."""


RIGS: dict[str, dict[str, object]] = {
    "default": {},
    "backward": {"camera_azimuth_deg": 180.0},
    "16_channels": {"channels": 16},
    "rosette": {"pattern": "rosette"},
    "narrow": {"lens": "narrow"},
    "wide": {"lens": "wide"},
}

START_M = 0.5


def _wrong(share: float) -> Degrade:
    return lambda observations, rng: with_wrong_labels(observations, share, rng)


ROWS: dict[str, Row] = {
    "clean labels, 20 pairs": Row(),
    "clean labels, 1 pair": Row(num_pairs=1),
    "20 % wrong labels on both sides": Row(degrade=_wrong(0.2)),
    "50 % wrong labels on both sides": Row(degrade=_wrong(0.5)),
    "camera backward": Row(rig="backward"),
    "16 channels": Row(rig="16_channels"),
    "rosette pattern": Row(rig="rosette"),
    "35-degree lens": Row(rig="narrow"),
    "100-degree lens": Row(rig="wide"),
    "disjoint ontologies": Row(degrade=with_disjoint_ids),
    "network-like labels": Row(degrade=as_by_a_network),
    "start 10 degrees and 0.5 m off": Row(start_deg=10.0),
    "start 20 degrees and 0.5 m off": Row(start_deg=20.0),
}


@dataclass(frozen=True)
class Case:
    """A row on one seed."""

    row: str
    seed: int


def cases(seeds: range) -> list[Case]:
    """Give all cases, seed by seed, so that a run that is stopped has all rows."""
    more = range(seeds.start, seeds.start + round(START_SEEDS * len(seeds)))
    return [
        Case(row, seed)
        for seed in more
        for row, spec in ROWS.items()
        if seed in seeds or spec.start_deg is not None
    ]


def run(pool: Pool, estimators: Sequence[Estimator], case: Case) -> list[Result]:
    """Calibrate from nothing, or from a bad start, with each estimator."""
    row = ROWS[case.row]
    path = pool.drive(row.rig, RIGS[row.rig], case.seed)
    drive, truth = read_drive(path), read_transform(path)
    if row.num_pairs < len(drive.frames):
        chosen = case.seed % len(drive.frames)
        drive = drive.model_copy(update={"frames": drive.frames[chosen : chosen + row.num_pairs]})
    rng = np.random.default_rng((case.seed, list(ROWS).index(case.row)))
    observations = mend(row.degrade(read_observations(drive), rng))
    given = None if row.start_deg is None else Given(off(truth, row.start_deg, START_M, rng), "off")
    begun = Run(drive, seed=0)
    T_init = begun.initialize(observations, InitializationConfig(), given)[0].T_camera_lidar
    return [
        _refine(case, copy.deepcopy(begun), observations, T_init, truth, estimator)
        for estimator in estimators
    ]


def off(truth: Pose, angle_deg: float, distance_m: float, rng: np.random.Generator) -> Pose:
    """Turn a camera about a random axis and move its centre in a random direction."""
    axis, direction = rng.standard_normal((2, 3))
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle_deg, degrees=True).as_matrix()
    T = np.eye(4)
    T[:3, :3] = turn @ truth[:3, :3]
    T[:3, 3] = -T[:3, :3] @ (camera_center(truth) + direction / np.linalg.norm(direction) * distance_m)
    return T


def _refine(
    case: Case, run: Run, observations: Observations, T_init: Pose, truth: Pose, estimator: Estimator
) -> Result:
    start = perf_counter()
    T_camera_lidar = run.refine(observations, T_init, RefinementConfig(estimator))
    seconds = perf_counter() - start
    error, initial = compare_poses(T_camera_lidar, truth), compare_poses(T_init, truth)
    return Result(
        row=case.row,
        seed=case.seed,
        estimator=estimator,
        rotation_deg=error.rotation_deg,
        camera_center_cm=error.camera_center_cm,
        status=run.result(observations, T_camera_lidar, Path()).status,
        initial_deg=initial.rotation_deg,
        initial_cm=initial.camera_center_cm,
        refine_s=seconds,
    )


def make_run(folder: Path, estimators: Sequence[Estimator]) -> Callable[[Case], list[Result]]:
    """Give what runs one case, on the pool in a folder; it can be sent to other processes."""
    return partial(run, Pool(folder), tuple(estimators))
