"""Table and plots of the experiments that set methods beside one another.

The plots follow the box plots of Jiang, Osteen and Saripalli, arXiv 2104.12023.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from semcal_cli.experiments.distribution import MEASURES, draw_groups, errors_in_groups
from semcal_cli.experiments.experiment import Experiment
from semcal_cli.experiments.methods import METHODS
from semcal_cli.experiments.plot_style import GREY, make_logarithmic
from semcal_cli.experiments.pool import Pool
from semcal_cli.experiments.result_files import Report
from semcal_cli.experiments.rivals import (
    AXES,
    EXPERIMENTS,
    START_DEG,
    START_M,
    Case,
    Finding,
    Runner,
    cases,
    complete,
)
from semcal_cli.experiments.summary import ERRORS, NUMBER, SECONDS, common, count, grouped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def report(name: str, findings: Sequence[Finding], *, is_mended: bool = True) -> Report:
    """Sum up the findings of each setting, in the order of the findings, by each method, in that of `METHODS`."""
    columns = (
        common("setting", AXES[name]),
        common("method", "method"),
        NUMBER,
        *ERRORS,
        count("came back", "num_back", lambda finding: finding.is_back),
        SECONDS,
    )
    settings, methods = list(dict.fromkeys(each.setting for each in findings)), list(METHODS)
    ordered = sorted(findings, key=lambda each: (settings.index(each.setting), methods.index(each.method)))
    start = {"rotation_deg": START_DEG, "camera_center_m": START_M}
    facts = {"start": start, "is_mended": is_mended}
    return Report.of(ordered, columns, lambda: _plot(AXES[name], findings), facts)


def experiment(out: Path, seeds: range, name: str, *, is_mended: bool) -> Experiment[Case, Finding]:
    """Declare an experiment of `EXPERIMENTS`.

    Args:
        out: Folder of all experiments.
        seeds: Seeds of the drives.
        name: Key of `EXPERIMENTS`.
        is_mended: Whether isolated wrong pixels are mended for all methods but the paper's.
    """
    settings = EXPERIMENTS[name]
    folder = out / (name if is_mended else f"{name}_unmended")
    drives = folder / "drives"
    run = Runner(settings, Pool(drives, has_pictures=True), is_mended)
    return Experiment(
        name,
        folder,
        cases(settings, seeds),
        run,
        Finding,
        complete=lambda findings: complete(findings, settings),
        report=lambda findings: report(name, findings, is_mended=is_mended),
        scratch=drives,
    )


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
