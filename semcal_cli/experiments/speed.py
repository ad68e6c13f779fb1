"""Time and memory of whole processes, and the ratio to the same refinement in plain torch, in one run."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.experiments.distribution import draw_values
from semcal_cli.experiments.experiment import Experiment
from semcal_cli.experiments.plot_style import ACCENT, GREY, make_logarithmic
from semcal_cli.experiments.result_files import Report
from semcal_cli.experiments.summary import NUMBER, Column, common, digits, grouped, median, of
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.writing import write_text
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose, compare_poses
from semcal_cli.geometry.twists import displaced
from semcal_cli.synthetic.synthesis import synthesize

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ESTIMATORS = ("exact", "mine")
SEED = 10_000
LONG_DRIVE = 1000
MAKE_FRAMES = 70
"""Number of rendered frames; the long drive repeats them, and reads and processes each repetition."""
STREET = SynthConfig(num_frames=MAKE_FRAMES, seed=SEED)
COMMANDS = ("calibrate", "refine")
PLAIN_TORCH = "plain torch"
"""Name of the script that semcal is compared with."""
ROW_WIDTH = 0.6
"""Height of a row of the plot; rows are at a distance of one."""
START = 5.0, 0.3
"""Distance of the start from the truth in degrees and metres, for processes that only refine."""
SEMCAL = [
    sys.executable,
    "-c",
    "import sys; sys.path = list(filter(None, sys.path)); from semcal_cli.cli import main; main()",
]
"""The installed command, even if the working directory contains its source."""


@dataclass(frozen=True)
class Process:
    """A command on a drive."""

    name: str
    """Command and estimator, with a comma between them."""
    num_pairs: int
    """Number of frames of the drive."""


@dataclass(frozen=True)
class Case(Process):
    """A process, and which of its runs this is."""

    repeat: int
    """Number of the run, counted from 0."""


@dataclass(frozen=True)
class Timing(Process):
    """Time, memory and error of one run of a process."""

    seconds: float
    """Wall-clock time of the whole process."""
    peak_gib: float
    """Largest resident memory."""
    rotation_deg: float
    """Rotation error."""
    camera_center_cm: float
    """Distance of the camera from its true place."""


@dataclass(frozen=True)
class Runner:
    """Processes on synthetic drives in a folder; a call runs one."""

    folder: Path
    """Where drives and results go."""
    plain_torch: Path | None
    """Script to compare with, `tests/benchmarks/plain_torch.py` of a clone, or None."""
    street: SynthConfig = STREET
    """The rendered drive."""
    commands: Sequence[str] = COMMANDS
    """Commands that are timed; `refine` is compared with the script."""

    def cases(self, repeats: int) -> list[Case]:
        """List all runs; rivals take turns, so that a busy machine slows both."""
        num_frames = self.street.num_frames
        few = min(20, num_frames)
        processes: list[tuple[str, int]] = []
        if "calibrate" in self.commands:
            counts = sorted({1, few, num_frames})
            processes += [(f"calibrate, {estimator}", count) for count in counts for estimator in ESTIMATORS]
            processes.append(("calibrate, exact", LONG_DRIVE))
        for estimator in ESTIMATORS if "refine" in self.commands else ():
            processes.append((f"refine, {estimator}", few))
            if self.plain_torch is not None:
                processes.append((f"{PLAIN_TORCH}, {estimator}", few))
        return [Case(*process, repeat) for repeat in range(repeats) for process in processes]

    def __call__(self, case: Case) -> list[Timing]:
        """Run a process, and compare its pose with the truth."""
        drive = make_drive(self.folder, case.num_pairs, self.street)
        truth = read_transform(drive)
        command, estimator = case.name.split(", ")
        start = _make_start(drive, displaced(truth, *START, np.random.default_rng(0)))
        output = self.folder / ("out.npy" if command == PLAIN_TORCH else "out.yaml")
        options = [str(drive), "--estimator", estimator, "-o", str(output)]
        if command == "calibrate":
            process = [*SEMCAL, command, *options, "-q"]
        elif command == "refine":
            # The rival does not polish; neither does semcal here.
            process = [*SEMCAL, command, *options, "-q", "--no-polish", "--init", str(start)]
        else:
            process = [sys.executable, str(self.plain_torch), *options, "--init", str(start)]
        run = run_process(process)
        T = np.load(output) if command == PLAIN_TORCH else read_transform(output)
        error = compare_poses(T, truth)
        return [
            Timing(
                case.name,
                case.num_pairs,
                run.seconds,
                run.peak_gib,
                error.rotation_deg,
                error.camera_center_cm,
            )
        ]


def columns(timings: Sequence[Timing]) -> tuple[Column, ...]:
    """Columns of the table; the last one compares with the plain-torch process of the same estimator and pairs."""
    groups = grouped(timings, lambda timing: (timing.name, timing.num_pairs))
    medians = {key: of("seconds", median)(found) for key, found in groups.items()}

    def against_plain_torch(found: Sequence[Timing]) -> float | None:
        name, num_pairs = found[0].name, found[0].num_pairs
        plain = medians.get((name.replace("refine", PLAIN_TORCH), num_pairs)) if "refine" in name else None
        return None if plain is None else plain / medians[name, num_pairs]

    return (
        common("name", "process"),
        common("num_pairs", "pairs", "{:,}".format),
        NUMBER,
        Column(
            "seconds: median, worst", {"seconds": of("seconds", lambda s: (median(s), max(s)))}, digits(2)
        ),
        Column("peak memory, GiB", {"peak_gib": of("peak_gib", max)}, digits(2)),
        Column(
            "error",
            {"rotation_deg": of("rotation_deg", max), "camera_center_cm": of("camera_center_cm", max)},
            "{:.4f} deg, {:.2f} cm".format,
        ),
        Column("times faster than plain torch", {"against_plain_torch": against_plain_torch}, digits(1)),
    )


def report(timings: Sequence[Timing]) -> Report:
    """Sum up the runs of each process."""
    return Report.of(timings, columns(timings), lambda: _plot(timings))


def experiment(
    out: Path, repeats: int, street: SynthConfig, plain_torch: Path | None, commands: Sequence[str]
) -> Experiment[Case, Timing]:
    """Declare the experiment; drives of another size have a folder of their own.

    Args:
        out: Folder of all experiments.
        repeats: Number of runs of each process.
        street: The rendered drive.
        plain_torch: Script to compare with, or None.
        commands: Commands that are timed.

    Raises:
        InputError: there is no such script.
    """
    if plain_torch is not None and not plain_torch.is_file():
        raise InputError(f"{plain_torch}: found no such file, needed the script to compare with")
    of_size = "" if street == STREET else f"_{street.num_frames}_{street.width}x{street.height}"
    folder = out / f"speed{of_size}"
    run = Runner(folder, plain_torch and plain_torch.resolve(), street, commands)
    return Experiment("speed", folder, run.cases(repeats), run, Timing, report, has_jobs=False)


def _plot(timings: Sequence[Timing]) -> Figure:
    """Draw the seconds of each run of each process."""
    from matplotlib.figure import Figure

    rows = grouped(timings, lambda t: f"{t.name}, {t.num_pairs:,} {'pair' if t.num_pairs == 1 else 'pairs'}")
    figure = Figure(figsize=(9.0, 1.0 + 0.35 * len(rows)))
    axes = figure.subplots()
    for place, (name, found) in enumerate(rows.items()):
        color = GREY if name.startswith(PLAIN_TORCH) else ACCENT
        draw_values(axes, [t.seconds for t in found], place, ROW_WIDTH, color, "horizontal")
    axes.set_yticks(range(len(rows)), list(rows))
    make_logarithmic(axes, "x")
    axes.set_xlabel("whole process, seconds")
    axes.grid(axis="x")
    axes.set_ylim(len(rows) - 0.5, -0.5)
    return figure


class Run(NamedTuple):
    """A process that ended."""

    seconds: float
    """Wall time."""
    peak_gib: float
    """Largest resident memory."""
    messages: str
    """What it wrote to standard error."""


def run_process(command: list[str]) -> Run:
    """Run a process, and measure its time and memory.

    Until the process begins, Linux counts the memory of this one as its own: the peak is at least that.

    Raises:
        CalibrationError: the process failed.
    """
    begin = perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    with process.stderr as errors:
        messages = errors.read()
    # `wait` does not return the memory.
    _, status, usage = os.wait4(process.pid, 0)
    code = process.returncode = os.waitstatus_to_exitcode(status)
    if code not in (0, 3):
        raise CalibrationError(f"{' '.join(command)}: exit code {code}: {' '.join(messages.split()[-30:])}")
    return Run(perf_counter() - begin, usage.ru_maxrss / 2**20, messages)


def make_drive(folder: Path, count: int, street: SynthConfig = STREET) -> Path:
    """Make a drive of `count` pairs.

    Frames are rendered once; a shorter drive has the first of them, a longer one repeats all of them.
    """
    rendered = folder / "drive"
    if not (rendered / DRIVE_FILE).exists():
        synthesize(street, rendered, force=True)
    document = read_document(rendered / DRIVE_FILE)
    frames = document["frames"]
    document["frames"] = [frames[index % len(frames)] for index in range(count)]
    path = rendered / f"drive_{count}.yaml"
    write_text(document_text(document, "yaml"), path)
    return path


def _make_start(drive: Path, T_camera_lidar: Pose) -> Path:
    """Write a drive whose reference is the start pose."""
    path = drive.with_name("start.yaml")
    document = read_document(drive) | {"T_camera_lidar": T_camera_lidar.tolist()}
    write_text(document_text(document, "yaml"), path)
    return path
