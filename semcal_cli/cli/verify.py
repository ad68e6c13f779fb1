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

from semcal_cli.cli.ci import CiReport, Inconclusive, errors_reported
from semcal_cli.cli.options import (
    MAX_LIMIT,
    EstimateSettings,
    LimitSettings,
    RecordingSettings,
    inconclusive_choice,
    json_flag,
)
from semcal_cli.cli.rules import FOR_ONE_CAMERA, none_of, refuse
from semcal_cli.cli.settings import argument, option, output_file, setting_of
from semcal_cli.cli.settings_command import command
from semcal_cli.cli.stage_options import as_far_as_named, read_initial_pose
from semcal_cli.cli.written_format import DIRECTION
from semcal_cli.config import CalibrationConfig, Limits, RefinementConfig
from semcal_cli.config.directions import Direction
from semcal_cli.errors import CalibrationError, InputError, MisplacedError, SemcalError, shell

if TYPE_CHECKING:
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.files.point_clouds import SweepCache
    from semcal_cli.many.rig.rig_document import Rig
    from semcal_cli.many.rig.rig_verification import RigVerification
    from semcal_cli.observations.loading import LoadedDrive
    from semcal_cli.pipeline.verification import Verification


@dataclass(frozen=True, kw_only=True)
class VerifySettings(LimitSettings, RecordingSettings, EstimateSettings):
    """Settings of `verify`."""

    rules = [none_of("--cue features", because="feature vectors have no histogram")]
    takes_recordings = True
    drive: Path = argument(metavar="DRIVE|RECORDING|DATASET|RIG")
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
            option = "--direction"
            return read_initial_pose(
                self.calibration, self.direction, direction_option=option, drive=self.drive
            )
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

    def check(self, *, of_rig: bool = False) -> None:
        """Check everything about the options that can be checked without the drive.

        Args:
            of_rig: Whether the calibration is the result of a rig, which is read with its rig.

        Raises:
            InputError: the calibration is not a transform.
            MisplacedError: it is a recording or a data set.
        """
        from semcal_cli.importing.recognition import recognise

        if self.calibration is None:
            return
        if (source := recognise(self.calibration)) is not None:
            raise MisplacedError(f"{self.calibration}: found {source.name}, expected a calibration")
        if not of_rig:
            with as_far_as_named(self.drive):
                _ = self.initial_pose


OF_ONE_CAMERA = ("--direction", "--report", "--frames", "--exclude")
"""Options that make sense for a single camera only."""


@command(VerifySettings)
def verify(settings: VerifySettings) -> None:
    """Verify the transform in CALIBRATION on DRIVE. CALIBRATION is {KNOWN_TRANSFORMS}.

    Without CALIBRATION, verify the transform that the drive, the recording (/tf_static) or the data set
    states. A recording (.mcap, .bag, .db3, or a folder of them) or a data set becomes a temporary drive.
    For a rig.yaml, verify each camera; CALIBRATION is then the folder that semcal calibrate wrote,
    or a file that names the frames of all sensors, such as a URDF.

    The pose is estimated again, starting from the transform. The limits hold along and about each
    axis of the camera, and in total; --max-delay-ms adds one for the time offset.

    Errors of K do not count where the transform belongs to the K of DRIVE: they move both poses
    alike.

    Exit code 0: every check passes. 3: an offset is beyond its limit, with a certainty of 95 %.
    4: the data are inconclusive; --inconclusive changes this code. 1: a camera could not be verified.
    """
    from semcal_cli.cli.given_source import temporary_drive
    from semcal_cli.cli.verdicts import cases_of, print_any
    from semcal_cli.files.output_files import write_text
    from semcal_cli.many.rig.rig_document import find_rig

    start, read = perf_counter(), [*filter(None, (settings.drive, settings.calibration))]
    subject = ", ".join(map(str, read))
    with errors_reported("verify", subject, settings.junit, read):
        rig = find_rig(settings.drive) if settings.drive.exists() else None
        settings.check(of_rig=rig is not None)
        outputs = settings.junit, settings.page
        with temporary_drive(settings.drive, settings, settings.terminal(), *outputs) as drive:
            verification = _verify_given(settings, drive) if rig is None else _verify_rig(rig, settings)
    report = CiReport(
        "verify",
        subject,
        verification.verdict,
        cases_of(verification),
        verification.reasons,
        verification.topics,
        perf_counter() - start,
        settings.inconclusive,
    )
    if settings.junit is not None:
        write_text(report.junit(), settings.junit)
    if settings.as_json:
        click.echo(json.dumps(verification.document, allow_nan=False))
    else:
        print_any(verification, verbose=settings.verbose)
    report.tell_github()
    if verification.verdict == "failed":
        raise CalibrationError(verification.failure)
    sys.exit(report.exit_code)


