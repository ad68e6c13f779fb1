"""Frequency of an event, with its interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass

from semcal_cli.experiments.outcome import Outcome
from semcal_cli.experiments.summary import grouped


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

    @property
    def share(self) -> str:
        """The rate as text."""
        return f"{self.count / self.n:.1%}" if self.n else "-"

    @property
    def cells(self) -> tuple[object, ...]:
        """Cells of a row of a table: name, count, number, rate and interval."""
        low, high = self.interval
        return self.name, self.count, self.n, self.share, f"{low:.1%} to {high:.1%}"


def axes_inside(name: str, findings: Iterable[Outcome]) -> Rate:
    """Count the axes whose truth is within the stated interval."""
    inside = [is_inside for finding in findings for is_inside in finding.axes_inside]
    return Rate(name, sum(inside), len(inside))


def rate_of(name: str, findings: Iterable[Outcome], is_so: Callable[[Outcome], bool]) -> Rate:
    """Count the outcomes of which something is so."""
    listed = list(findings)
    return Rate(name, sum(map(is_so, listed)), len(listed))


def rates_by(
    name: str,
    findings: Sequence[Outcome],
    key: Callable[[Outcome], Hashable],
    values: Iterable[Hashable] | None = None,
    is_so: Callable[[Outcome], bool] | None = None,
) -> list[Rate]:
    """Count part by part.

    Args:
        name: Names of the rates, with `{}` for the value of the part.
        findings: Outcomes.
        key: Value by which the outcomes are parted.
        values: Values of the parts; None for those that occur, in the order of the outcomes.
        is_so: Event that is counted; None counts axes inside their intervals.
    """
    parts = grouped(findings, key)
    chosen = {value: parts.get(value, []) for value in (parts if values is None else values)}
    if is_so is None:
        return [axes_inside(name.format(value), part) for value, part in chosen.items()]
    return [rate_of(name.format(value), part, is_so) for value, part in chosen.items()]
