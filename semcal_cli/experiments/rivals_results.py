"""Table and plots of the experiments that set methods beside one another.

The plots follow the box plots of Jiang, Osteen and Saripalli, arXiv 2104.12023.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from semcal_cli.experiments.distribution import (
    ERROR_COLUMNS,
    MEASURES,
    draw_groups,
    error_cells,
    error_distributions,
    errors_in_groups,
    grouped,
)
from semcal_cli.experiments.methods import METHODS
from semcal_cli.experiments.plot_style import GREY, make_logarithmic
from semcal_cli.experiments.result_files import machine, markdown_table, write_results
from semcal_cli.experiments.rivals import AXES, START_DEG, START_M, Finding

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    num_back: int
    """Number of runs that ended nearer to the truth than the common start."""
    seconds: float
    """Median time from pairs in memory to a pose."""


def summarise(findings: Sequence[Finding]) -> list[Summary]:
    """Summarise the findings of each setting and method, in the order of the findings."""
    groups = grouped(findings, lambda f: (f.setting, f.method))
    names = list(dict.fromkeys(finding.setting for finding in findings))
    ordered = [(name, method) for name in names for method in METHODS if (name, method) in groups]
    return [_summary(setting, method, groups[setting, method]) for setting, method in ordered]


def _summary(setting: str, method: str, found: Sequence[Finding]) -> Summary:
    return Summary(
        setting,
        method,
        len(found),
        *error_distributions(found),
        sum(finding.is_back for finding in found),
        float(np.median([finding.seconds for finding in found])),
    )


def markdown(axis: str, summaries: Sequence[Summary]) -> str:
    """Format the table of settings that differ along `axis`."""
    rows = [(s.setting, s.method, s.n, *error_cells(s), s.num_back, f"{s.seconds:.1f}") for s in summaries]
    return markdown_table(f"| {axis} | method | n | {ERROR_COLUMNS} | came back | s |", rows)


def write_rivals(
    name: str, findings: Sequence[Finding], num_jobs: int, folder: Path, *, is_mended: bool = True
) -> str:
    """Write CSV, JSON, table and plot into a folder, and return the table."""
    summaries = summarise(findings)
    table = markdown(AXES[name], summaries)
    document: dict[str, object] = {
        "experiment": name,
        "machine": machine(),
        "jobs": num_jobs,
        "start": {"rotation_deg": START_DEG, "camera_center_m": START_M},
        "is_mended": is_mended,
    }
    write_results(document, findings, summaries, table, lambda: _plot(AXES[name], findings), folder)
    return table


def _plot(axis: str, findings: Sequence[Finding]) -> Figure:
    """Draw the errors of each method in each setting, side by side as in the paper's, and the shares that came back."""
    from matplotlib.figure import Figure

    settings = list(dict.fromkeys(finding.setting for finding in findings))
    found = {finding.method for finding in findings}
    methods = [name for name in METHODS if name in found]
    colors = [METHODS[name].color for name in methods]
    groups = grouped(findings, lambda f: (f.method, f.setting))
    figure = Figure(figsize=(13.0, 9.0))
    *of_errors, of_shares = figure.subplots(3, 1, height_ratios=(3, 3, 2))
    for axes, (key, label) in zip(of_errors, MEASURES, strict=True):
        errors = errors_in_groups(groups, key, methods, settings)
        places = draw_groups(axes, errors, methods, "vertical", colors)
        _count_failures(axes, places, errors)
        make_logarithmic(axes, "y")
        axes.set_ylabel(label)
    _draw_shares(of_shares, groups, methods, settings)
    for axes in (*of_errors, of_shares):
        axes.set_xticks(range(len(settings)), settings)
        axes.set_xlim(-0.5, len(settings) - 0.5)
        axes.grid(axis="y")
        for border in range(1, len(settings)):
            axes.axvline(border - 0.5, color=GREY, linewidth=0.5)
    of_shares.set_xlabel(axis)
    figure.legend(*of_errors[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(methods))
    return figure


def _draw_shares(
    axes: Axes,
    groups: dict[tuple[str, str], list[Finding]],
    methods: Sequence[str],
    settings: Sequence[str],
) -> None:
    """Draw the share of the runs of each method that came back, a line over the settings."""
    # The first method is drawn last: lines at 100 % cover one another.
    for method in reversed(methods):
        known = [
            (place, groups[method, setting])
            for place, setting in enumerate(settings)
            if (method, setting) in groups
        ]
        shares = [100.0 * sum(f.is_back for f in found) / len(found) for _, found in known]
        axes.plot(
            [place for place, _ in known],
            shares,
            "o-",
            color=METHODS[method].color,
            markersize=4,
        )
    axes.set_ylabel("nearer to the truth\nthan the start, %")
    axes.set_ylim(-5.0, 105.0)


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
