"""Frequency with which a calibration's own statements are true: intervals, verdicts, and `verify`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from semcal_cli.experiments.accuracy import RIGS
from semcal_cli.experiments.result_files import machine, markdown_table, write_results
from semcal_cli.experiments.trust import BAD, MOVED, MOVED_M, NOISES, OFFSETS, PAIRS, Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Rate:
    """Frequency of an event, with the binomial 95 % interval of Wilson (1927).

    Runs on one drive, and axes of one run, are not independent: the interval is then too narrow.
    """

    name: str
    count: int
    n: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the rate."""
        if self.n == 0:
            return 0.0, 1.0
        z2, p = 1.96**2, self.count / self.n
        middle = (p + z2 / (2 * self.n)) / (1 + z2 / self.n)
        half = 1.96 * math.sqrt(p * (1 - p) / self.n + z2 / (4 * self.n**2)) / (1 + z2 / self.n)
        return max(middle - half, 0.0), min(middle + half, 1.0)


def rates(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of all statements that semcal makes."""
    good = [f for f in findings if f.kind == "good"]
    calibrated = [f for f in findings if f.kind not in OFFSETS]
    mine = [f for f in findings if f.kind == "mine"]
    many = [f for f in good if f.num_pairs >= 10]
    trusted = [f for f in good if f.status == "trusted"]
    found = [
        _coverage("trusted: axes in the 95 % interval", trusted),
        _coverage("the same, trusted or not", good),
    ]
    found += [_coverage(f"trusted, {n} pairs", [f for f in trusted if f.num_pairs == n]) for n in PAIRS]
    found += [
        _coverage(f"trusted, {noise:.0%} wrong labels", [f for f in trusted if f.noise == noise])
        for noise in NOISES
    ]
    found += [_coverage(f"trusted, {rig}", [f for f in trusted if f.rig == rig]) for rig in RIGS]
    found += [
        _coverage("trusted, MINE, 10 pairs", [f for f in mine if f.status == "trusted"]),
        _rate("confident and wrong, of all", calibrated, lambda f: f.is_confidently_wrong),
        _rate(
            "confident and wrong, of those trusted",
            [f for f in calibrated if f.status == "trusted"],
            lambda f: f.is_confidently_wrong,
        ),
        _rate("good drives are trusted, all", good, lambda f: f.status == "trusted"),
        _rate("good drives are trusted, 10 pairs or more", many, lambda f: f.status == "trusted"),
        _rate("good drives are trusted, MINE, 10 pairs", mine, lambda f: f.status == "trusted"),
    ]
    for kind in BAD:
        found.append(
            _rate(
                f"not trusted or failed, {kind}",
                [f for f in findings if f.kind == kind],
                lambda f: f.status != "trusted",
            )
        )
    for name, kinds in (*((kind, (kind,)) for kind in OFFSETS), (f"{100 * MOVED_M:.0f} cm off, all", MOVED)):
        of_kind = [f for f in findings if f.kind in kinds]
        found.append(_rate(f"verify fails, {name}", of_kind, lambda f: f.status == "fail"))
        found.append(_rate(f"verify is inconclusive, {name}", of_kind, lambda f: f.status == "inconclusive"))
    return found


def _rate(name: str, findings: Iterable[Outcome], is_so: Callable[[Outcome], bool]) -> Rate:
    listed = list(findings)
    return Rate(name, sum(map(is_so, listed)), len(listed))


def _coverage(name: str, findings: Iterable[Outcome]) -> Rate:
    """Rate of the axes whose truth is within the stated interval."""
    stated = [f for f in findings if f.half_widths]
    inside = [abs(error) <= half for f in stated for error, half in zip(f.errors, f.half_widths, strict=True)]
    return Rate(name, sum(inside), len(inside))


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
    rows = []
    for rate in rates(findings):
        low, high = rate.interval
        share = f"{rate.count / rate.n:.1%}" if rate.n else "-"
        rows.append((rate.name, rate.count, rate.n, share, f"{low:.1%} to {high:.1%}"))
    table = markdown_table("| | count | of | rate | 95 % interval |", rows)
    return f"{table}| median stated sigma over true RMSE, worst axis | | | {sharpness(findings):.2f} | |\n"


def write_trust(findings: Sequence[Outcome], num_jobs: int, folder: Path) -> str:
    """Write CSV, JSON, table and plot into a folder, and return the table."""
    table = markdown(findings)
    document = {
        "experiment": "trust",
        "machine": machine(),
        "jobs": num_jobs,
        "sharpness": sharpness(findings),
    }
    write_results(document, findings, rates(findings), table, _plot(findings), folder)
    return table


def _plot(findings: Sequence[Outcome]) -> Figure:
    """Plot the errors in units of their half interval, by number of pairs: 95 % should be within one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.subplots()
    trusted = [f for f in findings if f.kind == "good" and f.status == "trusted"]
    groups = [
        [e / h for f in trusted if f.num_pairs == n for e, h in zip(f.errors, f.half_widths, strict=True)]
        for n in PAIRS
    ]
    axes.boxplot(groups, whis=(2.5, 97.5), showfliers=False)
    axes.set_xticks(range(1, len(PAIRS) + 1), [str(n) for n in PAIRS])
    axes.axhspan(-1.0, 1.0, alpha=0.1)
    axes.set_xlabel("pairs; whiskers hold 95 %")
    axes.set_ylabel("error over half the stated interval")
    return figure
