"""`semcal initialize`: the first half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from semcal_cli.cli.options import drive_argument, result_options
from semcal_cli.cli.search import make_search, search_options


@click.command()
@drive_argument
@search_options
@result_options
def initialize(drive: Path, **options: Any) -> None:
    """Find the initial calibration of DRIVE from nothing, without refining it.

    Lists the hypotheses, best first. Exit code 3 means that an answer was written but is not trusted.
    """
    from semcal_cli.cli.session import Session

    config, given = make_search(options)
    with Session(drive, given=given, **options) as session:
        observations = session.run.load()
        hypotheses = session.run.initialize(observations, config, given)
        session.show(hypotheses)
        best = hypotheses[0].T_camera_lidar
        code = session.finish(session.run.result(observations, best, session.folder))
    sys.exit(code)
