"""Error against the number of pairs, and against wrong labels, in comparison with SOIC and PMI from the same starts.

The plots follow the box plots of Jiang, Osteen and Saripalli, arXiv 2104.12023.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from semcal_cli.config import SynthConfig
from semcal_cli.drive.cues import load_cues
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.reading import mend, read_observations
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.accuracy import off
from semcal_cli.experiments.distribution import (
    ERROR_COLUMNS,
    MEASURES,
    draw_groups,
    error_cells,
    error_distributions,
    errors_in_groups,
    grouped,
)
from semcal_cli.experiments.methods import BY_INTENSITY, METHODS, WITH_MINE, Scene
from semcal_cli.experiments.result_files import machine, markdown_table, write_results
from semcal_cli.formats import read_transform
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.synthetic.label_noise import with_wrong_labels
from semcal_cli.synthetic.synthesis import synthesize

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

START_DEG, START_M = 2.0, 0.2
"""Distance of every method's start from the truth."""
MINE_SETTINGS = ("10", "20%")
"""Settings in which MINE is run, since it takes longer."""
MINE_EVERY = 5
"""Divisor of the seeds on whose drives MINE is run."""


@dataclass(frozen=True)
class Setting:
    """A group of boxes: a number of pairs, and a share of wrong labels on both sides."""

    name: str
    num_pairs: int
    wrong: float = 0.0


EXPERIMENTS: dict[str, tuple[Setting, ...]] = {
    "pairs": tuple(Setting(f"{n}", n) for n in (1, 10, 20, 50, 70)),
    "noise": tuple(Setting(f"{share:.0%}", 20, share) for share in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)),
}
AXES = {"pairs": "pairs", "noise": "wrong labels"}
"""Axis of the plot of each experiment, along which its settings differ."""


@dataclass(frozen=True)
class Case:
    """All settings on the drive of one seed."""

    seed: int
    """Seed of the drive."""


@dataclass(frozen=True)
class Finding:
    """The error of one calibration against the truth."""

    setting: str
    """Name of the setting."""
    method: str
    """Key of `METHODS`."""
    seed: int
    """Seed of the drive."""
    rotation_deg: float
    """Rotation error; infinite, as the other error is, if the calibration failed."""
    camera_center_cm: float
    """Distance of the camera from its true place."""
    seconds: float
    """Time from pairs in memory to a pose."""
    failure: str = ""
    """Message of the error; empty if there was none."""


@dataclass(frozen=True)
class Experiment:
    """The settings that all cases share; a call runs one case. It can be pickled for other processes."""

    settings: tuple[Setting, ...]
    """What the drive is cut down to, one after another."""
    scratch: Path
    """Folder of the drives while they are needed."""
    config: SynthConfig = field(default_factory=SynthConfig)
    """Settings of the drives, except for frames and seed."""

    def __call__(self, case: Case) -> list[Finding]:
        """Make a drive, cut it down to each setting, and calibrate it with each method from the same start."""
        num_frames = max(setting.num_pairs for setting in self.settings)
        with TemporaryDirectory(dir=self.scratch) as folder:
            path = Path(folder) / "drive"
            synthesize(replace(self.config, num_frames=num_frames, seed=case.seed), path)
            drive, truth = read_drive(path), read_transform(path)
            labels, intensity = read_observations(drive), load_cues(drive, ("intensity",))
        rng = np.random.default_rng(case.seed)
        order, T_init = rng.permutation(num_frames), off(truth, START_DEG, START_M, rng)
        found: list[Finding] = []
        by_intensity: dict[tuple[str, int], Finding] = {}
        for setting in self.settings:
            chosen = sorted(order[: setting.num_pairs].tolist())
            wrong = with_wrong_labels(labels.of_frames(chosen), setting.wrong, rng)
            scene = Scene(drive, mend(wrong), intensity.of_frames(chosen))
            # These observations are made at their first use, and their time counts for no method.
            _ = scene.labels.core, scene.intensity.core
            for method in METHODS:
                if method in WITH_MINE and (setting.name not in MINE_SETTINGS or case.seed % MINE_EVERY):
                    continue
                # Wrong labels have no effect on methods that do not use labels.
                known = by_intensity.get((method, setting.num_pairs))
                if known is None:
                    found.append(_measure(setting, method, case.seed, scene, T_init, truth))
                else:
                    found.append(replace(known, setting=setting.name))
                if method in BY_INTENSITY:
                    by_intensity[method, setting.num_pairs] = found[-1]
        return found


