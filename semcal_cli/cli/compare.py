"""`semcal compare`: two transforms side by side."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.options import json_flag, limit, reference_direction
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import argument, command, option, output_file
from semcal_cli.config import Limits
from semcal_cli.config.directions import Direction

if TYPE_CHECKING:
    from semcal_cli.pipeline.comparison import Axis, Comparison
    from semcal_cli.pipeline.verdict import AxisVerdict, Verdict


@dataclass(frozen=True, kw_only=True)
class CompareSettings:
    """Settings of `compare`."""

    rules = [given("--force").requires("--csv", "--plot")]
    a: Path = argument()
    b: Path = argument()
    others: tuple[Path, ...] = argument(default=(), metavar="[C]...")
    csv: Path | None = output_file("Also write the differences from A to a file: .csv.")
    plot: Path | None = output_file(
        "Also draw the differences from A: .png or .svg; that of one transform as a map over the image, if its camera "
        "is known."
    )
    force: bool = option("Replace the files of --csv and --plot.", default=False)
    reference_direction: Direction | None = reference_direction()
    camera: str | None = option(
        "Name of the camera in files that may hold several, such as P2 of KITTI; others have one.",
        metavar="NAME",
    )
    max_translation_m: float = limit("camera", Limits.translation_m, "M", minimum=0.0)
    max_rotation_deg: float = limit("rotation", Limits.rotation_deg, "DEG", minimum=0.0)
    as_json: bool = json_flag()


@command(CompareSettings)
def compare(settings: CompareSettings) -> None:
    """Compare two transforms, A and B, or several with A. Each is {KNOWN_TRANSFORMS}.

    The difference along each axis of the camera is printed next to the 95 % interval of each transform, and that in
    the image for points 5, 10 and 30 m away, if a calibration or a drive states the camera.

    Exit code 0: they agree. 3: they differ by more than allowed. 4: their uncertainty does not allow a verdict.
    """
    from semcal_cli.cli.compare_several import ComparedFile, table_lines, write_csv, write_maps, write_plot
    from semcal_cli.cli.outputs import PLOTS, check_outputs, check_vacant
    from semcal_cli.cli.tables import verdict_line, wrapped
    from semcal_cli.cli.terminal import COLORS, make_console
    from semcal_cli.files.output_files import check_suffix
    from semcal_cli.formats import read_reference
    from semcal_cli.pipeline.comparison import compare as difference, describe_cameras
    from semcal_cli.pipeline.verdict import together

    check_suffix(settings.plot, *PLOTS)
    check_outputs([settings.a, settings.b, *settings.others], settings.csv, settings.plot)
    check_vacant(settings.csv, settings.plot, force=settings.force)
    paths = [settings.b, *settings.others]
    direction, camera = settings.reference_direction, settings.camera
    tell = partial(click.echo, err=True)
    a, b, *others = extrinsics = [
        read_reference(path, direction, camera, camera_option="--camera", on_note=tell)
        for path in (settings.a, *paths)
    ]
    if camera is not None and not any("camera" in each.asks for each in extrinsics):
        raise click.UsageError(f"--camera {camera}: found no file that may hold several cameras.")
    comparisons = [difference(a, other) for other in (b, *others)]
    judged = [_checks(each, settings) for each in comparisons]
    files = [
        ComparedFile(str(path), each.error, together(check.verdict for check in checks))
        for path, each, checks in zip(paths, comparisons, judged, strict=True)
    ]
    if settings.csv is not None:
        write_csv(files, settings.csv)
    if settings.plot is not None and comparisons[0].in_image and not others:
        write_maps(comparisons[0], str(settings.a), str(settings.b), settings.plot)
    elif settings.plot is not None:
        write_plot(files, settings.plot)
    verdict = together(file.verdict for file in files)
    if others:
        cases = [Case(file.name, file.verdict, file.figures) for file in files]
        several = CiReport("compare", str(settings.a), verdict, cases)
        if settings.as_json:
            rows = [file.error.describe() | {"file": file.name, "verdict": file.verdict} for file in files]
            click.echo(json.dumps(rows, allow_nan=False))
        else:
            decisive = "; ".join(f"{file.name} {file.figures}" for file in files if file.verdict == verdict)
            click.echo("\n".join([*table_lines(files), *_notes(verdict), verdict_line(verdict, decisive)]))
        several.tell_github()
        sys.exit(several.exit_code)
    if (cameras := describe_cameras(a, b)) is not None:
        click.echo("\n".join(wrapped("camera", cameras)), err=True)
    if (note := comparisons[0].note) is not None:
        bars = "; --plot draws bars" if settings.plot is not None else ""
        click.echo("\n".join(wrapped("note", f"{note}{bars}")), err=True)
    comparison, cases = comparisons[0], [Case.of_check(check) for check in judged[0]]
    report = CiReport("compare", f"{settings.a}, {settings.b}", verdict, cases)
    if settings.as_json:
        document = {
            "error": comparison.error.describe(),
            "axes": [asdict(axis) for axis in comparison.axes],
            "in_image": [asdict(difference) for difference in comparison.in_image],
            "same": verdict == "pass",
            "verdict": verdict,
        }
        click.echo(json.dumps(document, allow_nan=False))
    else:
        console = make_console(stderr=False)
        console.print(f"{'':<18}{'A minus B':>12}    {'A: 95 % interval':<18}B: 95 % interval")
        for axis in comparison.axes:
            console.print(_line(axis))
        for line in _image_lines(comparison):
            console.print(line)
        for line in _notes(verdict):
            console.print(line, markup=False)
        decisive = "; ".join(f"{case.name} {case.figures}" for case in cases if case.verdict == verdict)
        console.print(verdict_line(verdict, decisive), style=COLORS[verdict], markup=False)
    report.tell_github()
    sys.exit(report.exit_code)


def _notes(verdict: Verdict) -> list[str]:
    """Name what tells which of two transforms is right, where they differ: no comparison does."""
    from semcal_cli.cli.tables import wrapped

    sentence = "the difference does not tell which of them is right; `semcal verify DRIVE FILE` does"
    return wrapped("note", sentence) if verdict == "fail" else []


def _checks(comparison: Comparison, settings: CompareSettings) -> list[AxisVerdict]:
    """Judge the whole difference between two transforms."""
    from semcal_cli.pipeline.verdict import AxisVerdict

    error = comparison.error
    angle, most_deg = error.rotation_deg, settings.max_rotation_deg
    distance, most_cm = error.camera_center_cm, 100.0 * settings.max_translation_m
    of_rotation = comparison.verdict(angle, most_deg, "deg")
    of_center = comparison.verdict(distance, most_cm, "cm")
    return [
        AxisVerdict("rotation", "deg", angle, comparison.half_width("deg"), most_deg, of_rotation),
        AxisVerdict("camera centre", "cm", distance, comparison.half_width("cm"), most_cm, of_center),
    ]


def _line(axis: Axis) -> str:
    """Describe the difference along an axis with the digits of the intervals, next to these."""
    from semcal_cli.readable import figure, for_people

    halves = [None if half is None else figure(half) for half in (axis.half_width_a, axis.half_width_b)]
    digits = max((len(half.partition(".")[2]) for half in halves if half), default=3)
    a, b = (for_people("not known" if half is None else f"+- {half} {axis.unit}") for half in halves)
    explained = {None: "", True: "explained", False: "more than both"}[axis.is_explained]
    difference = round(axis.difference, digits) + 0.0  # no -0.0
    return f"{axis.name:<18}{difference:8.{digits}f} {axis.unit:<3}    {a:<18}{b:<18}{explained}".rstrip()


def _image_lines(comparison: Comparison) -> list[str]:
    """Write the differences in the image at each range, next to what both intervals allow."""
    if not (differences := comparison.in_image):
        return []
    has_allowed = any(each.allowed_worst_px is not None for each in differences)
    lines = [
        f"{'in the image':<18}{'straight ahead':>15}{'at worst':>13}"
        f"{'    both intervals allow' if has_allowed else ''}"
    ]
    for each in differences:
        ahead, worst = _pixels(each.ahead_px), _pixels(each.worst_px)
        allowed = (
            f"    {_pixels(each.allowed_ahead_px)} and {_pixels(each.allowed_worst_px)}"
            if has_allowed
            else ""
        )
        lines.append(f"{f'{each.range_m:g} m away':<18}{ahead:>15}{worst:>13}{allowed}")
    return lines


def _pixels(value: float | None) -> str:
    from semcal_cli.readable import figure

    return "-" if value is None else f"{figure(round(value, 3))} px"
