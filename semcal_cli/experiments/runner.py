"""What experiments share: a pool of drives, results that survive being stopped, tables and plots."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import version
from multiprocessing import get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from semcal_cli import _core
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import InputError
from semcal_cli.files.reading import read_text
from semcal_cli.files.writing import write_bytes, write_text
from semcal_cli.synthetic.config import SynthConfig
from semcal_cli.synthetic.synthesis import synthesize

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POOL_FRAMES = 20
"""Frames of each drive in the pool, which experiments cut down."""


Case = TypeVar("Case")
"""What an experiment runs once; cases are told apart by their `repr`."""
Found = TypeVar("Found")
"""What it finds: a dataclass of numbers and strings."""


@dataclass(frozen=True)
class Result:
    """One calibration against the truth."""

    row: str
    seed: int
    estimator: str
    rotation_deg: float
    """Infinite, as the other errors are, where the calibration failed."""
    camera_center_cm: float
    is_right: bool
    """The errors are no larger than the row allows."""
    status: str
    """The calibration's, or why it failed."""
    initial_deg: float
    initial_cm: float
    refine_s: float

    @property
    def is_missed(self) -> bool:
        """The calibration is wrong and does not say so."""
        return not self.is_right and math.isfinite(self.rotation_deg) and self.status != "not_trusted"


@dataclass(frozen=True)
class Pool:
    """Synthetic drives, one for each rig and seed, made when they are first needed."""

    folder: Path

    def drive(self, rig: str, changes: dict[str, object], seed: int) -> Path:
        """Give the drive of a rig, a `SynthConfig` with some changes."""
        path = self.folder / f"{rig}_{seed:06d}"
        if not (path / DRIVE_FILE).exists():
            config = replace(SynthConfig(num_frames=POOL_FRAMES, seed=seed), **changes)  # type: ignore[arg-type]
            self.folder.mkdir(exist_ok=True)
            # Other processes may want it, too: whoever is first puts it in place.
            with TemporaryDirectory(dir=self.folder) as folder:
                made = Path(folder) / "drive"
                synthesize(config, made)
                # Nothing computes on the pictures, which are most of the bytes.
                for picture in (made / "images").iterdir():
                    picture.unlink()
                try:
                    made.rename(path)
                except OSError:
                    if not (path / DRIVE_FILE).exists():
                        raise InputError(f"{path}: is in the way of a drive, and none") from None
        return path


def make_folder(out: Path, name: str) -> Path:
    """Make the folder of an experiment.

    Raises:
        InputError: it cannot be made.
    """
    folder = out / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {(error.strerror or str(error)).lower()}") from None
    return folder


def run_cases(
    cases: Sequence[Case],
    run: Callable[[Case], list[Found]],
    kind: type[Found],
    folder: Path,
    num_jobs: int,
    progress: Callable[[int, int], None],
) -> list[Found]:
    """Run each case that has no results in `folder` yet; a run that was stopped goes on where it was.

    With several jobs, each computes on one thread.

    Args:
        cases: What to run.
        run: Runs one; it is sent to other processes.
        kind: The class of what it finds.
        folder: Where `results.jsonl` is, or will be.
        num_jobs: Cases at a time.
        progress: Called with how many cases are done, and how many there are.

    Raises:
        InputError: the results so far are none of this experiment.
    """
    file = folder / "results.jsonl"
    done = _read(file, kind)
    missing = [case for case in cases if repr(case) not in done]
    progress(len(cases) - len(missing), len(cases))
    with (
        file.open("a") as out,
        # Not forked: the core's threads would be missing there.
        ProcessPoolExecutor(num_jobs, get_context("spawn"), _start, (num_jobs,)) as pool,
    ):
        for case, results in zip(missing, pool.map(run, missing), strict=True):
            done[repr(case)] = results
            found: list[dict[str, Any]] = [vars(result) for result in results]
            line = {"case": repr(case), "version": version("semcal"), "results": found}
            out.write(json.dumps(line) + "\n")
            out.flush()
            progress(sum(repr(case) in done for case in cases), len(cases))
    return [result for case in cases for result in done[repr(case)]]


def _start(num_jobs: int) -> None:
    Thread(target=_end_with_parent, daemon=True).start()
    if num_jobs > 1:
        _core.set_num_threads(1)


def _end_with_parent() -> None:
    """Stop when the process that gives the work has been killed."""
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