def _measure(setting: Setting, method: str, seed: int, scene: Scene, T_init: Pose, truth: Pose) -> Finding:
    start = perf_counter()
    try:
        error = compare_poses(METHODS[method](scene, T_init), truth)
    except SemcalError as failure:
        return Finding(setting.name, method, seed, math.inf, math.inf, perf_counter() - start, str(failure))
    seconds = perf_counter() - start
    return Finding(setting.name, method, seed, error.rotation_deg, error.camera_center_cm, seconds)


@dataclass(frozen=True)
class Summary:
    """The distribution of errors over the seeds of one setting, by one method."""

    setting: str
    """Name of the setting."""
    method: str
    """Key of `METHODS`."""
    n: int
    """Number of drives."""
    rotation_deg: tuple[float, float, float]
    """Median, 95 % quantile and worst."""
    camera_center_cm: tuple[float, float, float]
    num_lost: int
    """Number of runs that failed, or ended no nearer to the truth than they began."""
    seconds: float
    """Median time from pairs in memory to a pose."""


def summarise(findings: Sequence[Finding]) -> list[Summary]:
    """Summarise the findings of each setting and method, in the order of the findings."""
    groups = grouped(findings, lambda f: (f.setting, f.method))
    names = list(dict.fromkeys(finding.setting for finding in findings))
    ordered = [(name, method) for name in names for method in METHODS if (name, method) in groups]
    return [_summary(setting, method, groups[setting, method]) for setting, method in ordered]


def _summary(setting: str, method: str, found: Sequence[Finding]) -> Summary:
    lost = [f for f in found if f.rotation_deg >= START_DEG or f.camera_center_cm >= 100.0 * START_M]
    return Summary(
        setting,
        method,
        len(found),
        *error_distributions(found),
        len(lost),
        float(np.median([f.seconds for f in found])),
    )


def markdown(axis: str, summaries: Sequence[Summary]) -> str:
    """Format the table of settings that differ along `axis`."""
    rows = [(s.setting, s.method, s.n, *error_cells(s), s.num_lost, f"{s.seconds:.1f}") for s in summaries]
    return markdown_table(f"| {axis} | method | n | {ERROR_COLUMNS} | lost | s |", rows)


def write_rivals(name: str, findings: Sequence[Finding], num_jobs: int, folder: Path) -> str:
    """Write CSV, JSON, table and plot into a folder, and return the table."""
    summaries = summarise(findings)
    table = markdown(AXES[name], summaries)
    document: dict[str, object] = {
        "experiment": name,
        "machine": machine(),
        "jobs": num_jobs,
        "start": {"rotation_deg": START_DEG, "camera_center_m": START_M},
    }
    write_results(document, findings, summaries, table, _plot(AXES[name], findings), folder)
    return table


def _plot(axis: str, findings: Sequence[Finding]) -> Figure:
    """Draw box plots like the paper's, with a box for each method in each setting."""
    from matplotlib.figure import Figure

    settings = list(dict.fromkeys(finding.setting for finding in findings))
    # These ran on a few seeds only: they are points in the table, without boxes.
    methods = [name for name in METHODS if name not in WITH_MINE]
    groups = grouped(findings, lambda f: (f.method, f.setting))
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    for axes, (key, label) in zip(figure.subplots(1, 2), MEASURES, strict=True):
        errors = errors_in_groups(groups, key, methods, settings)
        places = draw_groups(axes, errors, methods, "vertical")
        _count_failures(axes, places, errors)
        axes.set_yscale("log")
        axes.set_xlabel(axis)
        axes.set_ylabel(label)
        axes.set_xticks(range(len(settings)), settings)
        axes.grid(axis="y", alpha=0.3)
    axes.legend()
    return figure


def _count_failures(
    axes: Axes, places: Sequence[Sequence[float]], errors: Sequence[Sequence[Sequence[float]]]
) -> None:
    """Write above each box the number of calibrations that failed."""
    for of_method, errors_of_method in zip(places, errors, strict=True):
        for place, values in zip(of_method, errors_of_method, strict=True):
            if num_failed := sum(not math.isfinite(value) for value in values):
                axes.text(
                    place,
                    1.0,
                    f"{num_failed} failed",
                    transform=axes.get_xaxis_transform(),
                    rotation=90.0,
                    va="top",
                    ha="center",
                )
