"""`semcal initialize`: the first half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from semcal_cli.cli.options import drive_argument, result_options, zoom_option


@click.command()
@drive_argument
@zoom_option
@result_options
def initialize(
    drive: Path,
    zoom: str | None,
    output: Path | None,
    log: Path | None,
    seed: int,
    threads: int | None,
    quiet: bool,
) -> None:
    """Find the initial calibration of DRIVE from nothing, without refining it."""
    from semcal_cli.cli.session import Session
    from semcal_cli.initialization import InitializationConfig

    config = InitializationConfig(zoom=zoom) if zoom else InitializationConfig()
    with Session(drive, output, log, seed, threads, quiet) as session:
        observations = session.run.load()
        hypotheses = session.run.initialize(observations, config)
        for hypothesis in hypotheses:
            session.show(hypothesis)
        best = hypotheses[0].T_camera_lidar
        code = session.finish(session.run.result(observations, best, [], session.folder))
    sys.exit(code)
