"""The calibration of a method that does not estimate its uncertainty."""

from __future__ import annotations

import math
from pathlib import Path

from semcal_cli.assessment.pose_checks import check_motion, check_shutter
from semcal_cli.assessment.stages import Stages
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import make_calibration
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.stage import Finding, StageResult


def calibration_of(
    data: LoadedDrive,
    config: CalibrationConfig,
    initial: StageResult,
    refined: StageResult,
    of_comparison: tuple[Finding, ...],
    *,
    max_baseline_m: float = math.inf,
    initial_pose: InitialPose | None = None,
    relative_to: Path = Path(),
    hashes: dict[str, str] | None = None,
) -> Calibration:
    """Make the calibration of a refined pose; arguments beside the stages are those of `pipeline.calibrate`.

    Args:
        data: The drive, as `load` returns it.
        config: Settings of the calibration.
        initial: Result of the initial calibration.
        refined: Result of the refinement.
        of_comparison: Findings of a comparison of the pose with something else.
        max_baseline_m: Distance between camera and LiDAR at which the pose was held; infinite where it was not.
        initial_pose: Pose that the method started at.
        relative_to: Folder of the result.
        hashes: SHA-256 by the real paths of files; missing ones are added.
    """
    of_shutter, notes = check_shutter(data.drive, data.observations, is_compensated=False)
    of_data = (*check_motion(data.observations.motion_error_px), *of_shutter)
    stages = Stages(
        initial,
        refined,
        of_data=of_data,
        notes_on_data=notes,
        of_comparison=of_comparison,
        max_baseline_m=max_baseline_m,
    )
    return make_calibration(
        data, stages, config, initial_pose=initial_pose, relative_to=relative_to, hashes=hashes
    )
