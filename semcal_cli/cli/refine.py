"""`semcal refine`: the refinement of a given transform, the second half of the pipeline."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.cli.options import ResultSettings
from semcal_cli.cli.settings import KNOWN_TRANSFORMS, option
from semcal_cli.cli.settings_command import command
from semcal_cli.cli.stage_options import RefinementSettings
from semcal_cli.config import CalibrationConfig


@dataclass(frozen=True, kw_only=True)
class RefineSettings(RefinementSettings, ResultSettings):
    """Settings of `refine`."""

    section = "Start"
    shown_first = (
        *("--init", "--output", "--cue", "--frames", "--exclude", "--refine-intrinsics", "--estimate-delay"),
        *("--fix", "--json", "--verbose", "--quiet"),
    )
    init: Path = option(f"Transform to start from: {KNOWN_TRANSFORMS}.", metavar="FILE", required=True)


@command(RefineSettings)
def refine(settings: RefineSettings) -> None:
    """Refine a transform that is roughly known on DRIVE.

    It has to be known to about 20 degrees for labels, and to 5 degrees and 0.3 m for edges. Exit code 3 means that a
    result was written but is not trusted.
    """
    from semcal_cli.cli.outputs import Outputs, loaded_drive
    from semcal_cli.pipeline.from_transform import refine_given

    settings.check_estimator()
    start, refinement, priors = settings.initial_pose, settings.refinement, settings.priors
    assert start is not None
    cues, outputs = settings.known_cues(settings.cues), Outputs.of_result(settings)
    config = CalibrationConfig(settings.seed, cues, settings.max_frames, refinement=refinement)
    with loaded_drive(settings, config, outputs, start) as (data, terminal):
        calibration = refine_given(data, start, config, priors, terminal.on_event)
        calibration = outputs.with_provenance(calibration, data, start)
    sys.exit(outputs.write(calibration, terminal, settings.threads))
