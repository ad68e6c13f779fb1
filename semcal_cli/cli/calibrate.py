"""`semcal calibrate`: the whole pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from semcal_cli.cli.convert import FormatName, make_asked, open_options
from semcal_cli.cli.options import PATH, drive_argument, result_options
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
@click.option(
    "--to",
    type=FormatName(),
    metavar="FORMAT",
    help="Write only the transform, in a format that `convert --formats` lists.",
)
@open_options("to-", "what is written with --to")
@click.option("--report", "page", type=PATH, metavar="FILE", help="Write a page about it, too: .html.")
@click.option(
    "--overlay",
    "pictures",
    type=PATH,
    metavar="DIR",
    help="Write pictures of points on images there, too, before and after, of at most 20 frames.",
)
@result_options
def calibrate(
    drive: Path, repeat: int | None, to: str | None, page: Path | None, pictures: Path | None, **options: Any
) -> None:
    """Calibrate the camera and the LiDAR of DRIVE, a folder with a drive.yaml or the file itself.

    Needs no start guess: all mounting directions are searched, then the best pose is refined. Exit code 3 means that
    an answer was written but is not trusted.
    """
    from semcal_cli.cli.session import Session

    config, given = make_search(options)
    asked = make_asked(options, "to_")
    if to is None and any(vars(asked).values()):
        raise click.UsageError(
            "--to-direction, --to-frame, --to-camera, --to-lidar: are of --to: give it, too"
        )
    refinement = make_refinement(options, config.alignment.max_baseline_m, given)
    options |= {"to": None if to is None else (to, asked), "page": page, "pictures": pictures}
    with Session(drive, given=given, **options) as session:
        calibration = session.run.calibrate(session.folder, config, given, refinement, num_seeds=repeat or 1)
        code = session.finish(calibration)
    session.illustrate(calibration, page, pictures)
    sys.exit(code)
