"""`semcal compare`: two transforms side by side."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.options import json_flag, limit, reference_direction
from semcal_cli.cli.settings import argument, command, output_file
from semcal_cli.config import Limits
from semcal_cli.config.directions import Direction
from semcal_cli.errors import format_against_limit

if TYPE_CHECKING:
    from semcal_cli.cli.compare_several import ComparedFile
    from semcal_cli.pipeline.comparison import Axis, Comparison


@dataclass(frozen=True, kw_only=True)
class CompareSettings:
    """Settings of `compare`."""

    a: Path = argument()
    b: Path = argument()
    others: tuple[Path, ...] = argument(default=(), metavar="[C]...")
    csv: Path | None = output_file("Also write the differences from A to a file: .csv.")
    plot: Path | None = output_file("Also draw the differences from A: .png or .svg.")
    reference_direction: Direction | None = reference_direction()
    max_translation_m: float = limit("camera", Limits.translation_m, "M", minimum=0.0)
    max_rotation_deg: float = limit("rotation", Limits.rotation_deg, "DEG", minimum=0.0)
    as_json: bool = json_flag()


@command(CompareSettings)
def compare(settings: CompareSettings) -> None:
    """Compare two transforms, A and B, or several with A. Each is {KNOWN_TRANSFORMS}.

    The difference along each axis of the camera is printed next to the 95 % interval of each transform.

    Exit code 0: they agree. 3: they differ by more than allowed. 4: their uncertainty does not allow a verdict.
    """
    from semcal_cli.cli.compare_several import check_plot, table_lines, write_csv, write_plot
    from semcal_cli.cli.outputs import check_outputs
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.cli.terminal import COLORS, make_console
    from semcal_cli.formats import read_reference
    from semcal_cli.pipeline.comparison import compare as difference, describe_cameras
    from semcal_cli.pipeline.verdict import together

    check_plot(settings.plot)
    check_outputs([settings.a, settings.b, *settings.others], settings.csv, settings.plot)
    paths = [settings.b, *settings.others]
    a, b, *others = (read_reference(path, settings.reference_direction) for path in (settings.a, *paths))
    if others or settings.csv is not None or settings.plot is not None:
        files = [
            _compared(str(path), difference(a, other), settings)
            for path, other in zip(paths, [b, *others], strict=True)
        ]
        if settings.csv is not None:
            write_csv(files, settings.csv)
        if settings.plot is not None:
            write_plot(files, settings.plot)
    if others:
        if settings.as_json:
            documents = [
                file.error.describe() | {"file": file.name, "verdict": file.verdict} for file in files
            ]
            click.echo(json.dumps(documents, allow_nan=False))
        else:
            click.echo("\n".join(table_lines(files)))
        cases = [Case(file.name, file.verdict, file.figures) for file in files]
        several = CiReport("compare", str(settings.a), together([file.verdict for file in files]), cases)
        several.tell_github()
        sys.exit(several.exit_code)
    comparison = difference(a, b)
    error = comparison.error
    differences = (
        ("rotation", error.rotation_deg, "degrees", settings.max_rotation_deg),
        ("camera centre", error.camera_center_cm, "cm", 100.0 * settings.max_translation_m),
    )
    verdicts = [comparison.verdict(off, allowed, unit[:3]) for _, off, unit, allowed in differences]
    verdict = together(verdicts)
    if (cameras := describe_cameras(a, b)) is not None:
        click.echo("\n".join(wrapped("camera", cameras)), err=True)
    figures = [_figures(comparison, off, unit, allowed) for _, off, unit, allowed in differences]
    names = [name for name, *_ in differences]
    cases = list(map(Case, names, verdicts, figures))
    report = CiReport("compare", f"{settings.a}, {settings.b}", verdict, cases)
    if settings.as_json:
        document = asdict(comparison) | {"error": comparison.error.describe()}
        document |= {"same": verdict == "pass", "verdict": verdict}
        click.echo(json.dumps(document, allow_nan=False))
    else:
        console = make_console(stderr=False)
        console.print(f"{'':<18}{'A minus B':>14}   {'95 % of A':<12}95 % of B")
        for axis in comparison.axes:
            console.print(_line(axis))
        for name, off, unit, allowed in differences:
            console.print(
                f"{name.split()[-1]} overall".ljust(18) + f"{off:10.4f} {unit[:3]:<3}   allowed {allowed:g}"
            )
        line = f"within limits: {error.rotation_deg:.4f} degrees and {error.camera_center_cm:.3f} cm apart"
        if verdict != "pass":
            texts = (case.figures for case in cases if case.verdict == verdict)
            line = f"{'beyond limits' if verdict == 'fail' else 'undecided'}: {'; '.join(texts)}"
        console.print(line, style=COLORS[verdict])
    report.tell_github()
    sys.exit(report.exit_code)


def _compared(name: str, comparison: Comparison, settings: CompareSettings) -> ComparedFile:
    """Judge the difference between two transforms by the limits of the command."""
    from semcal_cli.cli.compare_several import ComparedFile
    from semcal_cli.pipeline.verdict import together

    error = comparison.error
    verdicts = [
        comparison.verdict(error.rotation_deg, settings.max_rotation_deg, "deg"),
        comparison.verdict(error.camera_center_cm, 100.0 * settings.max_translation_m, "cm"),
    ]
    return ComparedFile(name, error, together(verdicts))


def _figures(comparison: Comparison, off: float, unit: str, allowed: float) -> str:
    """Describe a total difference, its limit, and its uncertainty."""
    text, maximum = format_against_limit(off, allowed, 3)
    half = comparison.half_width(unit[:3])
    return f"{text} {unit}, allowed {maximum}" + ("" if half is None else f", known to +- {half:.2f}")


def _line(axis: Axis) -> str:
    """Describe the difference along an axis, next to the intervals."""
    halves = (axis.half_width_a, axis.half_width_b)
    a, b = (f"{'not known' if half is None else f'+- {half:.4f}':<12}" for half in halves)
    explained = {None: "", True: "explained", False: "more than both"}[axis.is_explained]
    difference = round(axis.difference, 4) + 0.0  # no -0.0000
    return f"{axis.name:<18}{difference:10.4f} {axis.unit:<3}   {a}{b}{explained}".rstrip()
