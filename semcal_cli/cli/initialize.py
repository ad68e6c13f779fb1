"""`semcal initialize`: the initial calibration, the first half of the pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from semcal_cli.cli.options import ResultOptions, asked, drive_argument, overlay_option, result_options
from semcal_cli.cli.rules import CheckedCommand
from semcal_cli.cli.search import SEARCH_RULES, make_search, search_options
from semcal_cli.config import CalibrationConfig


@click.command(cls=CheckedCommand, rules=SEARCH_RULES)
@drive_argument
@search_options
@overlay_option(
    "Also write pictures of the registration, for at most 20 frames: labels of the sweep, zoomed labels of the "
    "camera, and correspondences."
)
@result_options
def initialize(drive: Path, images: Path | None, **options: Any) -> None:
    """Find the initial calibration of DRIVE from nothing, without refining it.

    Lists the hypotheses, best first. Exit code 3 means that an answer was written but is not trusted.
    """
    from semcal_cli.assessment.stages import Stages
    from semcal_cli.cli.drive import loaded_drive
    from semcal_cli.cli.outputs import MAX_IMAGES, Outputs, check_image_folder
    from semcal_cli.cli.tables import hypothesis_lines, labelled
    from semcal_cli.pipeline import initialize as search
    from semcal_cli.pipeline import make_calibration
    from semcal_cli.report.registration import RegistrationPictures

    search_config, initial_pose = make_search(options)
    common = asked(ResultOptions, options)
    config = CalibrationConfig(common.seed, common.cues, common.max_frames, search_config)
    outputs = Outputs(common.output, common.log, as_json=common.as_json)
    with loaded_drive(drive, config, outputs, common, initial_pose) as (data, terminal):
        if images is not None:
            read = [data.drive.path, *map(data.drive.resolve, data.drive.files())]
            check_image_folder(images, MAX_IMAGES, read)
        found = search(data, config.initialization, config.seed, initial_pose, on_event=terminal.on_event)
        terminal.print(*hypothesis_lines(found.hypotheses, verbose=common.verbose))
        calibration = make_calibration(
            data,
            Stages(found),
            config,
            initial_pose=initial_pose,
            relative_to=outputs.folder,
        )
        if images is not None:
            pictures = RegistrationPictures.near(data.observations, found.T_camera_lidar, search_config)
            for path in pictures.write_all(images, MAX_IMAGES):
                terminal.print(labelled("picture", str(path)))
    sys.exit(outputs.write(calibration, terminal, common.threads))
