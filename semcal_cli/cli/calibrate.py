"""`semcal calibrate`: the whole pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from semcal_cli.cli.options import drive_argument, result_options
from semcal_cli.cli.refinement import make_refinement, refinement_options
from semcal_cli.cli.search import make_search, search_options


@click.command()
@drive_argument
@search_options
@refinement_options
@click.option(
    "--repeat",
    type=click.IntRange(2),
    metavar="N",
    help="Calibrate with N seeds, and report how far apart they lead beside the stated uncertainty.",
)
@result_options
def calibrate(drive: Path, repeat: int | None, **options: Any) -> None:
    """Calibrate the camera and the LiDAR of DRIVE, a folder with a drive.yaml or the file itself.

    Needs no start guess: all mounting directions are searched, then the best pose is refined. Exit code 3 means that
    an answer was written but is not trusted.
    """
    from semcal_cli.cli.session import Session

    config, given = make_search(options)
    refinement = make_refinement(options, config.alignment.max_baseline_m, given)
    with Session(drive, given=given, **options) as session:
        code = session.finish(
            session.run.calibrate(session.folder, config, given, refinement, num_seeds=repeat or 1)
        )
    sys.exit(code)
