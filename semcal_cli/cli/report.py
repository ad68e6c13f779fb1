"""`semcal report`: a calibration as one page."""

from __future__ import annotations

from pathlib import Path

import click

from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    OUTPUT_FILE,
    PATH,
    drive_argument,
    max_points_option,
    quiet_option,
    threads_option,
)
from semcal_cli.cli.rules import Options, refuse


@click.command(
    help=f"Write a page about the transform of CALIBRATION on DRIVE: {KNOWN_TRANSFORMS}. One HTML file with all "
    "that is known about it, readable without a network. Of a rig.yaml, CALIBRATION is the folder that "
    "semcal calibrate wrote."
)
@drive_argument
@click.argument("calibration", type=PATH)
@click.option(
    "-o", "--output", type=OUTPUT_FILE, required=True, metavar="FILE", help="File of the page: .html."
)
@click.option(
    "--against",
    type=PATH,
    metavar="FILE",
    help="Transform to show beside it; if not given, that of the calibration's first stage.",
)
@max_points_option
@threads_option
@quiet_option
def report(
    drive: Path,
    calibration: Path,
    output: Path,
    against: Path | None,
    max_points: int,
    threads: int | None,
    quiet: bool,
) -> None:
    """Write a page about a transform."""
    from semcal_cli.cli.outputs import check_outputs, check_page
    from semcal_cli.cli.tables import labelled
    from semcal_cli.cli.terminal import make_console, progress_line
    from semcal_cli.drive.document import drive_file, read_drive
    from semcal_cli.files.writing import write_text
    from semcal_cli.report import read_report_input, write_report
    from semcal_cli.rig.document import find_rig
    from semcal_cli.rig.page import rig_page_html
    from semcal_cli.rig.result import read_rig_files
    from semcal_cli.threads import set_num_threads

    console = make_console(quiet)
    if (rig := find_rig(drive)) is not None:
        refuse(Options(click.get_current_context()), ["--against"], f"is of one camera, and {rig} is a rig")
        check_page(output)
        found, drives, read = read_rig_files(rig, calibration, max_points)
        check_outputs(read, [output])
        set_num_threads(threads)
        with progress_line(console) as progress:
            write_text(rig_page_html(found, drives, (str(rig), str(read[-1])), progress), output)
        console.print(str(output), markup=False)
        return
    spec = read_drive(drive, max_points)
    given = [drive_file(path) for path in (calibration, against) if path is not None]
    check_page(output)
    check_outputs([spec.path, *map(spec.resolve, spec.files()), *given], [output])
    set_num_threads(threads)
    with progress_line(console) as progress:
        progress("reading frames")
        shown = read_report_input(spec, calibration, against)
        for change in shown.changes:
            console.print(labelled(*change), markup=False)
        write_report(shown, output, progress)
    console.print(str(output), markup=False)
