"""`semcal report`: a calibration on one page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from semcal_cli.cli.options import RunSettings, reference_direction
from semcal_cli.cli.rules import FOR_ONE_CAMERA, refuse
from semcal_cli.cli.settings import argument, option, output_file
from semcal_cli.cli.settings_command import command
from semcal_cli.config.directions import Direction


@dataclass(frozen=True, kw_only=True)
class ReportSettings(RunSettings):
    """Settings of `report`."""

    calibration: Path = argument()
    output: Path = output_file("File for the page: .html.", "-o", "--output", required=True)
    against: Path | None = option(
        "Second transform, shown next to the first; if not given, that of the calibration's first stage.",
        metavar="FILE",
    )
    reference_direction: Direction | None = reference_direction()
    is_opened: bool = option("Also open the page in the browser.", "--open", default=False)


@command(ReportSettings)
def report(settings: ReportSettings) -> None:
    """Write a page about the transform in CALIBRATION on DRIVE.

    CALIBRATION is {KNOWN_TRANSFORMS}. For a rig.yaml, it is the folder that semcal calibrate wrote. The page is one
    HTML file with everything that is known about the transform, and can be read offline.
    """
    from semcal_cli.cli.output_checks import check_outputs, check_page, files_read
    from semcal_cli.drive.document import read_drive
    from semcal_cli.files.output_files import write_text
    from semcal_cli.many.rig.rig_document import find_rig
    from semcal_cli.report import page, read_report_input
    from semcal_cli.threads import set_num_threads

    calibration, output, against = settings.calibration, settings.output, settings.against
    terminal = settings.terminal()
    rig = find_rig(settings.drive)
    if rig is not None:
        from semcal_cli.many.rig.rig_result import read_rig_files

        refuse(click.get_current_context(), ["--against"], FOR_ONE_CAMERA.format(rig.path))
        result, drives, read = read_rig_files(rig, calibration, settings.max_points)
    else:
        drive = read_drive(settings.drive, settings.max_points)
        read = files_read(drive, calibration, against)
    check_page(output)
    check_outputs(read, output)
    set_num_threads(settings.threads)
    with terminal:
        if rig is not None:
            from semcal_cli.many.rig.rig_page import rig_page_html

            write_text(rig_page_html(result, drives, (str(rig.path), str(read[-1])), terminal.show), output)
        else:
            terminal.show("reading frames")
            shown = read_report_input(drive, calibration, against, settings.reference_direction)
            terminal.print_changes(shown.changes)
            page.write_report(shown, output, terminal.show)
    terminal.print(str(output))
    if settings.is_opened:
        click.launch(str(output))
