"""`semcal refine`: the second half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from semcal_cli.cli.options import device_option, drive_argument, init_option, result_options


@click.command()
@drive_argument
@init_option(required=True, help_text="The transform to start at")
@device_option
@result_options
def refine(
    drive: Path,
    init: Path,
    device: str,
    output: Path | None,
    log: Path | None,
    seed: int,
    threads: int | None,
    quiet: bool,
) -> None:
    """Refine a transform that is known to several degrees on DRIVE."""
    from semcal_cli.cli.session import Session
    from semcal_cli.formats import read_transform

    given = read_transform(init), init
    with Session(drive, output, log, seed, threads, quiet) as session:
        code = session.finish(session.run.calibrate(session.folder, given, device=device))
    sys.exit(code)
