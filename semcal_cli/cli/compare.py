"""`semcal compare`: two transforms side by side."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.options import json_flag, limit, reference_direction
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import argument, option, output_file
from semcal_cli.cli.settings_command import command
from semcal_cli.config import Limits
from semcal_cli.config.directions import Direction

if TYPE_CHECKING:
    from semcal_cli.cli.compare_several import ComparedFile
    from semcal_cli.formats.semcal import Extrinsic
    from semcal_cli.pipeline.comparison import Axis, Comparison
    from semcal_cli.pipeline.verdict import AxisVerdict


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
    from semcal_cli.cli.compare_several import ComparedFile, show_several
    from semcal_cli.cli.output_checks import PLOTS, check_outputs, check_vacant
    from semcal_cli.files.output_files import check_suffix
    from semcal_cli.pipeline.comparison import compare as compare_transforms, describe_cameras
    from semcal_cli.pipeline.verdict import together

    paths = [settings.b, *settings.others]
    check_suffix(settings.plot, *PLOTS)
    check_outputs([settings.a, *paths], settings.csv, settings.plot)
    check_vacant(settings.csv, settings.plot, force=settings.force)
    a, *others = _read_transforms(settings)
    comparisons = [compare_transforms(a, other) for other in others]
    checks = [_checks(comparison, settings) for comparison in comparisons]
    files = [
        ComparedFile(str(path), comparison.error, together(check.verdict for check in file_checks))
        for path, comparison, file_checks in zip(paths, comparisons, checks, strict=True)
    ]
    _write_files(settings, files, comparisons)
    if settings.others:
        report = show_several(files, str(settings.a), as_json=settings.as_json)
    else:
        _print_notes(settings, describe_cameras(a, others[0]), comparisons[0].note)
        report = _show_two(settings, comparisons[0], checks[0])
    report.tell_github()
    sys.exit(report.exit_code)


def _read_transforms(settings: CompareSettings) -> list[Extrinsic]:
    """Read A and the transforms to compare with it.

    Raises:
        click.UsageError: a camera is named, and no file may hold several.
        InputError: a file is missing or wrong.
    """
    from semcal_cli.formats import read_reference

    camera = settings.camera
    print_note = partial(click.echo, err=True)
    extrinsics = [
        read_reference(
            path, settings.reference_direction, camera, camera_option="--camera", on_note=print_note
        )
        for path in (settings.a, settings.b, *settings.others)
    ]
    if camera is not None and not any("camera" in extrinsic.asks for extrinsic in extrinsics):
        raise click.UsageError(f"--camera {camera}: found no file that may hold several cameras.")
    return extrinsics


def _write_files(
    settings: CompareSettings, files: Sequence[ComparedFile], comparisons: Sequence[Comparison]
) -> None:
    """Write the table and the plot, if requested: maps of one transform, or bars."""
    from semcal_cli.cli.compare_several import write_csv, write_maps, write_plot

    if settings.csv is not None:
        write_csv(files, settings.csv)
    if settings.plot is None:
        return
    if len(comparisons) == 1 and comparisons[0].in_image:
        write_maps(comparisons[0], str(settings.a), str(settings.b), settings.plot)
    else:
        write_plot(files, settings.plot)


def _print_notes(settings: CompareSettings, cameras: str | None, note: str | None) -> None:
    """Print how the cameras of two transforms differ, and why there is no difference in the image."""
    from semcal_cli.cli.tables import wrapped

    if cameras is not None:
        click.echo("\n".join(wrapped("camera", cameras)), err=True)
    if note is not None:
        bars = "; --plot draws bars" if settings.plot is not None else ""
        click.echo("\n".join(wrapped("note", f"{note}{bars}")), err=True)


def _show_two(settings: CompareSettings, comparison: Comparison, checks: Sequence[AxisVerdict]) -> CiReport:
    """Print the differences between two transforms and the verdict on them."""
    from semcal_cli.cli.compare_several import notes_on
    from semcal_cli.cli.tables import verdict_line
    from semcal_cli.cli.terminal import COLORS, make_console
    from semcal_cli.pipeline.verdict import together

    verdict = together(check.verdict for check in checks)
    cases = [Case.of_check(check) for check in checks]
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
        for line in [*map(_line, comparison.axes), *_image_lines(comparison)]:
            console.print(line)
        for line in notes_on(verdict):
            console.print(line, markup=False)
        decisive = "; ".join(f"{case.name} {case.figures}" for case in cases if case.verdict == verdict)
        console.print(verdict_line(verdict, decisive), style=COLORS[verdict], markup=False)
    return CiReport("compare", f"{settings.a}, {settings.b}", verdict, cases)


def _checks(comparison: Comparison, settings: CompareSettings) -> list[AxisVerdict]:
    """Judge the whole difference between two transforms."""
    from semcal_cli.pipeline.verdict import AxisVerdict

    error = comparison.error
    angle, most_deg = error.rotation_deg, settings.max_rotation_deg
    distance, most_cm = error.camera_center_cm, 100.0 * settings.max_translation_m
    rotation_verdict = comparison.verdict(angle, most_deg, "deg")
    center_verdict = comparison.verdict(distance, most_cm, "cm")
    return [
        AxisVerdict("rotation", "deg", angle, comparison.half_width("deg"), most_deg, rotation_verdict),
        AxisVerdict("camera centre", "cm", distance, comparison.half_width("cm"), most_cm, center_verdict),
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
    has_allowed = any(difference.allowed_worst_px is not None for difference in differences)
    lines = [
        f"{'in the image':<18}{'straight ahead':>15}{'at worst':>13}"
        f"{'    both intervals allow' if has_allowed else ''}"
    ]
    for difference in differences:
        ahead, worst = _pixels(difference.ahead_px), _pixels(difference.worst_px)
        allowed = (
            f"    {_pixels(difference.allowed_ahead_px)} and {_pixels(difference.allowed_worst_px)}"
            if has_allowed
            else ""
        )
        lines.append(f"{f'{difference.range_m:g} m away':<18}{ahead:>15}{worst:>13}{allowed}")
    return lines


def _pixels(value: float | None) -> str:
    from semcal_cli.readable import figure

    return "-" if value is None else f"{figure(round(value, 3))} px"
