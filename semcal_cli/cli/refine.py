"""`semcal refine`: the second half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    PATH,
    drive_argument,
    max_baseline_option,
    result_options,
)
from semcal_cli.cli.refinement import make_refinement, refinement_options
from semcal_cli.cli.search import check_distance


@click.command()
@drive_argument
@click.option(
    "--init",
    type=PATH,
    metavar="FILE",
    required=True,
    help=f"The transform to start at, as it is: {KNOWN_TRANSFORMS}.",
)
@max_baseline_option
@refinement_options
@result_options
def refine(drive: Path, init: Path, max_baseline_m: float | None, **options: Any) -> None:
    """Refine a transform that is known to 20 degrees or so on DRIVE."""
    from semcal_cli.cli.session import Session
    from semcal_cli.config import MAX_BASELINE_M
    from semcal_cli.formats import read_transform
    from semcal_cli.pipeline import Given

    given = Given(read_transform(init), name=str(init), source=init)
    config = make_refinement(options, MAX_BASELINE_M if max_baseline_m is None else max_baseline_m, given)
    check_distance(given, config.max_baseline_m)
    with Session(drive, given=given, **options) as session:
        observations = session.run.load()
        session.run.start_at(observations, given)
        T_camera_lidar = session.run.refine(observations, given.T_camera_lidar, config, from_afar=True)
        code = session.finish(session.run.result(observations, T_camera_lidar, session.folder))
    sys.exit(code)
