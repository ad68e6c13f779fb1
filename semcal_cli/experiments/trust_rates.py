"""Frequency with which a calibration's own statements are true: intervals, verdicts, and `verify`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from semcal_cli.experiments.accuracy import RIGS
from semcal_cli.experiments.distribution import MAX_FOR_DOTS, draw_values
from semcal_cli.experiments.outcome import Outcome
from semcal_cli.experiments.plot_style import ACCENT, GREEN, WRONG
from semcal_cli.experiments.rate import Rate, axes_inside, rate_of
from semcal_cli.experiments.result_files import machine, markdown_table, write_results
from semcal_cli.experiments.spoiled import KINDS
from semcal_cli.experiments.spoiled_rates import spoiled_markdown, spoiled_rates
from semcal_cli.experiments.subtle_rates import subtle_markdown, subtle_rates
from semcal_cli.experiments.trust import BAD, MOVED, MOVED_M, NOISES, OFFSETS, PAIRS, SHARED, SHARED_PAIRS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def rates(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of all statements that semcal makes."""
    good = [f for f in findings if f.kind == "good"]
    calibrated = [f for f in findings if f.kind not in OFFSETS and f.kind not in KINDS]
    mine = [f for f in findings if f.kind == "mine"]
    shared = [f for f in findings if f.kind == SHARED and f.status == "trusted"]
    many = [f for f in good if f.num_pairs >= 10]
    trusted = [f for f in good if f.status == "trusted"]
    found = [
        axes_inside("trusted: axes in the 95 % interval", trusted),
        axes_inside("the same, trusted or not", good),
    ]
    found += [axes_inside(f"trusted, {n} pairs", [f for f in trusted if f.num_pairs == n]) for n in PAIRS]
    found += [
        axes_inside(f"trusted, {noise:.0%} wrong labels", [f for f in trusted if f.noise == noise])
        for noise in NOISES
    ]
    found += [axes_inside(f"trusted, {rig}", [f for f in trusted if f.rig == rig]) for rig in RIGS]
    found += [
        *(
            axes_inside(f"trusted, {SHARED}, {n} pairs", [f for f in shared if f.num_pairs == n])
            for n in SHARED_PAIRS
        ),
        axes_inside("trusted, MINE, 10 pairs", [f for f in mine if f.status == "trusted"]),
        rate_of("confident and wrong, of all", calibrated, lambda f: f.is_confidently_wrong),
        rate_of(
            "confident and wrong, of those trusted",
            [f for f in calibrated if f.status == "trusted"],
            lambda f: f.is_confidently_wrong,
        ),
        rate_of("good drives are trusted, all", good, lambda f: f.status == "trusted"),
        rate_of("good drives are trusted, 10 pairs or more", many, lambda f: f.status == "trusted"),
        rate_of("good drives are trusted, MINE, 10 pairs", mine, lambda f: f.status == "trusted"),
    ]
    for kind in BAD:
        found.append(
            rate_of(
                f"not trusted or failed, {kind}",
                [f for f in findings if f.kind == kind],
                lambda f: f.status != "trusted",
            )
        )
    for name, kinds in (*((kind, (kind,)) for kind in OFFSETS), (f"{100 * MOVED_M:.0f} cm off, all", MOVED)):
        of_kind = [f for f in findings if f.kind in kinds]
        found.append(rate_of(f"verify fails, {name}", of_kind, lambda f: f.status == "fail"))
        found.append(
            rate_of(f"verify is inconclusive, {name}", of_kind, lambda f: f.status == "inconclusive")
        )
    return found + spoiled_rates(findings) + subtle_rates(findings)


def sharpness(findings: Sequence[Outcome]) -> float:
    """Ratio of the median stated standard error to the true root mean square error, if trusted; the worst axis."""
    trusted = [f for f in findings if f.kind == "good" and f.status == "trusted"]
    if not trusted:
        return math.nan
    sigmas, errors = np.array([f.sigmas for f in trusted]), np.array([f.errors for f in trusted])
    ratios: npt.NDArray[np.float64] = np.median(sigmas, axis=0) / np.sqrt(np.mean(errors**2, axis=0))
    return float(ratios.max())


def markdown(findings: Sequence[Outcome]) -> str:
    """Format the table."""
    table = markdown_table(
        "| | count | of | rate | 95 % interval |", (rate.cells for rate in rates(findings) if rate.n > 0)
    )
    ratio = sharpness(findings)
    if not math.isnan(ratio):
        table += f"| median stated sigma over true RMSE, worst axis | | | {ratio:.2f} | |\n"
    for more in (spoiled_markdown(findings), subtle_markdown(findings)):
        table += f"\n{more}" if more else ""
    return table


def write_trust(findings: Sequence[Outcome], num_jobs: int, folder: Path) -> str:
    """Write CSV, JSON, table and, if there are good drives, a plot into a folder, and return the table."""
    table = markdown(findings)
    draw = (lambda: _plot(findings)) if any(f.kind == "good" for f in findings) else None
    document = {
        "experiment": "trust",
        "machine": machine(),
        "jobs": num_jobs,
        "sharpness": None if math.isnan(ratio := sharpness(findings)) else ratio,
    }
    write_results(document, findings, rates(findings), table, draw, folder)
    return table


def _plot(findings: Sequence[Outcome]) -> Figure:
    """Plot the errors in units of their half interval, by number of pairs: 95 % should be within one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.0))
    axes = figure.subplots()
    trusted = [f for f in findings if f.kind == "good" and f.status == "trusted"]
    groups = [
        [e / h for f in trusted if f.num_pairs == n for e, h in zip(f.errors, f.half_widths, strict=True)]
        for n in PAIRS
    ]
    for place, values in enumerate(groups):
        draw_values(axes, values, place, 0.6, ACCENT, "vertical", whiskers=(2.5, 97.5))
    axes.axhspan(-1.0, 1.0, color=GREEN, alpha=0.12, linewidth=0.0)
    for limit in (-1.0, 1.0):
        axes.axhline(limit, color=WRONG, linewidth=1.0)
    axes.set_xticks(
        range(len(PAIRS)), [f"{n}\n{len(values)} axes" for n, values in zip(PAIRS, groups, strict=True)]
    )
    axes.set_xlim(-0.5, len(PAIRS) - 0.5)
    has_box = any(len(values) > MAX_FOR_DOTS for values in groups)
    axes.set_xlabel(f"pairs of a drive{'; whiskers of a box hold 95 %' if has_box else ''}")
    axes.set_ylabel("error, in half widths of\nthe stated 95 % interval")
    axes.grid(axis="y")
    return figure
