"""A check of the pose by the motion of camera and LiDAR, which needs neither labels nor edges."""

from __future__ import annotations

import math
from dataclasses import replace
from time import perf_counter

import numpy as np

from semcal_cli.estimation.search.hand_eye import HandEye, NotDetermined, hand_eye
from semcal_cli.estimation.uncertainty.sensitivity import Matrix
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.findings.check import CAMERA_MOTION, Measured
from semcal_cli.geometry.poses import Pose, rotation_difference, rotation_error_deg
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.pipeline.stages import Stages

SYSTEMATIC_SIGMA = math.radians(0.1)
"""Error of a rotation by motion that all pairs share: that of a principal point one pixel off, at a focal length of 600
pixels."""


def compare_motion(data: LoadedDrive, stages: Stages, on_event: Listener = ignore) -> Stages:
    """Compare the rotation of an assessed pose with the one that the motion of camera and LiDAR gives.

    Without a motion or consecutive images, the stages are returned unchanged.

    Raises:
        InputError: an image or the file of the poses is missing or wrong.
    """
    assessment = stages.assessment
    if assessment is None:
        return stages
    on_event(Progress("comparing the motion of camera and LiDAR"))
    start = perf_counter()
    found = (stages.searched and stages.searched.by_motion) or hand_eye(data.recorded or data.drive)
    if isinstance(found, NotDetermined) and found.is_unsuited:
        return stages
    measured = list[Measured]()
    if isinstance(found, NotDetermined):
        note = f"the rotation was not checked against the motion of camera and LiDAR: {found.why}"
    else:
        measured.append(disagreement(found, stages))
        note = f"{found.sentence}, which {'contradicts' if measured[0].findings else 'agrees with'} the pose"
    on_event(StageDone("motion", perf_counter() - start, note))
    notes = (*assessment.notes, note)
    return replace(stages, assessment=replace(assessment, notes=notes).with_measured(*measured))


def disagreement(found: HandEye, stages: Stages) -> Measured:
    """Measure how far a rotation by motion is from that of the last pose, in standard errors of both."""
    of_pose = None if stages.uncertainty is None else np.array(stages.uncertainty.covariance)
    sigmas = standard_errors(found, stages.T_camera_lidar, of_pose)
    off_deg = rotation_error_deg(stages.T_camera_lidar, found.T_camera_lidar)
    found_by_motion = (
        f"the motion of camera and LiDAR gives a rotation {off_deg:.2f} degrees away, {sigmas:.1f} standard errors, "
        f"needed at most {CAMERA_MOTION.limit():g}"
    )
    return CAMERA_MOTION.measured(sigmas, found_by_motion)


def standard_errors(found: HandEye, T_camera_lidar: Pose, of_pose: Matrix | None = None) -> float:
    """Measure how far a rotation by motion is from that of a pose (4, 4), in standard errors of both.

    Args:
        found: The rotation by motion.
        T_camera_lidar: (4, 4), metres.
        of_pose: (6, 6) covariance of the pose; None if it is unknown, as if the pose were exact.
    """
    off = rotation_difference(T_camera_lidar, found.T_camera_lidar)
    covariance = found.covariance[:3, :3] + SYSTEMATIC_SIGMA**2 * np.eye(3)
    if of_pose is not None:
        covariance = covariance + of_pose[3:, 3:]
    return math.sqrt(off @ np.linalg.solve(covariance, off))
