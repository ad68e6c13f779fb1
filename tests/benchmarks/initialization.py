"""Prints Markdown tables: the initial calibration against the truth, over mountings, sensors, lenses and label noise.

python tests/benchmarks/initialization.py --pool DIR --first-seed 2000 --seeds 20

Each drive is used with all of its frames, and with each frame alone. Drives and results are kept in DIR, so that a run
that was stopped goes on where it was; results of another commit are measured anew.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from benchmark import script, table

from semcal_cli.checks.other_mounting import MIN_RUNNER_UP_MARGIN
from semcal_cli.config import AlignmentConfig, InitializationConfig
from semcal_cli.estimation.search.mounting_search import search_mountings
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.measured import commit
from semcal_cli.experiments.summary import group_results
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.many.batch.pace import Pace
from semcal_cli.observations.reading import load_observations

RIGHT_DEG = 5.0
"""The refinement holds from here."""
CONDITIONS: dict[str, dict[str, object]] = {
    "64 channels, 90-degree lens, any azimuth": {},
    "camera forward": {"camera_azimuth_deg": 0.0},
    "camera left": {"camera_azimuth_deg": 90.0},
    "camera right": {"camera_azimuth_deg": -90.0},
    "camera backward": {"camera_azimuth_deg": 180.0},
    "32 channels": {"channels": 32},
    "16 channels": {"channels": 16},
    "rosette, no lidar block": {"pattern": "rosette"},
    "70-degree lens": {"hfov_deg": 70.0},
    "35-degree lens": {"lens": "narrow"},
    "100-degree lens": {"lens": "wide"},
    "20 % wrong labels on both sides": {"label_noise": 0.2},
    "50 % wrong labels on both sides": {"label_noise": 0.5},
    "disjoint ontologies": {"ontology": "disjoint"},
    "baseline 0.1 m": {"baseline_m": 0.1},
    "baseline 0.5 m": {"baseline_m": 0.5},
    "baseline 1 m": {"baseline_m": 1.0},
    "camera pitched 35 degrees up": {"camera_pitch_deg": 35.0},
    "camera pitched 35 degrees down": {"camera_pitch_deg": -35.0},
    "camera rolled 45 degrees, `--roll any`": {"camera_roll_deg": 45.0},
    "camera rolled 90 degrees, `--roll any`": {"camera_roll_deg": 90.0},
    "LiDAR tilted 20 degrees": {"lidar_tilt_deg": 20.0},
}
REGISTERED = InitializationConfig(alignment=AlignmentConfig(blocks_across=(), num_kept=()))
"""Stops at PnP."""
VARIANTS = {
    "exact": InitializationConfig(),
    "paper": InitializationConfig(zoom="paper"),
    "exact, as registered": REGISTERED,
    "paper, as registered": replace(REGISTERED, zoom="paper"),
}
COMPARED = (
    "64 channels, 90-degree lens, any azimuth",
    "35-degree lens",
    "100-degree lens",
    "50 % wrong labels on both sides",
    "camera pitched 35 degrees down",
)
NUM_COMPARED = 10
"""Conditions on which the variants are compared, and on how many seeds."""


@dataclass(frozen=True)
class Case:
    """A variant under a condition on the drive of one seed."""

    condition: str
    variant: str
    seed: int


@dataclass(frozen=True)
class Result:
    """One initial calibration."""

    condition: str
    seed: int
    variant: str
    frames: Sequence[int]
    rotation_deg: float
    camera_center_cm: float
    margin: float | None
    seconds: float

    def is_right(self) -> bool:
        return self.rotation_deg <= RIGHT_DEG

    def is_trusted(self) -> bool:
        return self.margin is None or self.margin >= MIN_RUNNER_UP_MARGIN


def cases(conditions: Sequence[str], seeds: range) -> list[Case]:
    return [
        Case(condition, variant, seed)
        for variant in VARIANTS
        for condition in conditions
        if variant == "exact" or condition in COMPARED
        for seed in (seeds if variant == "exact" else seeds[:NUM_COMPARED])
    ]


def run(pool: Pool, size: dict[str, Any], case: Case) -> list[Result]:
    """Use all frames together, then each alone."""
    rig = re.sub(r"\W+", "_", case.condition)
    drive, truth = pool.read(rig, {**size, **CONDITIONS[case.condition]}, case.seed)
    observations, config = load_observations(drive), VARIANTS[case.variant]
    if "--roll any" in case.condition:
        config = replace(config, max_roll_deg=180.0)
    results = []
    every = tuple(range(observations.num_frames))
    for frames in (every, *((frame,) for frame in every)):
        chosen, start = observations.of_frames(frames), perf_counter()
        found = search_mountings(chosen, config, seed=0)
        seconds, error = perf_counter() - start, compare_poses(found.T_camera_lidar, truth)
        figures = error.rotation_deg, error.camera_center_cm, found.runner_up_margin, seconds
        results.append(Result(case.condition, case.seed, case.variant, frames, *figures))
    return results


def share(flags: Iterable[bool]) -> str:
    values = list(flags)
    return f"{sum(values)} of {len(values)}"


def median_error(results: Sequence[Result]) -> str:
    """Median rotation and camera-centre errors."""
    if not results:
        return "none"
    deg, cm = (
        np.median([getattr(r, name) for r in results]) for name in ("rotation_deg", "camera_center_cm")
    )
    return f"{deg:.2f} deg, {cm:.1f} cm"


def main(
    *,
    pool: Path,
    seeds: int = 20,
    first_seed: int = 2000,
    jobs: int = 2,
    only: tuple[str, ...] = tuple(CONDITIONS),
    width: int = 1280,
    frames: int = 4,
) -> Iterator[str]:
    """Print both tables, of all conditions or some, on drives of so many frames."""
    size = {"num_frames": frames, "width": width, "height": width * 9 // 16}
    folder = pool / f"results_{re.sub(r'[^0-9a-z.]+', '_', commit())}"
    chosen = cases(only, range(first_seed, first_seed + seeds))
    experiment = Experiment(
        folder.name, folder, chosen, partial(run, Pool(pool), size), Result, partial(Report, [], "")
    )
    found = experiment.run_cases(jobs, Pace(len(chosen), jobs))
    groups = group_results(found, lambda r: (r.condition, r.variant, len(r.frames)))

    def of(condition: str, variant: str, num_frames: int) -> list[Result]:
        return groups.get((condition, variant, num_frames), [])

    header = f" | {frames} frames: right | not trusted | median error | 1 frame: right | wrong and trusted"
    rows: list[tuple[object, ...]] = []
    for condition in (name for name in CONDITIONS if name in only):
        pooled, single = of(condition, "exact", frames), of(condition, "exact", 1)
        right = share(r.is_right() for r in pooled), share(not r.is_trusted() for r in pooled)
        alone = (
            share(r.is_right() for r in single),
            share(r.is_trusted() and not r.is_right() for r in single),
            share(r.is_right() and not r.is_trusted() for r in single),
        )
        rows.append((condition, *right, median_error(pooled), *alone))
    yield from table(f"{header} | right and not trusted", rows)
    yield ""
    rows = []
    for condition in (name for name in COMPARED if name in only):
        for num_frames in (frames, 1):
            parts = [of(condition, variant, num_frames) for variant in VARIANTS]
            few = [[r for r in part if r.seed < first_seed + NUM_COMPARED] for part in parts]
            cells = [f"{share(r.is_right() for r in part)}, {median_error(part)}" for part in few]
            rows.append((condition, num_frames, *cells))
    yield from table(f" | frames | {' | '.join(VARIANTS)}", rows)


if __name__ == "__main__":
    script(main)
