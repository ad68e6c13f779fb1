"""Frequency of an event, with its interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from semcal_cli.experiments.outcome import Outcome


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
    def cells(self) -> tuple[object, ...]:
        """Cells of a row of a table: name, count, number, rate and interval."""
        low, high = self.interval
        share = f"{self.count / self.n:.1%}" if self.n else "-"
        return self.name, self.count, self.n, share, f"{low:.1%} to {high:.1%}"


def axes_inside(name: str, findings: Iterable[Outcome]) -> Rate:
    """Count the axes whose truth is within the stated interval."""
    stated = [f for f in findings if f.half_widths]
    inside = [abs(error) <= half for f in stated for error, half in zip(f.errors, f.half_widths, strict=True)]
    return Rate(name, sum(inside), len(inside))


def rate_of(name: str, findings: Iterable[Outcome], is_so: Callable[[Outcome], bool]) -> Rate:
    """Count the outcomes of which something is so."""
    listed = list(findings)
    return Rate(name, sum(map(is_so, listed)), len(listed))
