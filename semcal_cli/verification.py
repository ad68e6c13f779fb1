"""Whether a transform still holds: the pose is estimated anew around it, and what differs is judged axis by axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semcal_cli.assessment.limits import Check, Verdict, judge, together
from semcal_cli.config import InitializationConfig, Limits
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import CalibrationError
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import OPTICAL_AXES, Pose, inverse, pose_from_quaternion, quaternion_xyzw
from semcal_cli.pipeline import Given, RefinementConfig, Run

NEAR_DEG = 5.0
"""An estimate that is farther from the transform than this is searched for from nothing ..."""
NEAR_M = 0.5
"""... or farther than this."""
SAME_DEG = 3.0
"""A mistake is recognised if, made good, it leads so near to the estimate ..."""
SAME_M = 0.3
"""... and so near."""
REFINEMENT = RefinementConfig(with_label_bleed=False)


@dataclass(frozen=True)
class Verification:
    """What was found."""

    verdict: Verdict
    checks: tuple[Check, ...]
    """The transform less the estimate: the camera's place and its rotation, along its axes and in all."""
    reasons: tuple[str, ...]
    """Why it is not more certain, or what the transform looks like."""
    T_camera_lidar: Pose
    """The estimate."""


def verify(run: Run, given: Given, limits: Limits, observations: Observations | None = None) -> Verification:
    """Verify a transform on a drive.

    The pose is refined from the transform on; if that leads nowhere or leaves doubts, it is searched for from nothing.
    An offset fails if its 95 % interval lies beyond the limit, and passes if it lies within. What is between, and what
    the data cannot see, is inconclusive.

    Args:
        run: A calibration of the drive, not begun.
        given: The transform.
        limits: What is allowed.
        observations: Of the drive; they are loaded if not given.

    Raises:
        InputError: a file of the drive is missing or wrong.
        CalibrationError: one side carries a single class, or the drive cannot be calibrated at all.
    """
    observations = run.load() if observations is None else observations
    estimate = _nearby(run, observations, given)
    if estimate is None:
        run = Run(run.drive, run.seed, run.max_frames, run.cues, report=run.report, progress=run.progress)
        hypotheses = run.initialize(observations, InitializationConfig())
        estimate = run.refine(observations, hypotheses[0].T_camera_lidar, REFINEMENT)
    uncertainty = run.uncertainty
    half_widths = (
        [*uncertainty.half_width_95_camera_center_m, *uncertainty.half_width_95_rotation_deg]
        if uncertainty
        else None
    )
    error = compare_poses(given.T_camera_lidar, estimate)
    center_m = [0.01 * x for x in error.camera_center_xyz_cm]
    checks = judge(center_m, error.rotation_xyz_deg, half_widths, limits)
    if run.reasons or uncertainty is None:
        return Verification("inconclusive", checks, tuple(run.reasons), estimate)
    verdict = together(check.verdict for check in checks)
    looks = recognise(given.T_camera_lidar, estimate) if verdict == "fail" else []
    return Verification(verdict, checks, tuple(looks), estimate)


def _nearby(run: Run, observations: Observations, given: Given) -> Pose | None:
    """The estimate that the transform leads to; None if it leads away, or leaves doubts."""
    try:
        run.start_at(observations, given)
        estimate = run.refine(observations, given.T_camera_lidar, REFINEMENT, from_afar=True)
    except CalibrationError:
        return None
    is_near = _is_near(estimate, given.T_camera_lidar, NEAR_DEG, NEAR_M)
    return estimate if is_near and not run.reasons and run.uncertainty is not None else None


def _is_near(T_a: Pose, T_b: Pose, angle_deg: float, distance_m: float) -> bool:
    error = compare_poses(T_a, T_b)
    return error.rotation_deg <= angle_deg and error.camera_center_cm <= 100.0 * distance_m


def recognise(T_given: Pose, T_estimate: Pose) -> list[str]:
    """Name the mistakes that would make of the estimate what was given."""
    optical_body = np.eye(4)
    optical_body[:3, :3] = OPTICAL_AXES.T
    x, y, z, w = quaternion_xyzw(T_given)
    center, translation = T_given.copy(), T_given[:3, 3]
    center[:3, 3] = 0.001 * translation
    meant = {
        "the inverse, T_lidar_camera": inverse(T_given),
        "T_body_lidar of a camera's body frame, x forward and z up": optical_body @ T_given,
        "T_lidar_body of a camera's body frame, x forward and z up": optical_body @ inverse(T_given),
        "a quaternion w x y z that was read as x y z w": pose_from_quaternion(
            (y, z, w, x), translation.tolist()
        ),
        "a quaternion x y z w that was read as w x y z": pose_from_quaternion(
            (w, x, y, z), translation.tolist()
        ),
        "a translation in millimetres": center,
    }
    return [
        f"this looks like {name}"
        for name, T in meant.items()
        if _is_near(T, T_estimate, SAME_DEG, SAME_M) and not _is_near(T_given, T_estimate, SAME_DEG, SAME_M)
    ]
