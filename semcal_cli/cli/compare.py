"""`semcal compare`: two transforms side by side."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import EXIT_CODES, Case, CiReport
from semcal_cli.cli.options import KNOWN_TRANSFORMS, json_flag, limit
from semcal_cli.cli.settings import argument, command
from semcal_cli.config import Limits

if TYPE_CHECKING:
    from semcal_cli.assessment.comparison import Axis


@dataclass(frozen=True, kw_only=True)
class CompareSettings:
    """What the options of `compare` say."""

    a: Path = argument()
    b: Path = argument()
    max_translation_m: float = limit("camera", Limits.translation_m, "M", least=0.0)
    max_rotation_deg: float = limit("rotation", Limits.rotation_deg, "DEG", least=0.0)
    as_json: bool = json_flag()


@command(
    CompareSettings,
    help=f"Compare the transforms of A and B: {KNOWN_TRANSFORMS}. What differs along each axis of the camera stands "
    "beside the 95 % interval of each. Exit code 3: they differ by more than allowed.",
)
def compare(settings: CompareSettings) -> None:
    """Compare two transforms."""
    from rich.console import Console

    from semcal_cli.assessment.comparison import compare as difference
    from semcal_cli.assessment.comparison import describe_cameras
    from semcal_cli.cli.tables import labelled
    from semcal_cli.cli.terminal import COLORS
    from semcal_cli.formats import read_extrinsic

    known_a, known_b = read_extrinsic(settings.a), read_extrinsic(settings.b)
    found = difference(known_a, known_b)
    error = found.error
    differences = (
        ("rotation", error.rotation_deg, "degrees", settings.max_rotation_deg),
        ("camera centre", error.camera_center_cm, "cm", 100.0 * settings.max_translation_m),
    )
    beyond = [each for each in differences if each[1] > each[3]]
    if (cameras := describe_cameras(known_a, known_b)) is not None:
        click.echo(labelled("camera", cameras), err=True)
    cases = [
        Case(name, "pass" if off <= allowed else "fail", f"{off:.3f} {unit}, allowed {allowed:g}")
        for name, off, unit, allowed in differences
    ]
    subject = f"{settings.a}, {settings.b}"
    report = CiReport("compare", subject, "fail" if beyond else "pass", cases)
    if settings.as_json:
        click.echo(json.dumps(asdict(found) | {"same": not beyond}, allow_nan=False))
    else:
        console = Console(highlight=False, soft_wrap=True, emoji=False)
        console.print(f"{'':<18}{'A minus B':>14}   {'95 % of A':<12}95 % of B")
        for axis in found.axes:
            console.print(_line(axis))
        for name, off, unit, allowed in differences:
            console.print(
                f"{name.split()[-1]} in all".ljust(18) + f"{off:10.4f} {unit[:3]:<3}   allowed {allowed:g}"
            )
        verdict = f"within limits: {error.rotation_deg:.4f} degrees and {error.camera_center_cm:.3f} cm apart"
        if beyond:
            told = (f"{off:.4g} {unit}, allowed {allowed:g}" for _, off, unit, allowed in beyond)
            verdict = f"beyond limits: {'; '.join(told)}"
        console.print(verdict, style=COLORS[report.verdict])
    report.tell_github()
    sys.exit(EXIT_CODES[report.verdict])


def _line(axis: Axis) -> str:
    """Describe what differs along an axis, beside the intervals."""
    halves = (axis.half_width_a, axis.half_width_b)
    a, b = (f"{'not known' if half is None else f'+- {half:.4f}':<12}" for half in halves)
    explained = {None: "", True: "explained", False: "more than both"}[axis.is_explained]
    difference = round(axis.difference, 4) + 0.0  # no -0.0000
    return f"{axis.name:<18}{difference:10.4f} {axis.unit:<3}   {a}{b}{explained}".rstrip()
