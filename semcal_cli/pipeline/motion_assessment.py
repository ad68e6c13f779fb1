"""Whether the motion of a drive is that of its sweeps, and the rotation of a pose that of camera and LiDAR."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np

from semcal_cli.checks.camera_motion import check_camera_motion
from semcal_cli.checks.wrong_motion import check_stated_motion
from semcal_cli.estimation.adjust.deskewed import remaining_speed
from semcal_cli.estimation.search.hand_eye import NotDetermined, hand_eye
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.findings.check import Measured
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.motion import twists_per_s
from semcal_cli.observations.skew import Skew
from semcal_cli.pipeline.stages import Stages

MAX_TURNS_FROM_FACING = 0.25
"""Turns of the LiDAR from facing a camera to its image, from which a note is due: a trigger takes milliseconds."""


def compare_speed(data: LoadedDrive, stages: Stages) -> Stages:
    """Check that the stated motion leaves no speed in the sweeps; a speed without a direction cannot be checked.

    A note says what it costs if a camera was triggered when the LiDAR faced its view, but the drive states otherwise.
    """
    motion, assessment = data.drive.motion, stages.assessment
    if motion is None or assessment is None or motion.speed_m_s:
        return stages
    skew = Skew.of(data.drive.model_copy(update={"motion": None}), stages.T_camera_lidar)
    if skew is None:
        return stages
    twists = twists_per_s(data.observations)
    if twists is not None and abs(skew.since_facing_s) * skew.spin.rate_hz > MAX_TURNS_FROM_FACING:
        speed_m_s = float(np.linalg.norm(np.mean(twists, axis=0)[:3]))
        when = f"{1e3 * abs(skew.since_facing_s):.0f} ms {'before' if skew.since_facing_s < 0.0 else 'after'}"
        note = (
            f"images are taken {when} the LiDAR faces where the camera looks, by `points_stamp`, `lidar.spin` and "
            f"`time_offset_s`: if it triggers the camera when it faces there, the camera is "
            f"{100.0 * speed_m_s * abs(skew.since_facing_s):.0f} cm off at {speed_m_s:.1f} m/s"
        )
        assessment = replace(assessment, notes=(*assessment.notes, note))
    if (left := remaining_speed(stages.seen or data.observations, skew, stages.T_camera_lidar)) is not None:
        sigma_m_s = 0.0 if motion.sigma is None else motion.sigma.linear_m_s
        assessment = assessment.with_measured(check_stated_motion(left, sigma_m_s))
    return replace(stages, assessment=assessment)


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
    by_motion = (stages.searched and stages.searched.by_motion) or hand_eye(data.recorded or data.drive)
    if isinstance(by_motion, NotDetermined) and by_motion.is_unsuited:
        return stages
    measured = list[Measured]()
    if isinstance(by_motion, NotDetermined):
        note = f"the rotation was not checked against the motion of camera and LiDAR: {by_motion.why}"
    else:
        covariance = None if stages.uncertainty is None else np.array(stages.uncertainty.covariance)
        measured.append(check_camera_motion(by_motion, stages.T_camera_lidar, covariance))
        note = (
            f"{by_motion.sentence}, which {'contradicts' if measured[0].findings else 'agrees with'} the pose"
        )
    on_event(StageDone("motion", perf_counter() - start, note))
    notes = (*assessment.notes, note)
    return replace(stages, assessment=replace(assessment, notes=notes).with_measured(*measured))
