"""The summary of an experiment: figures of each group of results, for summary.json and for the table."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

Result = TypeVar("Result")
Key = TypeVar("Key", bound=Hashable)
Measure = Callable[[Sequence[Any]], Any]
"""Computes a figure of a group of results."""


@dataclass(frozen=True)
class Column:
    """A column of the table, with the figures that it shows."""

    header: str
    """Head of the column, which may be empty."""
    figures: Mapping[str, Measure]
    """What is computed of each group, by its key in summary.json."""
    show: Callable[..., object] = str
    """Formats the cell of the table; it is given the values of the figures."""
    field: str = ""
    """Field that the results of a group have in common; empty for other columns."""


def grouped(results: Iterable[Result], key: Callable[[Result], Key]) -> dict[Key, list[Result]]:
    """Group results by a key, in the order of the results."""
    groups: dict[Key, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return groups


def summarise(results: Iterable[Any], columns: Sequence[Column]) -> list[dict[str, Any]]:
    """Compute the figures of each group of results, in the order of the results.

    Args:
        results: Results of an experiment.
        columns: Columns, whose figures are computed; results with the same values of their fields are a group.
    """
    fields = [column.field for column in columns if column.field]
    groups = grouped(results, lambda result: tuple(getattr(result, field) for field in fields))
    measures = {key: measure for column in columns for key, measure in column.figures.items()}
    return [{key: measure(found) for key, measure in measures.items()} for found in groups.values()]


def summary_table(rows: Iterable[Mapping[str, Any]], columns: Sequence[Column]) -> str:
    """Format the rows that `summarise` computed as a Markdown table."""
    header = "".join(f" {column.header} |" if column.header else " |" for column in columns)
    cells = [[column.show(*(row[key] for key in column.figures)) for column in columns] for row in rows]
    return markdown_table(f"|{header}", cells)


def markdown_table(header: str, rows: Iterable[Sequence[object]]) -> str:
    """Format a Markdown table; the header is its first line."""
    rule = "|" + (header.count("|") - 1) * "---|"
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return "\n".join([header, rule, *lines]) + "\n"


def of(field: str, measure: Callable[[Sequence[Any]], Any]) -> Measure:
    """Compute a figure of one field of the results."""
    return lambda found: measure([getattr(result, field) for result in found])


def common(field: str, header: str, show: Callable[[Any], object] = str) -> Column:
    """Make the column of a field that the results of a group have in common."""
    return Column(header, {field: of(field, lambda values: values[0])}, show, field)


def cell(header: str, measure: Measure) -> Column:
    """Make a column whose cell is its figure."""
    return Column(header, {header: measure})


def count(header: str, key: str, is_so: Callable[[Any], bool]) -> Column:
    """Make the column of the number of results of which something is so."""
    return Column(header, {key: lambda found: sum(map(is_so, found))})


def digits(number: int) -> Callable[[Sequence[float] | float | None], str]:
    """Format values with so many digits behind the point; the cell of no value is empty."""

    def show(values: Sequence[float] | float | None) -> str:
        listed = values if isinstance(values, Sequence) else () if values is None else (values,)
        return ", ".join(f"{value:.{number}f}" for value in listed)

    return show


def median(values: Sequence[float]) -> float:
    """Median of values."""
    return float(np.median(values))


def distribution(values: Sequence[float]) -> tuple[float, float, float]:
    """Median, 95 % quantile and worst of errors."""
    # Quantiles are not interpolated, since a value may be infinite.
    return median(values), float(np.quantile(values, 0.95, method="higher")), max(values)


NUMBER = Column("n", {"n": len})
"""Number of results."""
ERRORS = (
    Column(
        "rotation, deg: median, 95 %, worst", {"rotation_deg": of("rotation_deg", distribution)}, digits(4)
    ),
    Column(
        "camera centre, cm: median, 95 %, worst",
        {"camera_center_cm": of("camera_center_cm", distribution)},
        digits(2),
    ),
)
"""Errors of the rotation in degrees and of the camera centre in centimetres."""
SECONDS = Column("s", {"seconds": of("seconds", median)}, digits(1))
"""Median time."""
