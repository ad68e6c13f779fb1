"""`semcal verify`: the check whether a transform still holds."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.calibrate_options import RecordingSettings
from semcal_cli.cli.ci import Case, CiReport, Inconclusive, errors_reported
from semcal_cli.cli.convert import DIRECTION
from semcal_cli.cli.options import (
    MAX_LIMIT,
    EstimateSettings,
    LimitSettings,
    inconclusive_choice,
    json_flag,
)
from semcal_cli.cli.rules import none_of
from semcal_cli.cli.settings import argument, command, option, output_file, setting_of
from semcal_cli.cli.stage_options import read_initial_pose
from semcal_cli.config import CalibrationConfig, Limits, RefinementConfig
from semcal_cli.config.directions import Direction
from semcal_cli.errors import InputError, MisplacedError, shell

if TYPE_CHECKING:
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.observations.loading import LoadedDrive
    from semcal_cli.pipeline.verdict import AxisVerdict
    from semcal_cli.pipeline.verification import Verification


@dataclass(frozen=True, kw_only=True)
class VerifySettings(LimitSettings, RecordingSettings, EstimateSettings):
    """Settings of `verify`."""

    rules = [none_of("--cue features", because="feature vectors have no histogram")]
    takes_recordings = True
    drive: Path = argument(metavar="DRIVE|RECORDING|DATASET")
    calibration: Path | None = argument()
    direction: Direction | None = option(DIRECTION.format("CALIBRATION"))
    max_delay_ms: float | None = option(
        "Largest allowed time offset of the camera, which is then estimated, too. Needs `motion:` with poses or a "
        "twist, varying speeds, and turns.",
        above=0.0,
        maximum=MAX_LIMIT,
        metavar="MS",
    )
    as_json: bool = json_flag()
    junit: Path | None = output_file("Also write a JUnit XML file.")
    page: Path | None = output_file("Also write a report of the verdict: .html.", "--report")
    images: Path | None = option(
        "Also draw the points on at most 20 images, at the given transform and at the estimated one.",
        "--overlay",
        metavar="DIR",
    )
    inconclusive: Inconclusive = inconclusive_choice()
    max_baseline_m: float = setting_of(RefinementConfig, "max_baseline_m")
    given: Path | None = None
    """The recording or the data set that the drive was made of; None for a drive of the user's."""

    @cached_property
    def initial_pose(self) -> InitialPose:
        """The transform: that of CALIBRATION, or else the one that the drive states.

        Raises:
            InputError: the file is not a transform, or the drive has none.
        """
        from semcal_cli.drive.document import read_drive

        if self.calibration is not None:
            return read_initial_pose(self.calibration, self.direction, direction_option="--direction")
        given = self.given or self.drive
        if read_drive(self.drive, self.max_points).T_camera_lidar is None:
            advice = f"`{shell('verify', given, 'CALIBRATION')}` takes one from a file"
            raise InputError(f"{given}: found no transform from the sweeps to the images to verify; {advice}")
        pose = read_initial_pose(self.drive, self.direction, direction_option="--direction")
        return replace(pose, name=str(given))

    @property
    def config(self) -> CalibrationConfig:
        """Settings of the estimate."""
        refinement = RefinementConfig(max_baseline_m=self.max_baseline_m)
        return CalibrationConfig(self.seed, self.cues, self.max_frames, refinement=refinement)

    @property
    def limits(self) -> Limits:
        """Limits of the transform and of the clock."""
        delay_s = None if self.max_delay_ms is None else 1e-3 * self.max_delay_ms
        return Limits(self.max_rotation_deg, self.max_translation_m, delay_s)

    def check(self) -> None:
        """Check everything about the options that can be checked without the drive.

        Raises:
            InputError: the calibration is not a transform.
            MisplacedError: it is a recording or a data set.
        """
        from semcal_cli.importing.recognition import recognise

        if self.calibration is None:
            return
        if (source := recognise(self.calibration)) is not None:
            raise MisplacedError(f"{self.calibration}: found {source.name}, expected a calibration")
        _ = self.initial_pose


