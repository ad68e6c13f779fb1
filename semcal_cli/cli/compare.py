"""`semcal compare`: two transforms side by side."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.options import json_flag, limit
from semcal_cli.cli.settings import argument, command
from semcal_cli.config import Limits
from semcal_cli.errors import format_against_limit

if TYPE_CHECKING:
    from semcal_cli.pipeline.comparison import Axis, Comparison


@dataclass(frozen=True, kw_only=True)
class CompareSettings:
    """Settings of `compare`."""

    a: Path = argument()
    b: Path = argument()
    max_translation_m: float = limit("camera", Limits.translation_m, "M", minimum=0.0)
    max_rotation_deg: float = limit("rotation", Limits.rotation_deg, "DEG", minimum=0.0)
    as_json: bool = json_flag()


@command(CompareSettings)
def compare(settings: CompareSettings) -> None:
    """Compare two transforms, A and B. Each is {KNOWN_TRANSFORMS}.

    The difference along each axis of the camera is printed next to the 95 % interval of each transform.

    Exit code 0: they agree. 3: they differ by more than allowed. 4: their uncertainty does not allow a verdict.
    """
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.cli.terminal import COLORS, make_console
    from semcal_cli.formats import read_extrinsic
    from semcal_cli.pipeline.comparison import compare as difference, describe_cameras
    from semcal_cli.pipeline.verdict import together

    a, b = read_extrinsic(settings.a), read_extrinsic(settings.b)
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
