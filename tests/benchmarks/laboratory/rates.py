"""Rates of events among results with their intervals, and medians with the worst values."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from semcal_cli.experiments.summary import group_results, median

Result = TypeVar("Result")


@dataclass(frozen=True)
class Rate:
    """Frequency of an event, with the binomial 95 % interval of Wilson (1927).

    Runs on one drive and axes of one run are not independent, so their interval is too narrow.
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


def rate_of(name: str, results: Iterable[Result], is_so: Callable[[Result], bool | Sequence[bool]]) -> Rate:
    """Count the results that meet a condition, or the parts of each that do."""
    found = [is_so(result) for result in results]
    flags = [flag for each in found for flag in ([each] if isinstance(each, bool) else each)]
    return Rate(name, sum(flags), len(flags))


def rates_by(
    name: str,
    results: Sequence[Result],
    key: Callable[[Result], Hashable],
    is_so: Callable[[Result], bool | Sequence[bool]],
    values: Iterable[Hashable] | None = None,
) -> list[Rate]:
    """Compute the rate of each group of results.

    Args:
        name: Name of the rates, with `{}` for the value of the group.
        results: Results.
        key: Value by which the results are grouped.
        is_so: Event that is counted, as in `rate_of`.
        values: Values of the groups; None for those that occur, in the order of the results.
    """
    parts = group_results(results, key)
    return [
        rate_of(name.format(value), parts.get(value, []), is_so)
        for value in (parts if values is None else values)
    ]


def median_and_worst(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and the worst of values."""
    return median(values), max(values)
