"""Several transforms beside a first one: a table, a verdict, a CSV file and a plot."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.output_checks import PLOTS
from semcal_cli.cli.tables import verdict_line, wrapped
from semcal_cli.errors import printable
from semcal_cli.files.output_files import write_bytes, write_text
from semcal_cli.pipeline.verdict import together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from semcal_cli.geometry.poses import PoseError
    from semcal_cli.pipeline.comparison import Comparison
    from semcal_cli.pipeline.verdict import Verdict

PLOT_INCHES = 8.0, 4.0
COLUMNS = (
    "file",
    "rotation_deg",
    "camera_center_cm",
    *(f"rotation_{axis}_deg" for axis in "xyz"),
    *(f"camera_center_{axis}_cm" for axis in "xyz"),
    "verdict",
)


@dataclass(frozen=True)
class ComparedFile:
    """A transform beside the first one."""

    name: str
    error: PoseError
    verdict: Verdict

    @property
    def figures(self) -> str:
        """The whole differences, in degrees and centimetres."""
        return f"{self.error.rotation_deg:.3f} degrees, {self.error.camera_center_cm:.2f} cm"

    def row(self) -> list[str]:
        """Write the numbers of the columns, in degrees and centimetres."""
        turns, shifts = (
            np.degrees(self.error.rotation_xyz_rad),
            100.0 * np.array(self.error.camera_center_xyz_m),
        )
        numbers = [self.error.rotation_deg, self.error.camera_center_cm, *turns.tolist(), *shifts.tolist()]
        return [self.name, *(f"{number + 0.0:.6f}" for number in numbers), self.verdict]


def show_several(files: Sequence[ComparedFile], first: str, *, as_json: bool) -> CiReport:
    """Print the differences of several transforms from a first one, and the verdict on all of them.

    Args:
        files: The transforms.
        first: Name of the first one.
        as_json: Whether they are printed as JSON, without the verdict.
    """
    verdict = together(file.verdict for file in files)
    if as_json:
        rows = [file.error.describe() | {"file": file.name, "verdict": file.verdict} for file in files]
        click.echo(json.dumps(rows, allow_nan=False))
    else:
        decisive = "; ".join(f"{file.name} {file.figures}" for file in files if file.verdict == verdict)
        click.echo("\n".join([*_table_lines(files), *notes_on(verdict), verdict_line(verdict, decisive)]))
    return CiReport(
        "compare", first, verdict, [Case(file.name, file.verdict, file.figures) for file in files]
    )


def notes_on(verdict: Verdict) -> list[str]:
    """Describe how to learn which of the transforms is right, if they differ."""
    sentence = "the difference does not tell which of them is right; `semcal verify DRIVE FILE` does"
    return wrapped("note", sentence) if verdict == "fail" else []


def _table_lines(files: Sequence[ComparedFile]) -> list[str]:
    """Write a line for each transform."""
    names = [printable(file.name) for file in files]
    width = max(map(len, names))
    lines = [f"{'':<{width}}  {'rotation':>13}  {'camera centre':>13}"]
    for name, file in zip(names, files, strict=True):
        turn, shift = f"{file.error.rotation_deg:.3f} deg", f"{file.error.camera_center_cm:.2f} cm"
        lines.append(f"{name:<{width}}  {turn:>13}  {shift:>13}  {file.verdict}")
    return lines


def write_csv(files: Sequence[ComparedFile], path: Path) -> None:
    """Write the table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([COLUMNS, *(file.row() for file in files)])
    write_text(text.getvalue(), path)


def write_maps(comparison: Comparison, a: str, b: str, path: Path) -> None:
    """Draw how far apart two transforms put the same points, over the image."""
    from semcal_cli.report import image_maps

    names = [Path(name).name for name in (a, b)]
    if names[0] == names[1]:  # results of a batch have one name
        names = [a, b]
    title = f"Difference in the image, {printable(names[1])} from {printable(names[0])}"
    write_bytes(image_maps.maps_file(comparison.maps, title, PLOTS[path.suffix.lower()]), path)


def write_plot(files: Sequence[ComparedFile], path: Path) -> None:
    """Draw the differences as bars, a panel for rotation and one for the camera centre."""
    from semcal_cli.report import drawing

    names = [Path(file.name).stem for file in files]
    if len({*names}) < len(names):  # results of a batch have one name
        names = [printable(file.name) for file in files]
    colors = [drawing.BAD if file.verdict == "fail" else drawing.ACCENT for file in files]

    def draw(figure: Figure) -> None:
        values = {
            "rotation, degrees": [file.error.rotation_deg for file in files],
            "camera centre, cm": [file.error.camera_center_cm for file in files],
        }
        for axes, (title, numbers) in zip(figure.subplots(1, 2), values.items(), strict=True):
            axes.barh(range(len(files)), numbers, color=colors)
            axes.set_yticks(range(len(files)), names, parse_math=False)
            axes.invert_yaxis()
            axes.set_title(title, loc="left")

    write_bytes(drawing.figure_file(draw, PLOT_INCHES, PLOTS[path.suffix.lower()]), path)
