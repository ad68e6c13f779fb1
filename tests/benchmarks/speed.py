"""Measures time and memory of whole processes, and compares the refinement with the same one in plain torch.

    python tests/benchmarks/speed.py --plain-torch

Needs an idle machine, and takes about three minutes per repeat. Writes results.csv, summary.json and table.md to a
folder in `semcal_experiments`, where a stopped run resumes. `--frames` is the number of rendered frames, which is also
the largest number of pairs besides 1,000.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from benchmark import OUTPUT, SEMCAL, KeptTable, run_experiment, run_process, script
from laboratory.rates import median_and_worst

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import check_torch
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.summary import (
    NUMBER,
    Column,
    common,
    digits,
    group_results,
    measure_of,
    median,
)
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.synthetic.synthesis import synthesize

ESTIMATORS = ("exact", "mine")
SEED = 10_000
LONG_DRIVE = 1000
MAKE_FRAMES = 70
"""Number of rendered frames. The long drive repeats them; each repetition is read and processed."""
STREET = SynthConfig(num_frames=MAKE_FRAMES, seed=SEED)
Command = Literal["calibrate", "refine"]
COMMANDS = get_args(Command)
PLAIN_TORCH = "plain torch"
"""Name of the script that semcal is compared with."""
PLAIN_TORCH_SCRIPT = Path(__file__).with_name("plain_torch.py")
START = 5.0, 0.3
"""Distance of the start from the truth in degrees and metres, for processes that only refine."""


@dataclass(frozen=True)
class Case:
    """One run of a process on a drive."""

    name: str
    """Command and estimator, separated by a comma."""
    num_pairs: int
    """Number of frames of the drive."""
    repeat: int
    """Number of the run, counted from 0."""


@dataclass(frozen=True)
class Timing:
    """Time, memory and error of one run of a process."""

    name: str
    num_pairs: int
    seconds: float
    """Wall-clock time of the whole process."""
    peak_gib: float
    """Largest resident memory."""
    rotation_deg: float
    """Rotation error."""
    camera_center_cm: float
    """Distance of the camera from its true place."""


def cases(
    repeats: int, num_frames: int = MAKE_FRAMES, commands: Sequence[str] = COMMANDS, *, with_torch: bool
) -> list[Case]:
    """List all runs; rivals take turns, so that a busy machine slows both."""
    few = min(20, num_frames)
    processes: list[tuple[str, int]] = []
    if "calibrate" in commands:
        counts = sorted({1, few, num_frames})
        processes += [(f"calibrate, {estimator}", count) for count in counts for estimator in ESTIMATORS]
        processes.append(("calibrate, exact", LONG_DRIVE))
    for estimator in ESTIMATORS if "refine" in commands else ():
        rivals = ("refine", *((PLAIN_TORCH,) if with_torch else ()))
        processes += [(f"{rival}, {estimator}", few) for rival in rivals]
    return [Case(*process, repeat) for repeat in range(repeats) for process in processes]


def run(folder: Path, street: SynthConfig, case: Case) -> list[Timing]:
    """Run a process on a drive in a folder and compare its pose with the truth."""
    drive = make_drive(folder, case.num_pairs, street)
    truth = read_transform(drive)
    command, estimator = case.name.split(", ")
    T_start = displace(truth, *START, np.random.default_rng(0))
    start = _write(drive.with_name("start.yaml"), read_document(drive) | {"T_camera_lidar": T_start.tolist()})
    output = folder / ("out.npy" if command == PLAIN_TORCH else "out.yaml")
    options = [str(drive), "--estimator", estimator, "-o", str(output)]
    if command == "calibrate":
        process = [*SEMCAL, command, *options, "-q"]
    elif command == "refine":
        # The rival does not polish; neither does semcal here.
        process = [*SEMCAL, command, *options, "-q", "--no-polish", "--init", str(start)]
    else:
        process = [sys.executable, str(PLAIN_TORCH_SCRIPT), *options, "--init", str(start)]
    ended = run_process(process)
    T = np.load(output) if command == PLAIN_TORCH else read_transform(output)
    error = compare_poses(T, truth)
    errors = error.rotation_deg, error.camera_center_cm
    return [Timing(case.name, case.num_pairs, ended.seconds, ended.peak_gib, *errors)]


def report(timings: Sequence[Timing]) -> Report:
    """Summarise the runs of each process, and compare refinements with plain torch of the same estimator and pairs."""
    groups = group_results(timings, lambda timing: (timing.name, timing.num_pairs))
    medians = {key: measure_of("seconds", median)(found) for key, found in groups.items()}

    def against_plain_torch(found: Sequence[Timing]) -> float | None:
        name, num_pairs = found[0].name, found[0].num_pairs
        plain = medians.get((name.replace("refine", PLAIN_TORCH), num_pairs)) if "refine" in name else None
        return None if plain is None else plain / medians[name, num_pairs]

    columns = (
        common("name", "process"),
        common("num_pairs", "pairs", "{:,}".format),
        NUMBER,
        Column("seconds: median, worst", {"seconds": measure_of("seconds", median_and_worst)}, digits(2)),
        Column("peak memory, GiB", {"peak_gib": measure_of("peak_gib", max)}, digits(2)),
        Column(
            "error",
            {
                "rotation_deg": measure_of("rotation_deg", max),
                "camera_center_cm": measure_of("camera_center_cm", max),
            },
            "{:.4f} deg, {:.2f} cm".format,
        ),
        Column("times faster than plain torch", {"against_plain_torch": against_plain_torch}, digits(1)),
    )
    return Report.of(timings, columns)


def make_drive(folder: Path, count: int, street: SynthConfig = STREET) -> Path:
    """Make a drive of `count` pairs.

    Frames are rendered once; a shorter drive takes the first of them, a longer one repeats them.
    """
    rendered = folder / "drive"
    if not (rendered / DRIVE_FILE).exists():
        synthesize(street, rendered, force=True)
    document = read_document(rendered / DRIVE_FILE)
    frames = [document["frames"][index % len(document["frames"])] for index in range(count)]
    return _write(rendered / f"drive_{count}.yaml", document | {"frames": frames})


def _write(path: Path, document: dict[str, object]) -> Path:
    write_text(document_text(document, "yaml"), path)
    return path


def main(
    *,
    repeats: int = 3,
    plain_torch: bool = False,
    only: tuple[Command, ...] = COMMANDS,
    frames: int = STREET.num_frames,
    width: int = STREET.width,
    height: int = STREET.height,
    output: Path = OUTPUT,
) -> KeptTable:
    """Time commands, beside the script or not; drives of another size have their own folder."""
    check_torch("--estimator mine")
    street = replace(STREET, num_frames=frames, width=width, height=height)
    folder = output / ("speed" if street == STREET else f"speed_{frames}_{width}x{height}")
    listed = cases(repeats, frames, only, with_torch=plain_torch)
    return run_experiment(Experiment("speed", folder, listed, partial(run, folder, street), Timing, report))


if __name__ == "__main__":
    script(main)