def _verify_given(settings: VerifySettings, drive: Path) -> Verification:
    """Verify the transform of one camera on a drive, which may be made of what is given."""
    from semcal_cli.cli.outputs import Outputs

    outputs = Outputs(page=settings.page, images=settings.images, others=(settings.junit,))
    given = None if drive == settings.drive else settings.drive
    return _verify_drive(replace(settings, drive=drive, given=given), outputs)


def _verify_drive(
    settings: VerifySettings, outputs: Outputs, sweeps: SweepCache | None = None
) -> Verification:
    """Verify a transform on a drive, and draw what is requested.

    Args:
        settings: The drive, the transform and the limits.
        outputs: Files to write.
        sweeps: Sweeps that several cameras share.
    """
    from semcal_cli.cli.outputs import loaded_drive
    from semcal_cli.pipeline.verification import verify as check

    pose, config = settings.initial_pose, settings.config
    with loaded_drive(settings, config, outputs, pose, sweeps, as_result_sees=True) as (data, terminal):
        verification = check(data, pose, settings.limits, config, terminal.on_event)
        if outputs.is_illustrated:
            _illustrate(verification, data, pose, outputs, terminal, settings.given)
    return verification


def _verify_rig(rig: Rig, settings: VerifySettings) -> RigVerification:
    """Verify the transforms of a rig one after another, reading each sweep once; one that fails stops no other.

    Raises:
        click.UsageError: an option for a single camera is given.
        InputError: the rig, a drive, a transform or an output is wrong, or a camera has no transform.
    """
    from semcal_cli.cli.output_checks import check_image_folder, check_outputs
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.tables import labelled
    from semcal_cli.files.point_clouds import SweepCache
    from semcal_cli.many.rig.rig_result import check_one_each, transforms_of
    from semcal_cli.many.rig.rig_verification import RigVerification

    refuse(click.get_current_context(), OF_ONE_CAMERA, FOR_ONE_CAMERA.format(rig.path))
    transforms = transforms_of(rig, rig.read_drives(settings.max_points), settings.calibration)
    files, failures, read = transforms
    check_outputs(read, settings.junit)
    images = {name: None if settings.images is None else settings.images / name for name in files}
    for folder in filter(None, (settings.images, *images.values())):
        check_image_folder(folder, read)
    views, sweeps, terminal = rig.views, SweepCache(), settings.terminal()
    cameras = {
        name: replace(settings, drive=rig.path.parent / views[name].drive, calibration=file)
        for name, file in files.items()
    }
    # All transforms are read before the first estimate.
    stated = {name: camera.initial_pose.T_camera_lidar for name, camera in cameras.items()}
    check_one_each(rig, transforms, stated)
    verifications = {}
    for name, camera in cameras.items():
        terminal.print(f"[{name}]")
        try:
            verifications[name] = _verify_drive(camera, Outputs(images=images[name]), sweeps)
        except SemcalError as error:
            failures[name] = str(error)
            terminal.print(labelled("failed", failures[name]))
    return RigVerification(views, stated, verifications, failures)


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
        terminal.print_path("report", outputs.page)
    if outputs.images is not None:
        overlays = page.both_overlays(verification, data, initial_pose)
        terminal.print(count_images([*overlays.write_all(outputs.images)], outputs.images))