@command(VerifySettings)
def verify(settings: VerifySettings) -> None:
    """Verify the transform in CALIBRATION on DRIVE. CALIBRATION is {KNOWN_TRANSFORMS}.

    Without CALIBRATION, verify the transform that the drive, the recording (/tf_static) or the data set
    states. A recording (.mcap, .bag, .db3, or a folder of them) or a data set becomes a temporary drive.

    The pose is estimated again, starting from the transform. The limits hold along and about each
    axis of the camera, and in total; --max-delay-ms adds one for the time offset.

    Errors of K do not count where the transform belongs to the K of DRIVE: they move both poses
    alike.

    Exit code 0: every check passes. 3: an offset is beyond its limit, with a certainty of 95 %.
    4: the data are inconclusive; --inconclusive changes this code.
    """
    from semcal_cli.cli.given_source import temporary_drive
    from semcal_cli.cli.outputs import Outputs, loaded_drive
    from semcal_cli.files.output_files import write_text
    from semcal_cli.pipeline.verification import verify as check

    start, read = perf_counter(), [*filter(None, (settings.drive, settings.calibration))]
    subject = ", ".join(map(str, read))
    # The JUnit file must not replace an input; neither must a log.
    outputs = Outputs(log=settings.junit, page=settings.page, images=settings.images)
    with errors_reported("verify", subject, settings.junit, read):
        settings.check()
        with temporary_drive(settings, settings.terminal(), settings.junit, settings.page) as drive:
            given = None if drive == settings.drive else settings.drive
            imported = replace(settings, drive=drive, given=given)
            pose, config = imported.initial_pose, imported.config
            with loaded_drive(imported, config, outputs, pose, as_result_sees=True) as (data, terminal):
                verification = check(data, pose, settings.limits, config, terminal.on_event)
                if outputs.is_illustrated:
                    _illustrate(verification, data, pose, outputs, terminal, given)
    cases = [Case.of_check(check) for check in verification.checks]
    if verification.is_reasoned:
        # No check is judged, so CI counts the drive as a whole.
        cases = [Case("transform", verification.verdict, "; ".join(verification.reasons))]
    seconds = perf_counter() - start
    report = CiReport(
        "verify",
        subject,
        verification.verdict,
        cases,
        verification.reasons,
        verification.topics,
        seconds,
        settings.inconclusive,
    )
    if settings.junit is not None:
        write_text(report.junit(), settings.junit)
    if settings.as_json:
        click.echo(json.dumps(verification.document, allow_nan=False))
    else:
        _print(verification, verbose=settings.verbose)
    report.tell_github()
    sys.exit(report.exit_code)


def _illustrate(
    verification: Verification,
    data: LoadedDrive,
    initial_pose: InitialPose,
    outputs: Outputs,
    terminal: Terminal,
    given: Path | None,
) -> None:
    """Write the page and the images of a verification, if requested."""
    from semcal_cli.cli.outputs import count_images
    from semcal_cli.events import Progress
    from semcal_cli.report import page

    if outputs.page is not None:
        terminal.on_event(Progress("drawing points on images"))
        page.write_verification(verification, data, initial_pose, outputs.page, given)
        terminal.print_paths("report", [outputs.page])
    if outputs.images is not None:
        overlays = page.both_overlays(verification, data, initial_pose)
        terminal.print(count_images([*overlays.write_all(outputs.images)], outputs.images))


def _print(verification: Verification, *, verbose: bool) -> None:
    from semcal_cli.checks import precedence
    from semcal_cli.cli.tables import shown_reasons, verdict_line, wrapped
    from semcal_cli.cli.terminal import COLORS, make_console
    from semcal_cli.pipeline.verdict import overall_offsets

    for check in verification.checks:
        click.echo(_check_line(check, verification.word(check)))
    reasons = shown_reasons(verification.reasons, verification.topics, verbose=verbose)
    rows = [*(("reason", reason) for reason in reasons), *(("note", note) for note in verification.notes)]
    lines = [line for label, sentence in rows for line in wrapped(label, sentence)]
    if not verification.is_reasoned:
        lines += wrapped("", verification.sentence, indent=0)
    click.echo("\n".join(lines))
    num = precedence.leading(verification.topics).num
    decisive = (
        f"{num} reason{'s' * (num > 1)}, see above"
        if verification.is_reasoned
        else overall_offsets(verification.checks)[0]
    )
    console = make_console(stderr=False)
    line = verdict_line(verification.verdict, decisive)
    console.print(line, style=COLORS[verification.verdict], markup=False)


def _check_line(check: AxisVerdict, word: str) -> str:
    from semcal_cli.readable import for_people
    from semcal_cli.result.uncertainty import CHECK_NAMES

    text, allowed = check.text, f"{check.allowed:g} {check.unit}"
    if text.offset:
        half = f" +- {text.half_width}" if text.half_width else ""
        found = f"{for_people(f'{text.offset:>9}{half}'):<18} {check.unit}"
    else:
        found = "not determined".rjust(19)
    name = CHECK_NAMES.get(check.name, check.name)
    return f"{name:<28}{found:<23}allowed {allowed:<8} {word}"
