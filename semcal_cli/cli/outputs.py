"""The output files of a command: checked before the work begins, written after it."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.tables import doubts, labelled, summary_lines, verdict_lines
from semcal_cli.cli.terminal import Terminal, progress_line
from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.errors import InputError
from semcal_cli.files.documents import output_format
from semcal_cli.files.reading import is_folder
from semcal_cli.files.writing import (
    STANDARD_OUTPUT,
    check_descriptor,
    check_replaceable,
    descriptor,
    is_standard_stream,
    takes_several,
    write_text,
)
from semcal_cli.result.calibration import calibration_text, write_calibration
from semcal_cli.result.intervals import stated_error

if TYPE_CHECKING:
    from semcal_cli.assessment.limits import Verdict
    from semcal_cli.drive.document import Drive
    from semcal_cli.formats.format import FormatOptions
    from semcal_cli.initialization.initial_pose import InitialPose
    from semcal_cli.result.calibration import Calibration

EXIT_NOT_TRUSTED = 3
MAX_IMAGES = 20
"""Number of evenly spaced frames with an overlay."""


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
    """Whether the result is also printed as JSON, and nothing else on standard output."""

    @property
    def folder(self) -> Path:
        """Folder of the result."""
        return folder_of(self.output)

    def of_part(self, number: int) -> Outputs:
        """Name the outputs of a part of the drive: `out_part_1.yaml` beside `out.yaml`, and a log of its own."""
        return Outputs(_of_part(self.output, number), _of_part(self.log, number))

    def check(
        self, drive: Drive, initial_pose: InitialPose | None = None, parts: Sequence[Outputs] = ()
    ) -> None:
        """Check before the work begins that all outputs can be written, and that none replaces an input.

        Args:
            drive: The drive.
            initial_pose: Pose to start at, whose file no output may replace.
            parts: Outputs of the parts of the drive.

        Raises:
            InputError: an output cannot be written to its path.
        """
        read = [drive.path, *map(drive.resolve, drive.files())]
        if initial_pose is not None and initial_pose.source is not None:
            read.append(initial_pose.source)
        if self.page is not None:
            check_page(self.page)
        if self.images is not None:
            check_image_folder(self.images, MAX_IMAGES, read)
        if self.output is None or self.as_json:
            check_descriptor(STANDARD_OUTPUT)
        written = [self.output, self.log, self.page]
        written += [path for part in parts for path in (part.output, part.log)]
        check_outputs(read, [path for path in written if path is not None])
        if self.to is not None:
            from semcal_cli.formats import write_transform

            name, options = self.to
            write_transform(np.eye(4), None, name, replace(options, intrinsics=drive.camera))
        elif self.output is not None:
            output_format(self.output)

    def check_pictures(self, drive: Drive) -> None:
        """Check the pictures that points will be drawn on, of a drive with only the frames that are used.

        Raises:
            InputError: one is missing, or is not an image of the camera's size.
        """
        if self.page is None and self.images is None:
            return
        from semcal_cli.files.images import check_image

        size = drive.camera.width, drive.camera.height
        for frame in evenly_spaced(drive.frames, MAX_IMAGES):
            if frame.image is not None:
                check_image(drive.resolve(frame.image), size)

    def write(
        self,
        calibration: Calibration,
        terminal: Terminal,
        num_threads: int | None,
        drive: Drive | None = None,
    ) -> int:
        """Write and summarise a calibration, and end with its verdict.

        Args:
            calibration: The calibration.
            terminal: Where it is summarised.
            num_threads: Number of threads that was asked for, for the log.
            drive: The drive of the frames that it used, if a report or overlays may be requested.

        Returns:
            The exit code: 3 if it is not trusted.
        """
        if self.log is not None:
            write_text(json.dumps(terminal.log_document(num_threads), indent=2) + "\n", self.log)
        self._write_result(calibration)
        written_to = str(self.output or "standard output")
        terminal.print(
            *summary_lines(calibration, verbose=terminal.verbose), labelled("written to", written_to)
        )
        if drive is not None and (self.page is not None or self.images is not None):
            self._illustrate(drive, calibration, terminal)
        verdict, *next_steps = verdict_lines(calibration)
        terminal.print_verdict(verdict, calibration.status)
        terminal.print(*next_steps)
        _report(calibration, written_to).tell_github()
        return EXIT_NOT_TRUSTED if calibration.status == "not_trusted" else 0

    def _write_result(self, calibration: Calibration) -> None:
        if self.as_json:
            click.echo(calibration_text(calibration, "json"), nl=False)
        if self.to is not None:
            from semcal_cli.formats import write_transform

            name, options = self.to
            tell = partial(click.echo, err=True)
            options = replace(options, intrinsics=calibration.used_camera, on_note=tell)
            content = write_transform(calibration.pose, self.output, name, options)
            if self.output is None:
                click.echo(content, nl=False)
        elif self.output is not None:
            write_calibration(calibration, self.output)
        elif not self.as_json:
            click.echo(calibration_text(calibration, "yaml"), nl=False)

    def _illustrate(self, drive: Drive, calibration: Calibration, terminal: Terminal) -> None:
        """Write the report and the overlays of a calibration, where requested, from the frames that it used."""
        from semcal_cli.report import make_report_input, write_report

        with progress_line(terminal.console) as progress:
            progress("reading frames")
            report = make_report_input(
                drive, str(self.output or "calibration"), calibration.pose, calibration
            )
            if self.page is not None:
                write_report(report, self.page, progress)
                terminal.print(labelled("report", str(self.page)))
            if self.images is not None:
                progress("drawing points on pictures")
                for path in report.overlays(MAX_IMAGES).write_all(self.images):
                    terminal.print(labelled("picture", str(path)))


def _report(calibration: Calibration, written_to: str) -> CiReport:
    """Make a verdict of a calibration for CI, with the interval of its pose or the number of doubts."""
    verdict: Verdict = "fail" if calibration.status == "not_trusted" else "pass"
    uncertainty, figures = calibration.believed_uncertainty, "interval not known"
    if verdict == "fail":
        figures = doubts(calibration)
    elif uncertainty is not None:
        figures = stated_error(uncertainty, calibration.used_camera)
    command = click.get_current_context().command.name or "calibrate"
    case = Case(calibration.status, verdict, figures)
    return CiReport(command, written_to, verdict, [case], calibration.reasons)


def folder_of(output: Path | None) -> Path:
    """Folder that the paths in a result are relative to: that of its file, or the working folder of a stream."""
    return Path() if output is None or descriptor(output) is not None else output.parent


def _of_part(path: Path | None, number: int) -> Path | None:
    if path is None or takes_several(path):
        return path
    return path.with_stem(f"{path.stem}_part_{number}")


def check_outputs(read: Sequence[Path], outputs: Sequence[Path]) -> None:
    """Check that results have a folder to go to, and overwrite neither an input nor one another.

    Raises:
        InputError: a folder is missing or cannot be written to, or a result would overwrite a file.
    """
    taken = set(map(os.path.realpath, read))
    for path in outputs:
        if not is_folder(path.absolute().parent):
            raise InputError(f"{path}: found no folder {path.parent}, needed one to write to")
        if is_folder(path):
            raise InputError(f"{path}: is a folder, needed a file to write to")
        check_descriptor(path)
        if os.path.realpath(path) in taken:
            raise InputError(f"{path}: found a file that this run reads or writes, needed another name")
        if takes_several(path):
            continue
        if is_standard_stream(path):
            raise InputError(f"{path}: found the file that the shell writes to, needed another name")
        if not path.exists() or path.is_file():
            check_replaceable(path)
        taken.add(os.path.realpath(path))


def check_image_folder(folder: Path, count: int, read: Sequence[Path]) -> None:
    """Check that the images would not replace files that are read.

    Raises:
        InputError: an image would replace such a file.
    """
    from semcal_cli.report.overlay import overlay_paths

    if folder.exists() and not is_folder(folder):
        raise InputError(f"{folder}: found a file, needed a folder for pictures")
    taken = set(map(os.path.realpath, read))
    for path in overlay_paths(folder, count):
        if os.path.realpath(path) in taken:
            raise InputError(f"{path}: found a file that this run reads, needed another folder")
        if is_folder(path):
            raise InputError(f"{path}: found a folder, needed a place for a picture")


def check_page(path: Path) -> None:
    """Check the suffix of a page; a descriptor as /dev/stdout needs none.

    Raises:
        InputError: the suffix is not that of HTML.
    """
    if not path.suffix and descriptor(path) is not None:
        return
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path}: found suffix {path.suffix!r}, needed .html")
