"""`semcal initialize`: the initial calibration, the first half of the pipeline."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

from semcal_cli.cli.options import ResultSettings
from semcal_cli.cli.settings_command import command
from semcal_cli.cli.stage_options import SearchSettings
from semcal_cli.config import CalibrationConfig, RefinementConfig


@dataclass(frozen=True, kw_only=True)
class InitializeSettings(SearchSettings, ResultSettings):
    """Settings of `initialize`."""

    shown_first = (
        *("--output", "--cue", "--init", "--init-rpy-xyz", "--search-deg", "--roll", "--frames", "--exclude"),
        *("--json", "--verbose", "--quiet"),
    )


@command(InitializeSettings)
def initialize(settings: InitializeSettings) -> None:
    """Find the initial calibration of DRIVE without an initial guess, and do not refine it.

    Lists the hypotheses, best first. Exit code 3 means that a result was written but is not trusted.
    """
    from semcal_cli.checks.other_mounting import check_mountings
    from semcal_cli.cli.outputs import Outputs, loaded_drive
    from semcal_cli.cli.tables import hypothesis_lines
    from semcal_cli.pipeline import initialize as search, make_calibration
    from semcal_cli.pipeline.stages import Stages

    start, outputs = settings.initial_pose, Outputs.of_result(settings)
    config = CalibrationConfig(
        settings.seed,
        settings.cues,
        settings.max_frames,
        settings.initialization,
        RefinementConfig(max_baseline_m=settings.max_baseline_m),
    )
    with loaded_drive(settings, config, outputs, start) as (data, terminal):
        initial = search(data, config.initialization, config.seed, start, on_event=terminal.on_event)
        terminal.print(*hypothesis_lines(initial.hypotheses, verbose=settings.verbose))
        stages = Stages(initial, of_search=check_mountings(initial), max_baseline_m=math.inf)
        calibration = make_calibration(data, stages, config, initial_pose=start)
        calibration = outputs.with_provenance(calibration, data, start)
    sys.exit(outputs.write(calibration, terminal, settings.threads))
