"""The conclusion of a calibration: its document, and whether it is trusted."""

from __future__ import annotations

from typing import Any

from pydantic_core import to_jsonable_python

from semcal_cli.checks import precedence
from semcal_cli.config import CalibrationConfig
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.search.mounting import Mounting
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.cues.cue_table import files_of, recorded_options
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.provenance import describe_input, versions
from semcal_cli.result.sections import Hypothesis


def make_calibration(
    data: LoadedDrive,
    stages: Stages,
    config: CalibrationConfig,
    *,
    initial_pose: InitialPose | None = None,
) -> CalibrationDocument:
    """Make the calibration from the last pose, without the hashes of its files; arguments are those of `calibrate`.

    It is trusted if it was assessed and nothing speaks against it.

    Raises:
        CalibrationError: the pose is not finite or not rigid.
    """
    assessment, joint = stages.assessment, stages.joint
    is_near = data.policy.needs_near_start and config.initialization.search_deg is None
    findings = precedence.diagnosed(
        stages.findings,
        weak=data.policy.weak,
        start="" if initial_pose is None else initial_pose.name,
        near_only=data.policy.near_only if is_near else (),
        moved=None
        if initial_pose is None
        else compare_poses(stages.T_camera_lidar, initial_pose.T_camera_lidar),
        estimated=() if joint is None or joint.camera is None else joint.camera.intrinsics,
    )
    calibration = CalibrationDocument.from_pose(
        stages.T_camera_lidar,
        status="not_trusted" if findings else "not_assessed" if assessment is None else "trusted",
        reasons=tuple(finding.sentence for finding in findings),
        topics=tuple(finding.topic for finding in findings),
        notes=stages.notes,
        parts=() if assessment is None else assessment.parts,
        quality=stages.quality(data.observations),
        stages=stages.records,
        uncertainty=stages.uncertainty,
        repeatability=stages.repeatability,
        cross_validation=stages.cross_validation,
        camera=None if joint is None else joint.camera,
        checked_intrinsics=None if assessment is None else assessment.checked_intrinsics,
        clock=None if joint is None else joint.clock,
        speed=stages.measured_speed,
        polish=None if stages.polished is None else stages.polished.held_out,
        hypotheses=() if stages.searched is None else tuple(map(_hypothesis, stages.searched.hypotheses)),
        input=describe_input(data.drive, files_of(data.cues)),
        settings=_settings(data, stages, config, initial_pose),
    )
    if calibration.uncertainty is None:
        return calibration
    in_image = calibration.uncertainty.with_pixels(calibration.used_camera)
    return calibration.model_copy(update={"uncertainty": in_image})


def _settings(
    data: LoadedDrive, stages: Stages, config: CalibrationConfig, initial_pose: InitialPose | None
) -> dict[str, Any]:
    """Collect what the result was computed with."""
    options = {"max_frames": data.max_frames, **recorded_options(data.cues)}
    if initial_pose is not None and initial_pose.source is None:
        options["given"] = initial_pose.name
    if initial_pose is not None and initial_pose.direction is not None:
        options["init_direction"] = initial_pose.direction
    options |= stages.settings
    if stages.repeatability is not None:
        options["num_seeds"] = stages.repeatability.num_seeds
    if stages.cross_validation is not None:
        options["num_folds"] = stages.cross_validation.num_folds
    return {"options": to_jsonable_python(options), "seed": config.seed, "versions": versions()}


def _hypothesis(mounting: Mounting) -> Hypothesis:
    """Convert a mounting to the section of the result."""
    return Hypothesis(**vars(mounting) | {"T_camera_lidar": mounting.T_camera_lidar.tolist()})
