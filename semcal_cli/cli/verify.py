"""`semcal verify`: the check whether a transform still holds."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.ci import (
    Case,
    CiReport,
    Inconclusive,
    errors_reported,
    inconclusive_option,
)
from semcal_cli.cli.convert import DIRECTIONS
from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    MAX_LIMIT,
    PATH,
    FiniteRange,
    RunOptions,
    asked,
    cue_option,
    drive_argument,
    json_only_option,
    junit_option,
    limit_options,
    max_baseline_option,
    max_frames_option,
    max_points_option,
    overlay_option,
    quiet_option,
    report_option,
    seed_option,
    threads_option,
)
from semcal_cli.cli.rules import CheckedCommand, none_of
from semcal_cli.cli.search import read_initial_pose
from semcal_cli.config import CalibrationConfig, Limits, RefinementConfig

if TYPE_CHECKING:
    from semcal_cli.assessment.limits import Check
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.loading import LoadedDrive
    from semcal_cli.initialization.initial_pose import InitialPose
    from semcal_cli.pipeline.verification import Verification


@click.command(
    cls=CheckedCommand,
    rules=[none_of("--cue features", because="vectors have no exact histogram")],
    help=f"""Verify the transform of CALIBRATION on DRIVE: {KNOWN_TRANSFORMS}.

    The pose is estimated again, starting at the transform. Limits are along and about each
    axis of the camera, and in all; --max-delay-ms is that of its clock. Exit code 0: each passes.
    3: an offset lies beyond its limit with its whole 95 % interval. 4: the data cannot decide;
    --inconclusive makes it another one.
    """,
)
@drive_argument
@click.argument("calibration", type=PATH)
@click.option(
    "--direction",
    type=click.Choice(DIRECTIONS),
    help="Direction of a bare matrix in CALIBRATION: p_camera = T p_lidar, or p_lidar = T p_camera.",
)
@limit_options(may_be_zero=False)
@click.option(
    "--max-delay-ms",
    type=FiniteRange(0.0, MAX_LIMIT, min_open=True),
    metavar="MS",
    help="Largest allowed offset of the camera's clock, which is estimated as well then. Needs `motion:` with poses "
    "or a twist, different speeds, and turns.",
)
@json_only_option
@junit_option
@report_option("the verdict")
@overlay_option(
    "Also draw the points on at most 20 pictures, as the transform and as the one that was found put them."
)
@inconclusive_option
@max_baseline_option
@seed_option
@threads_option
@max_frames_option
@max_points_option
@cue_option
@quiet_option
def verify(
    drive: Path,
    as_json: bool,
    junit: Path | None,
    page: Path | None,
    images: Path | None,
    inconclusive: Inconclusive,
    **options: Any,
) -> None:
    """Verify a transform on a drive."""
    from semcal_cli.cli.drive import loaded_drive
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.files.writing import write_text
    from semcal_cli.pipeline.verification import verify as check

    start, subject = perf_counter(), f"{drive}, {options['calibration']}"
    # The JUnit file must not replace an input; neither must a log.
    outputs = Outputs(log=junit, page=page, images=images)
    with errors_reported("verify", subject, junit, [drive, options["calibration"]]):
        initial_pose, config, limits = settings_of(options)
        run = asked(RunOptions, options)
        with loaded_drive(drive, config, outputs, run, initial_pose, as_result_sees=True) as (
            data,
            terminal,
        ):
            found = check(data, initial_pose, limits, config, terminal.on_event)
            _illustrate(found, data, initial_pose, outputs, terminal)
    cases = [Case.of_check(check) for check in found.checks]
    seconds = perf_counter() - start
    report = CiReport("verify", subject, found.verdict, cases, found.reasons, seconds, inconclusive)
    if junit is not None:
        write_text(report.junit(), junit)
    _print(found, as_json)
    report.tell_github()
    sys.exit(report.exit_code)


def _illustrate(
    found: Verification, data: LoadedDrive, initial_pose: InitialPose, outputs: Outputs, terminal: Terminal
) -> None:
    """Write the page and the pictures of a verification, where requested."""
    if outputs.page is None and outputs.images is None:
        return
    from semcal_cli.cli.tables import labelled
    from semcal_cli.drive.events import Progress
    from semcal_cli.report.verification import both_overlays, write_verification

    if outputs.page is not None:
        terminal.on_event(Progress("drawing points on pictures"))
        write_verification(found, data, initial_pose, outputs.page)
        terminal.print(labelled("report", str(outputs.page)))
    if outputs.images is not None:
        for path in both_overlays(found, data, initial_pose).write_all(outputs.images):
            terminal.print(labelled("picture", str(path)))


def settings_of(options: Mapping[str, Any]) -> tuple[InitialPose, CalibrationConfig, Limits]:
    """Check all that can be said about the options without the drive, and make settings of them.

    Raises:
        InputError: the calibration is not a transform.
    """
    refinement = RefinementConfig(max_baseline_m=options["max_baseline_m"])
    config = CalibrationConfig(options["seed"], options["cues"], options["max_frames"], refinement=refinement)
    delay_ms = options["max_delay_ms"]
    limits = Limits(
        options["max_rotation_deg"],
        options["max_translation_m"],
        None if delay_ms is None else 1e-3 * delay_ms,
    )
    calibration, direction = options["calibration"], options["direction"]
    return read_initial_pose(calibration, direction, direction_option="--direction"), config, limits


def _print(found: Verification, as_json: bool) -> None:
    if as_json:
        import json
        from dataclasses import asdict

        click.echo(
            json.dumps(asdict(found) | {"T_camera_lidar": found.T_camera_lidar.tolist()}, allow_nan=False)
        )
        return
    from rich.console import Console

    from semcal_cli.assessment.limits import offsets_in_all
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.cli.terminal import COLORS

    for check in found.checks:
        click.echo(_check_line(check))
    for sentence in (*found.reasons, *found.notes, found.sentence):
        for line in wrapped("", sentence, indent=0):
            click.echo(line)
    worst = offsets_in_all(found.checks)[0]
    console = Console(highlight=False, soft_wrap=True, emoji=False)
    console.print(f"{found.verdict}: {worst}", style=COLORS[found.verdict], markup=False)


def _check_line(check: Check) -> str:
    half = "   not known" if check.half_width is None else f"+- {check.half_width:9.4f}"
    found = (
        f"{round(check.offset, 4) + 0.0:.4f} {half:<12}" if check.has_estimate else "not determined"
    )  # no -0.0000
    return f"{check.name:<21}{found:>23} {check.unit:<4} allowed {check.allowed:<8g}{check.verdict}"
