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
from semcal_cli.experiments.experiment import Experiment
from semcal_cli.experiments.outcome import Case, Outcome
from semcal_cli.experiments.plot_style import ACCENT, GREEN, WRONG
from semcal_cli.experiments.pool import Pool
from semcal_cli.experiments.rate import Rate, axes_inside, rate_of, rates_by
from semcal_cli.experiments.result_files import Report
from semcal_cli.experiments.spoiled import KINDS
from semcal_cli.experiments.spoiled_rates import kinds_markdown, spoiled_rates, subtle_rates
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.experiments.trust import (
    BAD,
    MOVED,
    MOVED_M,
    NOISES,
    OFFSETS,
    PAIRS,
    SHARED,
    SHARED_PAIRS,
    Runner,
    cases,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def rates(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of all statements that semcal makes."""
    calibrated = [f for f in findings if f.kind not in OFFSETS and f.kind not in KINDS]
    trusted = [f for f in calibrated if f.is_trusted]
    good, mine = ([f for f in calibrated if f.kind == kind] for kind in ("good", "mine"))
    trusted_good, trusted_mine, trusted_shared = (
        [f for f in trusted if f.kind == kind] for kind in ("good", "mine", SHARED)
    )
    return [
        axes_inside("trusted: axes in the 95 % interval", trusted_good),
        axes_inside("the same, trusted or not", good),
        *rates_by("trusted, {} pairs", trusted_good, lambda f: f.num_pairs, PAIRS),
        *rates_by("trusted, {:.0%} wrong labels", trusted_good, lambda f: f.noise, NOISES),
        *rates_by("trusted, {}", trusted_good, lambda f: f.rig, RIGS),
        *rates_by(f"trusted, {SHARED}, {{}} pairs", trusted_shared, lambda f: f.num_pairs, SHARED_PAIRS),
        axes_inside("trusted, MINE, 10 pairs", trusted_mine),
        rate_of("confident and wrong, of all", calibrated, lambda f: f.is_confidently_wrong),
        rate_of("confident and wrong, of those trusted", trusted, lambda f: f.is_confidently_wrong),
        rate_of("good drives are trusted, all", good, lambda f: f.is_trusted),
        rate_of(
            "good drives are trusted, 10 pairs or more",
            [f for f in good if f.num_pairs >= 10],
            lambda f: f.is_trusted,
        ),
        rate_of("good drives are trusted, MINE, 10 pairs", mine, lambda f: f.is_trusted),
        *rates_by("not trusted or failed, {}", findings, lambda f: f.kind, BAD, lambda f: not f.is_trusted),
        *_verified(findings),
        *spoiled_rates(findings),
        *subtle_rates(findings),
    ]


def _verified(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of the verdicts of `verify` on each offset, and on the three moves together."""
    rates = []
    for name, kinds in (*((kind, (kind,)) for kind in OFFSETS), (f"{100 * MOVED_M:.0f} cm off, all", MOVED)):
        found = [f for f in findings if f.kind in kinds]
        rates.append(rate_of(f"verify fails, {name}", found, lambda f: f.status == "fail"))
        rates.append(rate_of(f"verify is inconclusive, {name}", found, lambda f: f.status == "inconclusive"))
    return rates


def sharpness(findings: Sequence[Outcome]) -> float:
    """Ratio of the median stated standard error to the true root mean square error, if trusted; the worst axis."""
    trusted = [f for f in findings if f.kind == "good" and f.is_trusted]
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
    for is_subtle in (False, True):
        more = kinds_markdown(findings, is_subtle=is_subtle)
        table += f"\n{more}" if more else ""
    return table


def report(findings: Sequence[Outcome]) -> Report:
    """Sum up all outcomes; the plot is that of the good drives."""
    ratio = sharpness(findings)
    return Report(
        [vars(rate) for rate in rates(findings)],
        markdown(findings),
        (lambda: _plot(findings)) if any(f.kind == "good" for f in findings) else None,
        {"sharpness": None if math.isnan(ratio) else ratio},
    )


def experiment(out: Path, seeds: range, parts: Sequence[str]) -> Experiment[Case, Outcome]:
    """Declare the experiment on some of `PARTS`."""
    run = Runner(Pool(out / "pool"), Pool(out / "pool_with_pictures", has_pictures=True))
    return Experiment("trust", out / "trust", cases(seeds, parts), run, Outcome, report)


def _plot(findings: Sequence[Outcome]) -> Figure:
    """Plot the errors in units of their half interval, by number of pairs: 95 % should be within one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.0))
    axes = figure.subplots()
    trusted = [f for f in findings if f.kind == "good" and f.is_trusted]
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
