"""A given pose: its refinement, and its assessment alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from semcal_cli.config import CalibrationConfig
from semcal_cli.errors import InputError
from semcal_cli.estimation.adjust.priors import Prior
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.events import Listener, ignore
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.pipeline.assessment import assess
from semcal_cli.pipeline.conclusion import make_calibration
from semcal_cli.pipeline.pose_stages import deskew_sweeps, polish, refine_and_polish, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.calibration_document import CalibrationDocument


def refine_given(
    data: LoadedDrive,
    start: InitialPose,
    config: CalibrationConfig,
    priors: Sequence[Prior] = (),
    on_event: Listener = ignore,
) -> CalibrationDocument:
    """Refine, polish and assess a given pose, without a search; these stages raise the errors.

    Args:
        data: The drive, as `load` returns it.
        start: Pose, known to about 20 degrees (by labels), or to 5 degrees and 0.3 m (by edges).
        config: All settings.
        priors: Known axes of the pose.
        on_event: Called with each event.
    """
    data = data.along_scans(start.T_camera_lidar)
    initial, refinement = start_at(data, start, on_event), config.refinement
    stages = refine_and_polish(data, initial, refinement, config.seed, priors, on_event, from_afar=True)
    stages = assess(data, stages, refinement, on_event)
    return make_calibration(data, stages, config, initial_pose=start)


def assess_given(
    data: LoadedDrive,
    start: InitialPose,
    config: CalibrationConfig,
    on_event: Listener = ignore,
) -> CalibrationDocument:
    """Polish a given pose that is right to about a pixel, and assess it: an interval belongs to a maximum.

    Arguments are those of `refine_given`.

    Raises:
        InputError: points and pixels are compared by features, which cannot assess a pose.
        CalibrationError: too few labelled points are on labelled pixels.
    """
    if data.observations.has_vectors:
        raise InputError(f"{data.drive.path}: found features, which have no histogram; choose another cue")
    T = start.T_camera_lidar
    given, data = data, data.along_scans(T)
    initial, refinement = start_at(data, start, on_event), config.refinement
    unrolled = data.unrolled(T)
    stages = Stages.from_refined(data, initial, None, is_compensated=True)
    stages = replace(stages, seen_refined=None if unrolled is given else unrolled.observations)
    deskewed, stages = deskew_sweeps(unrolled, stages, on_event, config.seed)
    stages = replace(stages, polished=polish(deskewed, stages.T_camera_lidar, refinement, on_event))
    stages = assess(data, stages, refinement, on_event)
    return make_calibration(data, stages, config, initial_pose=start)
