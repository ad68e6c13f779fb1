"""Prints a Markdown table: error against the truth of calibrations from nothing, on synthetic drives.

python tests/benchmarks/accuracy.py --seeds 10 --frames 10
"""

from __future__ import annotations

import argparse
import platform
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from semcal_cli.drive import read_drive
from semcal_cli.formats import read_transform
from semcal_cli.metrics import compare_poses
from semcal_cli.pipeline import Run
from semcal_cli.synthesis import synthesize
from semcal_cli.synthesis_config import SynthConfig


@dataclass(frozen=True)
class Row:
    seed: int
    initial_deg: float
    initial_cm: float
    refined_deg: float
    refined_cm: float
    seconds: float
    status: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--label-noise", type=float, default=0.0)
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    print(
        f"{arguments.frames} frames a drive, {100 * arguments.label_noise:.0f} % wrong labels, {platform.processor()}"
    )
    print("| seed | initial | refined | status | seconds |\n|---|---|---|---|---|")
    rows = []
    for seed in seeds:
        rows.append(measure(SynthConfig(arguments.frames, seed, label_noise=arguments.label_noise)))
        print(line(rows[-1]), flush=True)
    for name, statistic in (("median", np.median), ("worst", np.max)):
        deg, cm = (statistic([getattr(row, key) for row in rows]) for key in ("refined_deg", "refined_cm"))
        print(f"| {name} | | {deg:.4f} deg, {cm:.2f} cm | | |")


def measure(config: SynthConfig) -> Row:
    """Synthesise a drive, calibrate it from nothing, compare with its truth."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive"
        synthesize(config, path)
        start = perf_counter()
        calibration = Run(read_drive(path), seed=0).calibrate(Path(folder))
        seconds = perf_counter() - start
        truth = read_transform(path)
    initial = compare_poses(np.array(calibration.stages["initial"].T_camera_lidar), truth)
    refined = compare_poses(calibration.pose, truth)
    return Row(
        config.seed,
        initial.rotation_deg,
        initial.camera_center_cm,
        refined.rotation_deg,
        refined.camera_center_cm,
        seconds,
        calibration.status,
    )


def line(row: Row) -> str:
    return (
        f"| {row.seed} | {row.initial_deg:.2f} deg, {row.initial_cm:.0f} cm | "
        f"{row.refined_deg:.4f} deg, {row.refined_cm:.2f} cm | {row.status} | {row.seconds:.1f} |"
    )


if __name__ == "__main__":
    main()