def _read(file: Path, kind: type[Found]) -> dict[str, list[Found]]:
    """Results so far; half a line is what was being written when the run was stopped."""
    if not file.exists():
        return {}
    done: dict[str, list[Found]] = {}
    whole = [line for line in read_text(file).splitlines(keepends=True) if line.endswith("\n")]
    for number, text in enumerate(whole, start=1):
        try:
            line = json.loads(text)
            if line["version"] == version("semcal"):
                done[line["case"]] = [kind(**result) for result in line["results"]]
        except (ValueError, KeyError, TypeError):
            needed = "needed a case of this experiment; without the file, all is run anew"
            raise InputError(f"{file}: line {number}: found {text[:40]!r}, {needed}") from None
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
    num_right: int
    """Within the row's errors."""
    num_not_trusted: int
    num_missed: int
    """Wrong, and not said to be."""
    num_failed: int
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
            distribution([r.rotation_deg for r in found]),
            distribution([r.camera_center_cm for r in found]),
            sum(r.is_right for r in found),
            sum(r.status == "not_trusted" for r in found),
            sum(r.is_missed for r in found),
            sum(not math.isfinite(r.rotation_deg) for r in found),
            float(np.median([r.refine_s for r in found])),
        )
        for (row, estimator), found in groups.items()
    ]


def distribution(values: list[float]) -> tuple[float, float, float]:
    """Give median, 95 % quantile and worst of errors."""
    # Not between two values: one may be infinite.
    quantile = np.quantile(values, 0.95, method="higher")
    return float(np.median(values)), float(quantile), max(values)


def markdown(summaries: Sequence[Summary]) -> str:
    """Give the table."""
    lines = [
        "| | estimator | n | rotation, deg: median, 95 %, worst | camera centre, cm: median, 95 %, worst "
        "| right | not trusted | wrong, not said | failed | refinement, s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for s in summaries:
        rotation = ", ".join(f"{x:.4f}" for x in s.rotation_deg)
        center = ", ".join(f"{x:.2f}" for x in s.camera_center_cm)
        lines.append(
            f"| {s.row} | {s.estimator} | {s.n} | {rotation} | {center} | {s.num_right} | {s.num_not_trusted} "
            f"| {s.num_missed} | {s.num_failed} | {s.refine_s:.1f} |"
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


def write_accuracy(results: Sequence[Result], num_jobs: int, folder: Path) -> list[Summary]:
    """Write CSV, JSON, table and plot into a folder."""
    summaries = summarise(results)
    document = {"experiment": "accuracy", "machine": machine(), "jobs": num_jobs}
    write_results(document, results, summaries, markdown(summaries), _plot(results), folder)
    return summaries


def write_results(
    document: dict[str, object],
    results: Sequence[Any],
    summaries: Sequence[Any],
    table: str,
    figure: Figure | None,
    folder: Path,
) -> None:
    """Write an experiment's files: results.csv, summary.json (`document` and rows), table.md, and plot.png if any."""
    file = io.StringIO()
    writer = csv.DictWriter(file, list(vars(results[0])), lineterminator="\n")
    writer.writeheader()
    writer.writerows(vars(result) for result in results)
    write_text(file.getvalue(), folder / "results.csv")
    rows = [vars(summary) for summary in summaries]
    write_text(json.dumps(document | {"rows": rows}, indent=2) + "\n", folder / "summary.json")
    write_text(table, folder / "table.md")
    if figure is not None:
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=120)
        write_bytes(buffer.getvalue(), folder / "plot.png")


def _plot(results: Sequence[Result]) -> Figure:
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
                [
                    value
                    for r in results
                    if r.row == row and r.estimator == estimator and math.isfinite(value := getattr(r, key))
                ]
                for row in rows
            ]
            places = [index + (number - 0.5 * (len(estimators) - 1)) * height for index in range(len(rows))]
            draw_boxes(ax, found, places, 0.8 * height, number, estimator, "horizontal")
        ax.set_xscale("log")
        ax.set_xlabel(label)
        ax.grid(axis="x", alpha=0.3)
    axes[0].set_yticks(range(len(rows)), rows)
    axes[0].invert_yaxis()
    axes[1].legend(loc="lower right")
    return figure


def draw_boxes(
    axes: Axes,
    values: Sequence[Sequence[float]],
    places: Sequence[float],
    width: float,
    number: int,
    label: str,
    orientation: Literal["horizontal", "vertical"],
) -> None:
    """Draw a box at each place, of the numbered colour."""
    boxes = axes.boxplot(
        values,
        positions=places,
        widths=width,
        orientation=orientation,
        patch_artist=True,
        medianprops={"color": "black"},
        flierprops={"markersize": 3},
        manage_ticks=False,
    )
    for box in boxes["boxes"]:
        box.set_facecolor(f"C{number}")
    boxes["boxes"][0].set_label(label)
