"""`semcal compare`: two transforms side by side."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.options import KNOWN_TRANSFORMS, PATH, json_only_option, limit_options

if TYPE_CHECKING:
    from semcal_cli.assessment.comparison import Axis, Comparison
    from semcal_cli.geometry.pose_error import PoseError

EXIT_DIFFERENT = 3


@click.command(
    help=f"Compare the transforms of A and B: {KNOWN_TRANSFORMS}. What differs along each axis of the camera stands "
    "beside the 95 % interval of each. Exit code 3: they differ by more than allowed."
)
@click.argument("a", type=PATH)
@click.argument("b", type=PATH)
@limit_options(may_be_zero=True)
@json_only_option
def compare(a: Path, b: Path, max_rotation_deg: float, max_translation_m: float, as_json: bool) -> None:
    """Compare two transforms."""
    from dataclasses import asdict

    from rich.console import Console

    from semcal_cli.assessment.comparison import compare as difference
    from semcal_cli.assessment.comparison import describe_cameras
    from semcal_cli.cli.tables import labelled
    from semcal_cli.formats import read_extrinsic

    known_a, known_b = read_extrinsic(a), read_extrinsic(b)
    found = difference(known_a, known_b)
    error, allowed_cm = found.error, 100.0 * max_translation_m
    is_same = error.rotation_deg <= max_rotation_deg and error.camera_center_cm <= allowed_cm
    if (cameras := describe_cameras(known_a, known_b)) is not None:
        click.echo(labelled("camera", cameras), err=True)
    if as_json:
        click.echo(json.dumps(asdict(found) | {"same": is_same}, allow_nan=False))
    else:
        console = Console(highlight=False, soft_wrap=True, emoji=False)
        for line in _lines(found, max_rotation_deg, allowed_cm):
            console.print(line)
        style = "bold green" if is_same else "bold red"
        console.print(_verdict(error, max_rotation_deg, allowed_cm), style=style)
    _report(f"{a}, {b}", error, max_rotation_deg, allowed_cm).tell_github()
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


def _lines(found: Comparison, allowed_deg: float, allowed_cm: float) -> list[str]:
    """List what differs along each axis beside the intervals, and in all beside what is allowed."""
    error = found.error
    return [
        f"{'':<18}{'A minus B':>14}   {'95 % of A':<12}95 % of B",
        *map(_line, found.axes),
        f"{'rotation in all':<18}{error.rotation_deg:10.4f} deg   allowed {allowed_deg:g}",
        f"{'centre in all':<18}{error.camera_center_cm:10.4f} cm    allowed {allowed_cm:g}",
    ]


def _line(axis: Axis) -> str:
    halves = [
        "not known" if half is None else f"+- {half:.4f}" for half in (axis.half_width_a, axis.half_width_b)
    ]
    explained = {None: "", True: "explained", False: "more than both"}[axis.is_explained]
    a, b = (f"{half:<12}" for half in halves)
    difference = round(axis.difference, 4) + 0.0  # no -0.0000
    return f"{axis.name:<18}{difference:10.4f} {axis.unit:<3}   {a}{b}{explained}".rstrip()


def _verdict(error: PoseError, allowed_deg: float, allowed_cm: float) -> str:
    """Say which limits are kept, with the figures."""
    beyond = [
        f"{found:.4g} {unit}, allowed {allowed:g}"
        for found, unit, allowed in (
            (error.rotation_deg, "degrees", allowed_deg),
            (error.camera_center_cm, "cm", allowed_cm),
        )
        if found > allowed
    ]
    if beyond:
        return f"beyond limits: {'; '.join(beyond)}"
    return f"within limits: {error.rotation_deg:.4f} degrees and {error.camera_center_cm:.3f} cm apart"
