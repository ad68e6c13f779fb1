"""`semcal initialize`: the initial calibration, the first half of the pipeline."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.cli.options import ResultSettings
from semcal_cli.cli.settings import command, option
from semcal_cli.cli.stages import SearchSettings
from semcal_cli.config import CalibrationConfig


@dataclass(frozen=True, kw_only=True)
class InitializeSettings(SearchSettings, ResultSettings):
    """Settings of `initialize`."""

    images: Path | None = option(
        "Also draw the registration of at most 20 frames: labels of the sweep, zoomed image labels, and "
        "correspondences.",
        "--overlay",
        metavar="DIR",
    )


@command(InitializeSettings)
def initialize(settings: InitializeSettings) -> None:
    """Find the initial calibration of DRIVE without an initial guess, and do not refine it.

    Lists the hypotheses, best first. Exit code 3 means that a result was written but is not trusted.
    """
    from semcal_cli.assessment.stages import Stages
    from semcal_cli.cli.outputs import MAX_IMAGES, Outputs, check_image_folder, files_read, loaded_drive
    from semcal_cli.cli.tables import hypothesis_lines
    from semcal_cli.pipeline import initialize as search
    from semcal_cli.pipeline import make_calibration
    from semcal_cli.report.registration import RegistrationImages

    start, images, outputs = settings.initial_pose, settings.images, Outputs.of_result(settings)
    config = CalibrationConfig(settings.seed, settings.cues, settings.max_frames, settings.initialization)
    with loaded_drive(settings, config, outputs, start) as (data, terminal):
        if images is not None:
            check_image_folder(images, MAX_IMAGES, files_read(data.drive))
        found = search(data, config.initialization, config.seed, start, on_event=terminal.on_event)
        terminal.print(*hypothesis_lines(found.hypotheses, verbose=settings.verbose))
        calibration = make_calibration(
            data, Stages(found), config, initial_pose=start, relative_to=outputs.folder
        )
        if images is not None:
            drawn = RegistrationImages.near(data.observations, found.T_camera_lidar, config.initialization)
            terminal.print_paths("image", drawn.write_all(images, MAX_IMAGES))
    sys.exit(outputs.write(calibration, terminal, settings.threads))
