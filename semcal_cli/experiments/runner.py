"""What experiments share: a pool of drives, results that survive being stopped, tables and plots."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

import numpy as np

from semcal_cli import _core
from semcal_cli.documents import write_bytes, write_text
from semcal_cli.drive import DRIVE_FILE
from semcal_cli.errors import InputError
from semcal_cli.synthesis import synthesize
from semcal_cli.synthesis_config import SynthConfig

POOL_FRAMES = 20
"""Frames of each drive in the pool, which experiments cut down."""


Case = TypeVar("Case")
"""What an experiment runs once; cases are told apart by their `repr`."""


@dataclass(frozen=True)
class Result:
    """One calibration against the truth."""

    row: str
    seed: int
    estimator: str
    rotation_deg: float
    camera_center_cm: float
    status: str
    initial_deg: float
    initial_cm: float
    refine_s: float


@dataclass(frozen=True)
class Pool:
    """Synthetic drives, one for each rig and seed, made when they are first needed."""

    folder: Path

    def drive(self, rig: str, changes: dict[str, object], seed: int) -> Path:
        """Give the drive of a rig, a `SynthConfig` with some changes."""
        path = self.folder / f"{rig}_{seed:06d}"
        if not (path / DRIVE_FILE).exists():
            config = replace(SynthConfig(num_frames=POOL_FRAMES, seed=seed), **changes)  # type: ignore[arg-type]
            synthesize(config, path, force=True)
            # Nothing computes on the pictures, which are most of the bytes.
            for picture in (path / "images").iterdir():
                picture.unlink()
        return path


def make_folder(out: Path, name: str) -> Path:
    """Make the folder of an experiment.

    Raises:
        InputError: it cannot be made.
    """
    folder = out / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (out / "pool").mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {(error.strerror or str(error)).lower()}") from None
    return folder


def run_cases(
    cases: Sequence[Case],
    run: Callable[[Case], list[Result]],
    folder: Path,
    num_jobs: int,
    progress: Callable[[int, int], None],
) -> list[Result]:
    """Run each case that has no results in `folder` yet; a run that was stopped goes on where it was.

    With several jobs, each computes on one thread.
    """
    file = folder / "results.jsonl"
    done = _read(file)
    missing = [case for case in cases if repr(case) not in done]
    progress(len(cases) - len(missing), len(cases))
    with (
        file.open("a") as out,
        ProcessPoolExecutor(num_jobs, initializer=_start, initargs=(num_jobs,)) as pool,
    ):
        for case, results in zip(missing, pool.map(run, missing), strict=True):
            done[repr(case)] = results
            line = {"case": repr(case), "version": version("semcal"), "results": [asdict(r) for r in results]}
            out.write(json.dumps(line) + "\n")
            out.flush()
            progress(sum(repr(case) in done for case in cases), len(cases))
    return [result for case in cases for result in done[repr(case)]]


def _start(num_jobs: int) -> None:
    if num_jobs > 1:
        _core.set_num_threads(1)


def _read(file: Path) -> dict[str, list[Result]]:
    """Results so far; half a line is what was being written when the run was stopped."""
    if not file.exists():
        return {}
    done = {}
    whole = [line for line in file.read_text().splitlines(keepends=True) if line.endswith("\n")]
    for line in map(json.loads, whole):
        if line["version"] == version("semcal"):
            done[line["case"]] = [Result(**result) for result in line["results"]]
    write_text("".join(whole), file)
    return done


@dataclass(frozen=True)
class Summary:
    """The distribution of errors over the seeds of a row."""

    row: str
    estimator: str
    n: int
    rotation_deg: tuple[float, float, float]
    """Median, 95 % quantile, worst."""
    camera_center_cm: tuple[float, float, float]
    num_not_trusted: int
    refine_s: float
    """Median seconds from the initial pose to the end."""


def summarise(results: Iterable[Result]) -> list[Summary]:
    """Sum the results up, row by row and estimator by estimator, in the order in which they come."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.row, result.estimator), []).append(result)
    return [
        Summary(
            row,
            estimator,
            len(found),
            _distribution([r.rotation_deg for r in found]),
            _distribution([r.camera_center_cm for r in found]),
            sum(r.status == "not_trusted" for r in found),
            float(np.median([r.refine_s for r in found])),
        )
        for (row, estimator), found in groups.items()
    ]


def _distribution(values: list[float]) -> tuple[float, float, float]:
    return float(np.median(values)), float(np.quantile(values, 0.95)), max(values)


def markdown(summaries: Sequence[Summary]) -> str:
    """Give the table."""
    lines = [
        "| | estimator | n | rotation, deg: median, 95 %, worst | camera centre, cm: median, 95 %, worst "
        "| not trusted | refinement, s |",
        "|---|---|---|---|---|---|---|",
    ]
    for s in summaries:
        rotation = ", ".join(f"{x:.4f}" for x in s.rotation_deg)
        center = ", ".join(f"{x:.2f}" for x in s.camera_center_cm)
        lines.append(
            f"| {s.row} | {s.estimator} | {s.n} | {rotation} | {center} | {s.num_not_trusted} | {s.refine_s:.1f} |"
        )
    return "\n".join(lines) + "\n"


def machine() -> dict[str, object]:
    """Say what this runs on."""
    return {
        "semcal": version("semcal"),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def write_results(name: str, results: Sequence[Result], folder: Path) -> list[Summary]:
    """Write CSV, JSON, table and plot into a folder."""
    summaries = summarise(results)
    with (folder / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Result)])
        writer.writeheader()
        writer.writerows(asdict(result) for result in results)
    document = {"experiment": name, "machine": machine(), "rows": [asdict(s) for s in summaries]}
    write_text(json.dumps(document, indent=2) + "\n", folder / "summary.json")
    write_text(markdown(summaries), folder / "table.md")
    write_bytes(_plot(results), folder / "plot.png")
    return summaries


def _plot(results: Sequence[Result]) -> bytes:
    from matplotlib.figure import Figure

    rows = list(dict.fromkeys(result.row for result in results))
    estimators = list(dict.fromkeys(result.estimator for result in results))
    figure = Figure(figsize=(12.0, 1.5 + 0.45 * len(rows)), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    height = 0.8 / len(estimators)
    measures = (("rotation_deg", "rotation error, degrees"), ("camera_center_cm", "camera centre error, cm"))
    for ax, (key, label) in zip(axes, measures, strict=True):
        for number, estimator in enumerate(estimators):
            found = [
                [getattr(r, key) for r in results if r.row == row and r.estimator == estimator]
                for row in rows
            ]
            places = [index + (number - 0.5 * (len(estimators) - 1)) * height for index in range(len(rows))]
            boxes = ax.boxplot(
                found,
                positions=places,
                widths=0.8 * height,
                orientation="horizontal",
                patch_artist=True,
                manage_ticks=False,
            )
            for box in boxes["boxes"]:
                box.set_facecolor(f"C{number}")
            boxes["boxes"][0].set_label(estimator)
        ax.set_xscale("log")
        ax.set_xlabel(label)
        ax.grid(axis="x", alpha=0.3)
    axes[0].set_yticks(range(len(rows)), rows)
    axes[0].invert_yaxis()
    axes[1].legend(loc="lower right")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    return buffer.getvalue()
