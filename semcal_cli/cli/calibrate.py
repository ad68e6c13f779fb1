"""`semcal calibrate`: the whole pipeline."""

from __future__ import annotations

from pathlib import Path

import click

from semcal_cli.cli.options import PATH, device_option, drive_argument, result_options, zoom_option


@click.command()
@drive_argument
@click.option(
    "--init",
    type=PATH,
    metavar="FILE",
    help="Start at this transform (a calibration, a drive's reference, a RELLIS-3D transforms.yaml) "
    "instead of searching all mounting directions.",
)
@zoom_option
@device_option
@result_options
def calibrate(
    drive: Path,
    init: Path | None,
    zoom: str,
    device: str,
    output: Path | None,
    log: Path | None,
    seed: int,
    threads: int | None,
    quiet: bool,
) -> None:
    """Calibrate the camera and the LiDAR of DRIVE, a folder with a drive.yaml or the file itself.

    Needs no start guess: all mounting directions are searched, then the best pose is refined. Exit code 3 means that
    an answer was written but is not trusted.
    """
    from semcal_cli.cli.session import Session
    from semcal_cli.formats import read_transform
    from semcal_cli.initialization import InitializationConfig
    from semcal_cli.pipeline import check_device

    given = (read_transform(init), init) if init else None
    check_device(device)
    with Session(drive, output, log, seed, threads, quiet) as session:
        config = InitializationConfig(zoom=zoom)
        session.finish(session.run.calibrate(session.folder, given, config, device))
