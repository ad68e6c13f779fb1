"""The files that every experiment writes: results, summary with the machine, table and plot."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semcal_cli.experiments.plot_style import plot_png
from semcal_cli.files.writing import write_bytes, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILES = RESULTS, SUMMARY, TABLE, PLOT = "results.csv", "summary.json", "table.md", "plot.png"
"""Files that an experiment writes when all of its cases are run."""


def write_results(
    document: dict[str, object],
    results: Sequence[Any],
    summaries: Sequence[Any],
    table: str,
    draw: Callable[[], Figure] | None,
    folder: Path,
) -> None:
    """Write an experiment's results.csv, summary.json (`document` and rows), table.md, and plot.png if it draws one."""
    file = io.StringIO()
    writer = csv.DictWriter(file, list(vars(results[0])), lineterminator="\n")
    writer.writeheader()
    writer.writerows(vars(result) for result in results)
    write_text(file.getvalue(), folder / RESULTS)
    rows = [vars(summary) for summary in summaries]
    write_text(json.dumps(document | {"rows": rows}, indent=2) + "\n", folder / SUMMARY)
    write_text(table, folder / TABLE)
    if draw is not None:
        write_bytes(plot_png(draw), folder / PLOT)


def markdown_table(header: str, rows: Iterable[Sequence[object]]) -> str:
    """Format a Markdown table; the header is its first line."""
    rule = "|" + (header.count("|") - 1) * "---|"
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return "\n".join([header, rule, *lines]) + "\n"


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
