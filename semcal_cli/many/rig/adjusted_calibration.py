"""The calibration of a camera at the pose that all sensors of its rig say together."""

from __future__ import annotations

from semcal_cli import core
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.many.rig.rig_uncertainty import AdjustedSensor
from semcal_cli.observations.observations import Observations
from semcal_cli.readable import figure, lengths
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.sections import Quality, Stage

STAGE = "adjusted"
"""Name of the stage in the calibration of a camera."""
POSE_FORMS = {
    "semcal_calibration",
    "rows_camera_lidar",
    "rows_lidar_camera",
    "translation_m",
    "quaternion_xyzw",
}
"""Fields that `CalibrationDocument.from_pose` derives from a pose."""


def adjusted_calibration(
    calibration: CalibrationDocument, observations: Observations, sensor: AdjustedSensor, by: str
) -> CalibrationDocument:
    """Return a calibration with the pose (4, 4) and the uncertainty of an adjustment.

    Args:
        calibration: Calibration of the camera alone.
        observations: Observations that it was made from, as the pose sees them.
        sensor: Its adjusted pose and uncertainty.
        by: What moved it, for the note.
    """
    T, uncertainty = sensor
    agreement, away = core.agreement(observations.core, T), compare_poses(T, calibration.pose)
    quality = Quality.of(
        agreement,
        turn_loss=observations.turn_loss(T),
        num_frames=calibration.quality.num_frames,
        runner_up_margin=calibration.quality.runner_up_margin,
    )
    stage = Stage(T_camera_lidar=T.tolist(), mutual_information_nats=agreement.mutual_information)
    note = (
        f"{by} of the rig moved the camera by {lengths([away.camera_center_m])} and "
        f"{figure(away.rotation_deg)} degrees"
    )
    changes = {
        "uncertainty": uncertainty.with_pixels(calibration.used_camera),
        "quality": quality,
        "stages": calibration.stages | {STAGE: stage},
        "notes": (*calibration.notes, note),
    }
    kept = {name: value for name, value in calibration if name not in POSE_FORMS}
    return CalibrationDocument.from_pose(T, **kept | changes)
