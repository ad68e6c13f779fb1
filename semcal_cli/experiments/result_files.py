"""The files that every experiment writes: results, summary with the machine, table and plot."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semcal_cli.experiments.plot_style import plot_png
from semcal_cli.experiments.summary import Column, summarise, summary_table
from semcal_cli.files.writing import write_bytes, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILES = RESULTS, SUMMARY, TABLE, PLOT = "results.csv", "summary.json", "table.md", "plot.png"
"""Files that an experiment writes when all of its cases are run."""


@dataclass(frozen=True)
class Report:
    """What an experiment writes beside its results."""

    rows: Sequence[Mapping[str, Any]]
    """Rows of the summary."""
    table: str
    """Markdown of the table."""
    draw: Callable[[], Figure] | None = None
    """Draws the plot; None without one."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Entries of the summary before its rows."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """Texts of further files, by their names."""

    @classmethod
    def of(
        cls,
        results: Sequence[Any],
        columns: Sequence[Column],
        draw: Callable[[], Figure] | None = None,
        facts: Mapping[str, Any] | None = None,
    ) -> Report:
        """Sum up the results of each group, in the columns of the table."""
        rows = summarise(results, columns)
        return cls(rows, summary_table(rows, columns), draw, facts or {})


def write_report(
    name: str, results: Sequence[Any], report: Report, folder: Path, num_jobs: int | None = None
) -> None:
    """Write results.csv, summary.json with this machine, table.md, and plot.png if there is a plot.

    Args:
        name: Name of the experiment.
        results: Results, dataclasses of one class.
        report: What is written of them.
        folder: Folder of the files.
        num_jobs: Number of cases that ran at a time; None leaves it out of the summary.

    Raises:
        InputError: a file cannot be written.
    """
    file = io.StringIO()
    writer = csv.DictWriter(file, list(vars(results[0])), lineterminator="\n")
    writer.writeheader()
    writer.writerows(vars(result) for result in results)
    write_text(file.getvalue(), folder / RESULTS)
    jobs = {} if num_jobs is None else {"jobs": num_jobs}
    document = {"experiment": name, "machine": machine(), **jobs, **report.facts, "rows": report.rows}
    write_text(json.dumps(document, indent=2) + "\n", folder / SUMMARY)
    write_text(report.table, folder / TABLE)
    if report.draw is not None:
        write_bytes(plot_png(report.draw), folder / PLOT)
    for file_name, text in report.texts.items():
        write_text(text, folder / file_name)


def machine() -> dict[str, object]:
    """Describe this machine."""
    return {
        "semcal": version("semcal"),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
