"""`semcal refine`: the second half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from semcal_cli.cli.options import KNOWN_TRANSFORMS, PATH, device_option, drive_argument, result_options


@click.command()
@drive_argument
@click.option(
    "--init",
    type=PATH,
    metavar="FILE",
    required=True,
    help=f"The transform to start at, as it is: {KNOWN_TRANSFORMS}.",
)
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
    from semcal_cli.pipeline import Given

    given = Given(read_transform(init), name=str(init), source=init)
    with Session(drive, output, log, seed, threads, quiet) as session:
        observations = session.run.load()
        session.run.start_at(observations, given)
        T_camera_lidar = session.run.refine(observations, given.T_camera_lidar, device)
        code = session.finish(session.run.result(observations, T_camera_lidar, session.folder))
    sys.exit(code)
