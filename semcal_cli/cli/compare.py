"""`semcal compare`: two transforms side by side."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.options import KNOWN_TRANSFORMS, PATH, limit_options

if TYPE_CHECKING:
    from semcal_cli.assessment.comparison import Axis
    from semcal_cli.geometry.pose_error import PoseError

EXIT_DIFFERENT = 3


@click.command(
    help=f"Compare the transforms of A and B: {KNOWN_TRANSFORMS}. What differs along each axis of the camera stands "
    "beside the 95 % interval of each. Exit code 3: they differ by more than allowed."
)
@click.argument("a", type=PATH)
@click.argument("b", type=PATH)
@limit_options(may_be_zero=True)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def compare(a: Path, b: Path, max_rotation_deg: float, max_translation_m: float, as_json: bool) -> None:
    """Compare two transforms."""
    from dataclasses import asdict

    from semcal_cli.assessment.comparison import compare as difference
    from semcal_cli.assessment.comparison import read_known
    from semcal_cli.cli.tables import error_lines

    found = difference(read_known(a), read_known(b))
    error = found.error
    is_same = error.rotation_deg <= max_rotation_deg and error.camera_center_cm <= 100.0 * max_translation_m
    if as_json:
        click.echo(json.dumps(asdict(found) | {"same": is_same}, allow_nan=False))
    else:
        for axis in found.axes:
            click.echo(_line(axis))
        for line, allowed in zip(
            error_lines(error), (max_rotation_deg, 100.0 * max_translation_m), strict=True
        ):
            click.echo(f"{line}   allowed {allowed:g}")
        click.echo("within limits" if is_same else "beyond limits")
    _report(f"{a}, {b}", error, max_rotation_deg, 100.0 * max_translation_m).tell_github()
    sys.exit(0 if is_same else EXIT_DIFFERENT)


def _report(subject: str, error: PoseError, allowed_deg: float, allowed_cm: float) -> CiReport:
    """Make a case of each of both differences."""
    parts = (
        ("rotation", error.rotation_deg, "degrees", allowed_deg),
        ("camera centre", error.camera_center_cm, "cm", allowed_cm),
    )
    cases = [
        Case(name, "pass" if found <= allowed else "fail", f"{found:.3f} {unit}, allowed {allowed:g}")
        for name, found, unit, allowed in parts
    ]
    is_same = all(case.verdict == "pass" for case in cases)
    return CiReport("compare", subject, "pass" if is_same else "fail", cases)


def _line(axis: Axis) -> str:
    halves = [
        "not known" if half is None else f"+- {half:.4f}" for half in (axis.half_width_a, axis.half_width_b)
    ]
    verdict = {None: "", True: "   within both", False: "   more than both explain"}[axis.is_explained]
    a, b = (f"{half:<12}" for half in halves)
    difference = round(axis.difference, 4) + 0.0  # no -0.0000
    return f"{axis.name:<16}{difference:10.4f} {axis.unit:<4} A {a} B {b}{verdict}".rstrip()
