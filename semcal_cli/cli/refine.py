"""`semcal refine`: the refinement of a given transform, the second half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    PATH,
    ResultOptions,
    asked,
    drive_argument,
    max_baseline_option,
    result_options,
)
from semcal_cli.cli.refinement import (
    REFINEMENT_RULES,
    check_estimator,
    make_refinement,
    refinement_options,
)
from semcal_cli.cli.rules import CheckedCommand
from semcal_cli.cli.search import INIT_DIRECTION, init_direction_option, read_initial_pose
from semcal_cli.config import CalibrationConfig

if TYPE_CHECKING:
    from semcal_cli.formats.format import Direction


@click.command(cls=CheckedCommand, rules=REFINEMENT_RULES)
@drive_argument
@click.option(
    "--init",
    type=PATH,
    metavar="FILE",
    required=True,
    help=f"Transform to start at: {KNOWN_TRANSFORMS}.",
)
@init_direction_option
@max_baseline_option
@refinement_options
@result_options
def refine(
    drive: Path, init: Path, init_direction: Direction | None, max_baseline_m: float, **options: Any
) -> None:
    """Refine a transform on DRIVE that is known to 20 degrees or so by labels, to 5 degrees and 0.3 m by edges."""
    from semcal_cli.cli.drive import loaded_drive
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.pipeline import assess, make_calibration, refine_and_polish, start_at

    check_estimator(options)
    initial_pose = read_initial_pose(init, init_direction, direction_option=INIT_DIRECTION)
    refinement, priors = make_refinement(options, max_baseline_m, initial_pose)
    initial_pose.check_distance(max_baseline_m)
    common = asked(ResultOptions, options)
    config = CalibrationConfig(common.seed, common.cues, common.max_frames, refinement=refinement)
    outputs = Outputs(common.output, common.log, as_json=common.as_json)
    with loaded_drive(drive, config, outputs, common, initial_pose) as (data, terminal):
        on_event = terminal.on_event
        initial = start_at(data, initial_pose, on_event)
        stages = refine_and_polish(data, initial, refinement, config.seed, priors, on_event, from_afar=True)
        stages = assess(data, stages, refinement, on_event)
        calibration = make_calibration(
            data, stages, config, initial_pose=initial_pose, relative_to=outputs.folder
        )
    sys.exit(outputs.write(calibration, terminal, common.threads))
