"""The output files of a calibration, checked before the work begins and written after it, and how a drive is loaded."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from semcal_cli.checks import precedence
from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.output_checks import check_image_folder, check_outputs, check_page, files_read, folder_of
from semcal_cli.cli.tables import figures, labelled, shown_reasons, summary_lines, verdict_lines
from semcal_cli.cli.terminal import Terminal
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, counted, shell
from semcal_cli.files.documents import output_format, read_document
from semcal_cli.files.output_files import (
    STANDARD_OUTPUT,
    check_descriptor,
    write_text,
)
from semcal_cli.observations.frame_selection import evenly_spaced
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.result.applied import apply_result, cues_applied
from semcal_cli.result.calibration_document import calibration_text, read_calibration, write_calibration
from semcal_cli.result.next_steps import after_calibration
from semcal_cli.result.provenance import with_provenance
from semcal_cli.threads import set_num_threads

if TYPE_CHECKING:
    from semcal_cli.cli.options import ResultSettings, RunSettings
    from semcal_cli.config import CalibrationConfig
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.files.point_clouds import SweepCache
    from semcal_cli.formats.format import FormatOptions
    from semcal_cli.many.rig.rig_calibration import RigCalibration
    from semcal_cli.pipeline.verdict import Verdict
    from semcal_cli.result.calibration_document import CalibrationDocument

EXIT_NOT_TRUSTED = 3
OWN_RESULTS = {"semcal_calibration", "semcal_transform"}
"""Version keys of the files that a new result may replace."""
MAX_IMAGES = 20
"""Largest number of frames with an overlay, evenly spaced."""


@dataclass(frozen=True)
class Outputs:
    """Output files of a calibration; None for those not requested."""

    output: Path | None = None
    """File of the result; None is standard output."""
    log: Path | None = None
    """File of times, host and threads."""
    to: tuple[str, FormatOptions] | None = None
    """Format to write the bare transform in, instead of the whole result."""
    page: Path | None = None
    """File of the report."""
    images: Path | None = None
    """Folder of the overlays."""
    as_json: bool = False
    """Whether the result is printed as JSON, with nothing else on standard output."""
    has_next_steps: bool = True
    """Whether possible next commands are named after the verdict."""
    replaces_any: bool = True
    """Whether any existing file is replaced by the result, and not only a calibration of semcal."""
    names_commands: bool = False
    """Whether the command that makes the report or the overlays alone is printed with them."""
    others: tuple[Path | None, ...] = ()
    """Files that the command writes itself, which are only checked; None for those not requested."""

    @classmethod
    def of_result(cls, settings: ResultSettings) -> Outputs:
        """Make the outputs that all commands with a calibration share."""
        return cls(settings.output, settings.log, as_json=settings.as_json)

    @property
    def folder(self) -> Path:
        """Folder of the result."""
        return folder_of(self.output)

    @property
    def is_illustrated(self) -> bool:
        """Whether a report or overlays are requested."""
        return self.page is not None or self.images is not None

    def with_provenance(
        self,
        calibration: CalibrationDocument,
        data: LoadedDrive,
        initial_pose: InitialPose | None = None,
        hashes: dict[str, str] | None = None,
    ) -> CalibrationDocument:
        """Add the hashes of the files that a calibration was computed from, by their paths relative to the result.

        Args:
            calibration: The calibration.
            data: The drive that it was computed from.
            initial_pose: Pose that it started from.
            hashes: SHA-256 by the real paths of files; new ones are added.

        Raises:
            InputError: a file cannot be read.
        """
        start = None if initial_pose is None else initial_pose.source
        return with_provenance(calibration, data, start=start, relative_to=self.folder, hashes=hashes)

    def check(self, drive: Drive, initial_pose: InitialPose | None = None) -> None:
        """Check before the work begins that all outputs can be written, and that none replaces an input.

        Args:
            drive: The drive.
            initial_pose: Pose to start from, whose file no output may replace.

        Raises:
            InputError: an output cannot be written to its path.
        """
        read = files_read(drive, None if initial_pose is None else initial_pose.source)
        check_page(self.page)
        if self.images is not None:
            check_image_folder(self.images, read)
        if self.output is None or self.as_json:
            check_descriptor(STANDARD_OUTPUT)
        check_outputs(read, self.output, self.log, *self.others, self.page)
        if self.to is not None:
            from semcal_cli.formats import write_transform

            name, options = self.to
            own = replace(options, intrinsics=drive.camera, covariance=np.eye(6), frame_ids=drive.frame_ids)
            write_transform(np.eye(4), None, name, own)
        elif self.output is not None:
            output_format(self.output)
            self.check_replaced()

    def check_replaced(self) -> None:
        """Check that the result replaces nothing but a calibration of semcal, unless that is wanted.

        Raises:
            InputError: another file is in its place.
        """
        if (
            self.replaces_any
            or self.output is None
            or not self.output.is_file()
            or not self.output.stat().st_size
        ):
            return
        with suppress(InputError):
            if OWN_RESULTS & read_document(self.output).keys():
                return
        raise InputError(
            f"{self.output}: found a file that is no calibration of semcal; choose another -o, or add --force"
        )

    def check_images(self, drive: Drive) -> None:
        """Check the images that points will be drawn on; the drive has only the frames that are used.

        Raises:
            InputError: one is missing, or is not an image of the camera's size.
        """
        if not self.is_illustrated:
            return
        from semcal_cli.files.image_files import check_image

        for frame in evenly_spaced(drive.frames, MAX_IMAGES):
            if frame.image is not None:
                check_image(drive.resolve(frame.image), drive.camera.size)

    def write(
        self,
        calibration: CalibrationDocument,
        terminal: Terminal,
        num_threads: int | None,
        drive: Drive | None = None,
    ) -> int:
        """Write and summarise a calibration; the verdict comes last.

        Args:
            calibration: The calibration.
            terminal: Where to print the summary.
            num_threads: Requested number of threads, for the log.
            drive: The drive with the frames that it used, if a report or overlays may be requested.

        Returns:
            The exit code: 3 if it is not trusted.
        """
        if self.log is not None:
            write_text(json.dumps(terminal.log_document(num_threads), indent=2) + "\n", self.log)
        replaced = self._is_trusted_before() and calibration.status != "trusted"
        self._write_result(calibration)
        written_to = str(self.output or "standard output")
        remark = " in the place of a trusted calibration" if replaced else ""
        terminal.print(
            *summary_lines(calibration, verbose=terminal.verbose), labelled("written to", written_to + remark)
        )
        if drive is not None and self.is_illustrated:
            self._illustrate(drive, calibration, terminal)
        lines = verdict_lines(calibration, is_alone=terminal.console.quiet)
        terminal.print_verdict("\n".join(lines), calibration.status)
        if self.has_next_steps and self.to is None and self.output is not None:
            leading = precedence.leading(calibration.topics)
            steps = after_calibration(calibration, self.output, leading, has_overlays=self.images is not None)
            terminal.print(*(labelled(*step) for step in steps))
        _report(calibration, written_to).tell_github()
        return exit_code(calibration)

    def _is_trusted_before(self) -> bool:
        """Whether a trusted calibration is in the place of the result."""
        if self.output is None or self.to is not None or not self.output.is_file():
            return False
        with suppress(InputError):
            return read_calibration(self.output).trusted
        return False

    def _write_result(self, calibration: CalibrationDocument) -> None:
        if self.as_json:
            click.echo(calibration_text(calibration, "json"), nl=False)
        if self.to is not None:
            from semcal_cli.formats import write_transform

            name, options = self.to
            tell = partial(click.echo, err=True)
            options = replace(
                options,
                intrinsics=calibration.used_camera,
                frame_ids=calibration.input.frame_ids,
                covariance=calibration.believed_covariance,
                on_note=tell,
            )
            content = write_transform(calibration.pose, self.output, name, options)
            if self.output is None:
                click.echo(content, nl=False)
        elif self.output is not None:
            write_calibration(calibration, self.output)
        elif not self.as_json:
            click.echo(calibration_text(calibration, "yaml"), nl=False)

    def _illustrate(self, drive: Drive, calibration: CalibrationDocument, terminal: Terminal) -> None:
        """Write the report and the overlays of a calibration, if requested, from the frames that it used."""
        from semcal_cli.report import make_report_input, page

        with terminal:
            terminal.show("reading frames")
            report = make_report_input(
                drive, str(self.output or "calibration"), calibration.pose, calibration
            )
            if self.page is not None:
                page.write_report(report, self.page, terminal.show)
                terminal.print_path("report", self.page)
                self._name_command(terminal, "report", drive, self.page)
            if self.images is not None:
                terminal.show("drawing points on images")
                paths = [*report.overlays(MAX_IMAGES).write_all(self.images)]
                terminal.print(count_images(paths, self.images))
                self._name_command(terminal, "overlay", drive, self.images)

    def _name_command(self, terminal: Terminal, command: str, drive: Drive, output: Path) -> None:
        """Print the command that makes the report or the overlays alone."""
        if self.names_commands and self.output is not None:
            terminal.print(labelled("same as", shell(command, drive.argument, self.output, "-o", output)))


def count_images(paths: Sequence[Path], folder: Path) -> str:
    """Describe the images that were drawn into a folder."""
    return labelled("overlays", f"{counted(len(paths), 'image')} in {folder}")


def _report(calibration: CalibrationDocument, written_to: str) -> CiReport:
    """Make the CI report of a calibration, with the interval of its pose or the number of doubts."""
    verdict: Verdict = "fail" if calibration.status == "not_trusted" else "pass"
    command = click.get_current_context().command.name or "calibrate"
    case = Case(calibration.status, verdict, figures(calibration) or "interval not known")
    return CiReport(
        command, written_to, verdict, [case], shown_reasons(calibration.reasons, calibration.topics)
    )


def exit_code(result: CalibrationDocument | RigCalibration) -> int:
    """Return the exit code of a written result: 3 if it is not trusted."""
    return EXIT_NOT_TRUSTED if result.status == "not_trusted" else 0


@contextmanager
def loaded_drive(
    settings: RunSettings,
    config: CalibrationConfig,
    outputs: Outputs,
    initial_pose: InitialPose | None = None,
    sweeps: SweepCache | None = None,
    *,
    drive: Drive | None = None,
    as_result_sees: bool = False,
) -> Iterator[tuple[LoadedDrive, Terminal]]:
    """Check the outputs, load a drive, and show the progress of what is done with it.

    Args:
        settings: The drive, how it is read, and what is shown.
        config: Settings of a calibration, which determine what is read.
        outputs: Output files, which are checked before any long work begins.
        initial_pose: Pose to start from, whose file no output may replace.
        sweeps: Sweeps that were read before.
        drive: The drive, if it was read and the outputs were checked before.
        as_result_sees: Whether the drive gets the camera and the clock that were estimated together with the initial
            pose, and is loaded by the cues of that calibration unless others are requested.

    Raises:
        InputError: the drive, one of its files or an output is wrong.
        CalibrationError: one side's labels carry no information.
    """
    if (spec := drive) is None:
        spec = settings.read_drive()
        outputs.check(spec, initial_pose)
    set_num_threads(settings.threads)
    with settings.terminal() as terminal:
        if as_result_sees and initial_pose is not None:
            applied = apply_result(initial_pose.record, spec, initial_pose.name)
            terminal.print_changes(applied.changes)
            spec = applied.drive
            config = replace(config, cues=cues_applied(initial_pose.record, config.cues, spec))
        data = load(spec, config, terminal.on_event, sweeps)
        outputs.check_images(data.drive)
        yield data, terminal
