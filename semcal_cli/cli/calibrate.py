"""`semcal calibrate`: the whole pipeline."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from semcal_cli.cli.options import device_option, drive_argument, init_option, result_options, zoom_option


@click.command()
@drive_argument
@init_option(required=False, help_text="Start at this transform instead of searching all mounting directions")
@zoom_option
@device_option
@result_options
def calibrate(
    drive: Path,
    init: Path | None,
    zoom: str | None,
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

    if init and zoom:
        raise click.UsageError("--zoom is for the search that --init replaces: give one of them")
    given = (read_transform(init), init) if init else None
    config = InitializationConfig(zoom=zoom) if zoom else InitializationConfig()
    with Session(drive, output, log, seed, threads, quiet) as session:
        code = session.finish(session.run.calibrate(session.folder, given, config, device))
    sys.exit(code)
