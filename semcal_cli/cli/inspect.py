"""`semcal inspect`: the content of a drive."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import PATH, max_points_option

if TYPE_CHECKING:
    from collections.abc import Mapping

    from semcal_cli.assessment.inspection import DriveReport

NUM_NAMED = 4
"""Number of classes that the table names, the commonest first."""
WIDE = 240
"""Width in columns of the output on a pipe."""


@click.command()
@click.argument("drive", type=PATH)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@max_points_option
def inspect(drive: Path, as_json: bool, max_points: int) -> None:
    """Show what DRIVE holds, frame by frame, and what looks wrong with it.

    Among others it looks for mirrored clouds, a K of another picture size, labels that are shifted against their points
    or pictures, and frames with the same files.
    """
    from dataclasses import asdict

    from semcal_cli.assessment.inspection import inspect as look_through
    from semcal_cli.drive.document import read_drive

    report = look_through(read_drive(drive, max_points))
    if as_json:
        click.echo(json.dumps(asdict(report), indent=2))
        return
    _print(report)


def _print(report: DriveReport) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for name in (
        "sweep",
        "points",
        "no return",
        "ignored",
        "pixels ignored",
        "classes of points",
        "classes of pixels",
        "gap, s",
    ):
        table.add_column(name, justify="left" if "classes" in name or name == "sweep" else "right")
    for frame in report.frames:
        cells = (
            frame.points,
            f"{frame.num_points:,}",
            f"{frame.num_no_returns:,}",
            f"{frame.num_points_ignored:,}",
            f"{frame.num_pixels_ignored:,}",
            _commonest(frame.point_classes),
            _commonest(frame.image_classes),
            "" if frame.gap_s is None else f"{frame.gap_s:.3f}",
        )
        table.add_row(*map(Text, cells))  # names are not markup
    # Lines are cut to the width of the terminal; a pipe gets them whole.
    console = Console(highlight=False, soft_wrap=True)
    if not console.is_terminal:
        console.width = WIDE
    console.print(table)
    low, high = report.elevations_deg
    across, down = report.field_of_view_deg
    lines = {
        "LiDAR": f"{report.pattern}; elevations {low:.1f} to {high:.1f} degrees, {report.azimuths_deg:.0f} of azimuth",
        "camera": f"{across:.1f} x {down:.1f} degrees",
        "both sides": ", ".join(report.shared_classes) or "no class name in common, which does not matter",
    }
    for name, line in lines.items():
        console.print(f"{name:<12}{line}", markup=False)
    suspicions = [*report.suspicions, *(f"{f.points}: {s}" for f in report.frames for s in f.suspicions)]
    for line in suspicions or ["nothing"]:
        console.print(f"{'suspicious':<12}{line}", markup=False)


def _commonest(counts: Mapping[str, int] | None) -> str:
    if counts is None:
        return "no labels"
    names = sorted(counts, key=lambda name: -counts[name])
    more = f" and {len(names) - NUM_NAMED} more" if len(names) > NUM_NAMED else ""
    return ", ".join(names[:NUM_NAMED]) + more
