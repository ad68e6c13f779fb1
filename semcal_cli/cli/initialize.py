"""`semcal initialize`: the initial calibration, the first half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from semcal_cli.cli.options import ResultOptions, drive_argument, result_options
from semcal_cli.cli.search import make_search, search_options
from semcal_cli.config import CalibrationConfig


@click.command()
@drive_argument
@search_options
@result_options
def initialize(drive: Path, **options: Any) -> None:
    """Find the initial calibration of DRIVE from nothing, without refining it.

    Lists the hypotheses, best first. Exit code 3 means that an answer was written but is not trusted.
    """
    from semcal_cli.cli.drive import loaded_drive
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.tables import hypothesis_lines
    from semcal_cli.pipeline import initialize as search
    from semcal_cli.pipeline import make_calibration
    from semcal_cli.stages import Stages

    search_config, initial_pose = make_search(options)
    asked = ResultOptions(**options)
    config = CalibrationConfig(asked.seed, asked.cues, asked.max_frames, search_config)
    outputs = Outputs(asked.output, asked.log)
    opened = loaded_drive(
        drive,
        config,
        outputs,
        initial_pose,
        threads=asked.threads,
        quiet=asked.quiet,
        max_points=asked.max_points,
    )
    with opened as (data, terminal):
        found = search(data, config.initialization, config.seed, initial_pose, on_event=terminal.on_event)
        terminal.print(*hypothesis_lines(found.hypotheses))
        calibration = make_calibration(
            data,
            Stages(found),
            config,
            initial_pose=initial_pose,
            relative_to=outputs.folder,
        )
    sys.exit(outputs.write(calibration, terminal, asked.threads))
