"""Prints Markdown tables: the initial calibration against the truth, over mountings, sensors, lenses and label noise.

python tests/benchmarks/initialization.py --pool DIR --first-seed 2000 --seeds 20

Each drive is used with all of its frames, and with each frame alone. Drives and results are kept in DIR, so that a run
that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from semcal_cli.config import AlignmentConfig, InitializationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.reading import load_observations
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.runner import run_cases
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.initialization.search import MIN_RUNNER_UP_MARGIN, search_mountings
from semcal_cli.synthetic.synthesis import synthesize

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


ANY_ROLL = [name for name in CONDITIONS if "--roll any" in name]

REGISTERED = InitializationConfig(alignment=AlignmentConfig(blocks_across=(), num_kept=()))
"""Stops at PnP."""
VARIANTS = {
    "exact": InitializationConfig(),
    "paper": InitializationConfig(zoom="paper"),
    "exact, as registered": REGISTERED,
    "paper, as registered": replace(REGISTERED, zoom="paper"),
}
COMPARED = [
    "64 channels, 90-degree lens, any azimuth",
    "35-degree lens",
    "100-degree lens",
    "50 % wrong labels on both sides",
    "camera pitched 35 degrees down",
]
"""Conditions on which the variants are compared ..."""
NUM_COMPARED = 10
"""... on so many seeds."""


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

    @property
    def is_right(self) -> bool:
        return self.rotation_deg <= RIGHT_DEG

    @property
    def is_trusted(self) -> bool:
        return self.margin is None or self.margin >= MIN_RUNNER_UP_MARGIN


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pool", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=2000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--only", action="append", choices=list(CONDITIONS), help="This condition; may be repeated."
    )
    parser.add_argument("--width", type=int, default=1280, help="Columns of pictures that are made, 16 to 9.")
    parser.add_argument("--frames", type=int, default=4, help="Frames of drives that are made.")
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    conditions = arguments.only or list(CONDITIONS)
    for condition in conditions:
        for seed in seeds:
            make_drive(arguments.pool, condition, seed, arguments.frames, arguments.width)
    chosen = cases(conditions, seeds)
    folder = arguments.pool / f"results_{revision()}"
    done = run_cases(chosen, partial(run_case, arguments.pool), Result, folder, arguments.jobs)
    print_conditions(done)
    print_variants(done)


def revision() -> str:
    """Name the version that is measured; there is none outside a clone."""
    described = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=Path(__file__).parent,
        check=False,
        capture_output=True,
        text=True,
    )
    return described.stdout.strip() or "unknown"


def cases(conditions: list[str], seeds: range) -> list[Case]:
    return [
        Case(condition, variant, seed)
        for variant in VARIANTS
        for condition in conditions
        if variant == "exact" or condition in COMPARED
        for seed in (seeds if variant == "exact" else seeds[:NUM_COMPARED])
    ]


def drive_path(pool: Path, condition: str, seed: int) -> Path:
    return pool / f"{condition.replace(' ', '_')}_{seed}"


def make_drive(pool: Path, condition: str, seed: int, num_frames: int, width: int) -> None:
    path = drive_path(pool, condition, seed)
    if not (path / "drive.yaml").exists():
        size = {"num_frames": num_frames, "width": width, "height": width * 9 // 16}
        synthesize(SynthConfig(**{**size, "seed": seed, **CONDITIONS[condition]}), path, force=True)
        for picture in (path / "images").iterdir():
            picture.unlink()


def run_case(pool: Path, case: Case) -> list[Result]:
    """Use all frames together, then each alone."""
    path = drive_path(pool, case.condition, case.seed)
    observations, truth = load_observations(read_drive(path)), read_transform(path)
    config = VARIANTS[case.variant]
    if case.condition in ANY_ROLL:
        config = replace(config, max_roll_deg=180.0)
    results = []
    every = tuple(range(observations.num_frames))
    for frames in (every, *((frame,) for frame in every)):
        chosen = observations.of_frames(frames)
        start = perf_counter()
        found = search_mountings(chosen, config, seed=0)
        seconds = perf_counter() - start
        error = compare_poses(found.T_camera_lidar, truth)
        results.append(
            Result(
                case.condition,
                case.seed,
                case.variant,
                frames,
                rotation_deg=error.rotation_deg,
                camera_center_cm=error.camera_center_cm,
                margin=found.runner_up_margin,
                seconds=seconds,
            )
        )
    return results


def print_conditions(results: list[Result]) -> None:
    num_frames = max(len(r.frames) for r in results)
    header = (
        f"| | {num_frames} frames: right | not trusted | median error | 1 frame: right | wrong and trusted | "
        "right and not trusted |"
    )
    rows = []
    for condition in [name for name in CONDITIONS if any(r.condition == name for r in results)]:
        pooled, single = (split(results, condition, "exact", n) for n in (num_frames, 1))
        of_pooled = share(r.is_right for r in pooled), share(not r.is_trusted for r in pooled)
        of_single = (
            share(r.is_right for r in single),
            share(r.is_trusted and not r.is_right for r in single),
            share(r.is_right and not r.is_trusted for r in single),
        )
        rows.append((condition, *of_pooled, median_error(pooled), *of_single))
    print(f"\n{markdown_table(header, rows)}", end="")


def print_variants(results: list[Result]) -> None:
    compared = [r for r in results if r.seed < min(r.seed for r in results) + NUM_COMPARED]
    rows = []
    for condition in [name for name in COMPARED if any(r.condition == name for r in compared)]:
        for num_frames in (max(len(r.frames) for r in results), 1):
            found = [split(compared, condition, variant, num_frames) for variant in VARIANTS]
            cells = [f"{share(r.is_right for r in part)}, {median_error(part)}" for part in found]
            rows.append((condition, num_frames, *cells))
    header = f"| | frames | {' | '.join(VARIANTS)} |"
    print(f"\n{markdown_table(header, rows)}", end="")


def split(results: list[Result], condition: str, variant: str, num_frames: int) -> list[Result]:
    chosen = [r for r in results if r.condition == condition and r.variant == variant]
    return [r for r in chosen if len(r.frames) == num_frames]


def share(flags: Iterator[bool]) -> str:
    values = list(flags)
    return f"{sum(values)} of {len(values)}"


def median_error(results: list[Result]) -> str:
    """Median rotation and camera-centre errors."""
    if not results:
        return "none"
    rotation = np.median([r.rotation_deg for r in results])
    center = np.median([r.camera_center_cm for r in results])
    return f"{rotation:.2f} deg, {center:.1f} cm"


if __name__ == "__main__":
    run_script(main)
