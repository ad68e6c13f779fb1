"""The summary of an experiment: figures and rates of groups of results, for summary.json and for the table."""

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
    """Header of the column, which may be empty."""
    figures: Mapping[str, Measure]
    """Figures of each group, by key in summary.json."""
    show: Callable[..., object] = str
    """Formats the cell of the table from the values of the figures."""
    field: str = ""
    """Field that all results of a group share; empty for other columns."""


def group_results(results: Iterable[Result], key: Callable[[Result], Key]) -> dict[Key, list[Result]]:
    """Group results by a key, in the order of the results."""
    groups: dict[Key, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return groups


def summarise(results: Iterable[Any], columns: Sequence[Column]) -> list[dict[str, Any]]:
    """Compute the figures of the columns for each group of results, in the order of the results.

    A group is the results with equal values in the fields of the columns.
    """
    fields = [column.field for column in columns if column.field]
    groups = group_results(results, lambda result: tuple(getattr(result, field) for field in fields))
    measures = {key: measure for column in columns for key, measure in column.figures.items()}
    return [{key: measure(group) for key, measure in measures.items()} for group in groups.values()]


def summary_table(rows: Iterable[Mapping[str, Any]], columns: Sequence[Column]) -> str:
    """Format the rows that `summarise` computed as a Markdown table."""
    cells = [[column.show(*(row[key] for key in column.figures)) for column in columns] for row in rows]
    return markdown_table([column.header for column in columns], cells)


def markdown_table(headers: Iterable[str], rows: Iterable[Sequence[object]]) -> str:
    """Format a Markdown table."""
    heads = [f" {header} |" if header else " |" for header in headers]
    lines = [f"|{''.join(heads)}", f"|{len(heads) * '---|'}", *(table_row(*row) for row in rows)]
    return "\n".join(lines) + "\n"


def table_row(*cells: object) -> str:
    """Format a line of a Markdown table."""
    return f"| {' | '.join(map(str, cells))} |"


def measure_of(field: str, measure: Callable[[Sequence[Any]], Any]) -> Measure:
    """Make a measure of one field of the results."""
    return lambda group: measure([getattr(result, field) for result in group])


def common(field: str, header: str, show: Callable[[Any], object] = str) -> Column:
    """Make the column of a field that all results of a group share."""
    return Column(header, {field: measure_of(field, lambda values: values[0])}, show, field)


def cell(header: str, measure: Measure) -> Column:
    """Make a column whose cell is its figure."""
    return Column(header, {header: measure})


def count(header: str, condition: Callable[[Any], bool], key: str = "") -> Column:
    """Make the column of the number of results that meet a condition, whose figure has a key or that of the header."""
    return Column(header, {key or header: lambda group: sum(map(condition, group))})


def digits(number: int) -> Callable[[Sequence[float] | float | None], str]:
    """Make a function that formats values with this many decimals; None becomes an empty cell."""

    def show(values: Sequence[float] | float | None) -> str:
        numbers = values if isinstance(values, Sequence) else () if values is None else (values,)
        return ", ".join(f"{value:.{number}f}" for value in numbers)

    return show


def median(values: Sequence[float]) -> float:
    """Return the median of values."""
    return float(np.median(values))


def distribution(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the median, the 95 % quantile and the worst of errors."""
    # Quantiles are not interpolated, since a value may be infinite.
    return median(values), float(np.quantile(values, 0.95, method="higher")), max(values)


def error_columns(
    figures: str, measure: Callable[[Sequence[float]], Any], deg_digits: int = 4, cm_digits: int = 2
) -> tuple[Column, Column]:
    """Make the columns of the errors of the rotation, in degrees, and of the camera centre, in centimetres."""
    deg, cm = ({field: measure_of(field, measure)} for field in ("rotation_deg", "camera_center_cm"))
    return (
        Column(f"rotation, deg: {figures}", deg, digits(deg_digits)),
        Column(f"camera centre, cm: {figures}", cm, digits(cm_digits)),
    )


NUMBER = Column("n", {"n": len})
"""Number of results."""
ERRORS = error_columns("median, 95 %, worst", distribution)
SECONDS = Column("s", {"seconds": measure_of("seconds", median)}, digits(1))
"""Median time."""
