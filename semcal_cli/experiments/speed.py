"""Time and memory of whole processes, and the ratio to the same refinement in plain torch, in one run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from semcal_cli.documents import document_text, read_document, write_text
from semcal_cli.drive import DRIVE_FILE
from semcal_cli.errors import CalibrationError
from semcal_cli.experiments.accuracy import off
from semcal_cli.experiments.runner import machine
from semcal_cli.formats import read_transform
from semcal_cli.metrics import compare_poses
from semcal_cli.poses import Pose
from semcal_cli.synthesis import synthesize
from semcal_cli.synthesis_config import SynthConfig

SEED = 10_000
LONG_DRIVE = 1000
MAKE_FRAMES = 70
"""Frames that are rendered; the long drive names them again and again."""
START = 5.0, 0.3
"""Degrees and metres off the truth, for what only refines."""
SEMCAL = [sys.executable, "-c", "from semcal_cli.cli import main; main()"]


@dataclass(frozen=True)
class Timing:
    """A process, run several times."""

    name: str
    num_pairs: int
    seconds: float
    """Median."""
    peak_gib: float
    rotation_deg: float
    camera_center_cm: float
    against_plain_torch: float | None
    """How many times faster than the plain-torch process of the same estimator and pairs."""


def measure(
    folder: Path, repeats: int, plain_torch: Path | None, progress: Callable[[str], None]
) -> list[Timing]:
    """Time everything on synthetic drives in a folder.

    Args:
        folder: Where drives and results go.
        repeats: Runs of each process; rivals take turns, so that a busy machine slows both.
        plain_torch: The script to compare with, `tests/benchmarks/plain_torch.py` of a clone, or None.
        progress: Called with what is about to run.
    """
    drives = {count: _make_drive(folder, count) for count in (1, 20, MAKE_FRAMES, LONG_DRIVE)}
    truth = read_transform(drives[1])
    start = _make_start(drives[1], off(truth, *START, np.random.default_rng(0)))
    output = folder / "out.yaml"
    commands: dict[tuple[str, int], list[str]] = {}
    for count, drive in drives.items():
        estimators = ("exact", "mine") if count <= MAKE_FRAMES else ("exact",)
        for estimator in estimators:
            options = ["calibrate", str(drive), "--estimator", estimator, "-o", str(output), "-q"]
            commands[f"calibrate, {estimator}", count] = [*SEMCAL, *options]
    for estimator in ("exact", "mine"):
        options = [
            "refine",
            str(drives[20]),
            "--estimator",
            estimator,
            "--init",
            str(start),
            "-o",
            str(output),
            "-q",
        ]
        commands[f"refine, {estimator}", 20] = [*SEMCAL, *options]
        if plain_torch is not None:
            script = [str(plain_torch), str(drives[20]), str(start), "--estimator", estimator]
            commands[f"plain torch, {estimator}", 20] = [
                sys.executable,
                *script,
                "-o",
                str(folder / "out.npy"),
            ]
    runs: dict[tuple[str, int], list[tuple[float, float, float, float]]] = {key: [] for key in commands}
    for _ in range(repeats):
        for key, command in commands.items():
            progress(f"{key[0]}, {key[1]} pairs")
            seconds, peak_gib = run_process(command)
            T = np.load(folder / "out.npy") if key[0].startswith("plain") else read_transform(output)
            error = compare_poses(T, truth)
            runs[key].append((seconds, peak_gib, error.rotation_deg, error.camera_center_cm))
    medians = {key: float(np.median([run[0] for run in found])) for key, found in runs.items()}
    timings = []
    for (name, count), found in runs.items():
        plain = (
            medians.get((name.replace("refine", "plain torch"), count)) if name.startswith("refine") else None
        )
        ratio = None if plain is None else plain / medians[name, count]
        _, peaks, degrees, centimetres = np.max(found, axis=0)
        timings.append(
            Timing(name, count, medians[name, count], float(peaks), float(degrees), float(centimetres), ratio)
        )
    document = {"experiment": "speed", "machine": machine(), "rows": [asdict(timing) for timing in timings]}
    write_text(json.dumps(document, indent=2) + "\n", folder / "summary.json")
    write_text(markdown(timings), folder / "table.md")
    return timings


def run_process(command: list[str]) -> tuple[float, float]:
    """Run a process, and tell its wall time in seconds and its peak memory in GiB.

    Raises:
        CalibrationError: it failed.
    """
    begin = perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    with process.stderr as errors:
        complaint = errors.read()
    # Not `wait`, which does not tell the memory.
    _, status, usage = os.wait4(process.pid, 0)
    code = process.returncode = os.waitstatus_to_exitcode(status)
    if code not in (0, 3):
        raise CalibrationError(f"{' '.join(command)}: exit code {code}: {' '.join(complaint.split()[-30:])}")
    return perf_counter() - begin, usage.ru_maxrss / 2**20


def markdown(timings: list[Timing]) -> str:
    """Give the table."""
    lines = [
        "| process | pairs | seconds | peak memory, GiB | error | times faster than plain torch |",
        "|---|---|---|---|---|---|",
    ]
    for t in timings:
        ratio = "" if t.against_plain_torch is None else f"{t.against_plain_torch:.1f}"
        error = f"{t.rotation_deg:.4f} deg, {t.camera_center_cm:.2f} cm"
        lines.append(
            f"| {t.name} | {t.num_pairs:,} | {t.seconds:.2f} | {t.peak_gib:.2f} | {error} | {ratio} |"
        )
    return "\n".join(lines) + "\n"


def _make_drive(folder: Path, count: int) -> Path:
    """Give a drive of so many pairs: the first of one that is rendered once, or all of it again and again."""
    rendered = folder / "drive"
    if not (rendered / DRIVE_FILE).exists():
        synthesize(SynthConfig(num_frames=MAKE_FRAMES, seed=SEED), rendered, force=True)
    document = read_document(rendered / DRIVE_FILE)
    frames = document["frames"]
    document["frames"] = [frames[index % len(frames)] for index in range(count)]
    path = rendered / f"drive_{count}.yaml"
    write_text(document_text(document, "yaml"), path)
    return path


def _make_start(drive: Path, T_camera_lidar: Pose) -> Path:
    """Write a drive whose reference is a pose to start at."""
    path = drive.with_name("start.yaml")
    document = read_document(drive) | {"T_camera_lidar": T_camera_lidar.tolist()}
    write_text(document_text(document, "yaml"), path)
    return path
