"""The last stage: the uncertainty of a polished pose, and findings against it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter

import numpy as np

from semcal_cli.checks.camera_motion import check_camera_motion
from semcal_cli.checks.consistency import check_consistency
from semcal_cli.checks.disagreement import check_frames
from semcal_cli.checks.label_alignment import check_label_alignment, check_leaks
from semcal_cli.checks.pairing import check_pairs
from semcal_cli.checks.rivals import check_guide, check_rivals
from semcal_cli.checks.scale import check_scale
from semcal_cli.config import PolishConfig, RefinementConfig
from semcal_cli.drive.camera import K_ENTRIES, sigma_of
from semcal_cli.errors import counted
from semcal_cli.estimation.adjust.clock import KNOW_MOTION, UnknownClock, notes_on_clock
from semcal_cli.estimation.search.hand_eye import NotDetermined, hand_eye
from semcal_cli.estimation.uncertainty.covariance import (
    estimate_uncertainty,
    label_bleed,
    undetermined,
    with_others,
)
from semcal_cli.estimation.uncertainty.intrinsics import (
    around_intrinsics,
    covariance_of_intrinsics,
    intrinsics_cost,
    notes_on_intrinsics,
    shift_by,
    wrong_intrinsics,
)
from semcal_cli.estimation.uncertainty.motion_error import KNOW_POSES, covariance_of_motion
from semcal_cli.estimation.uncertainty.sensitivity import Sensitivity, sum_of
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.findings.check import FEW_SCENES, NOT_DETERMINED, NOT_DETERMINED_TOGETHER, Measured
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.pipeline.stages import Assessment, Stages
from semcal_cli.result.uncertainty import Uncertainty
from semcal_cli.threads import thread_pool

NOTHING = NOT_DETERMINED.finding(
    "points and images do not determine the pose, since moving the camera in some direction does not reduce their "
    "agreement"
)
TOGETHER = NOT_DETERMINED_TOGETHER.finding("labels and priors together do not determine the pose")
KNOW_K = "give a smaller --intrinsics-sigma if K is known better"
"""Advice where errors of K alone make an interval too wide, which more frames do not narrow."""
MIN_SCENES = FEW_SCENES.limit()
"""Least number of scenes from which edges are trusted, and labels have a single top."""


def assess(
    data: LoadedDrive,
    stages: Stages,
    config: RefinementConfig,
    on_event: Listener = ignore,
    *,
    with_label_bleed: bool = True,
) -> Stages:
    """Estimate the uncertainty of a polished or fused pose and look for findings.

    With several cues, rivals are searched for by all of them, and the other checks use `LoadedDrive.for_checks`.

    A pose whose polish was rejected is not at a top: it gets no uncertainty, but is checked. A pose that was not
    polished is returned unchanged.
    """
    if stages.fused is None and stages.polished is None:
        return stages
    on_event(Progress("assessing"))
    start = perf_counter()
    seen, T = replace(data, observations=stages.seen or data.observations), stages.T_camera_lidar
    answer = _Answer(seen, stages, config.polish, UnknownClock.of(seen, T, config.polish))
    if stages.is_rejected:
        measured = check_consistency(seen.for_checks, T, with_clock=answer.tells_clock)
        found = _compare_frames(answer).with_measured(*measured)
    else:
        found = _judge(answer, with_label_bleed=with_label_bleed and {*data.cues} <= {"labels", "segments"})
    if data.guide is not None and data.is_refined_by_edges:
        found = found.with_measured(check_guide(data.guide, T, stages.initial.T_camera_lidar))
    stages = replace(stages, assessment=found)
    doubts = counted(len(stages.findings), "doubt") if stages.findings else "no doubts"
    on_event(StageDone("assessed", perf_counter() - start, f"{doubts} about the pose"))
    return stages


@dataclass(frozen=True)
class _Answer:
    """The pose to assess, its origin, and the intrinsics and the clock that stay as the drive states them.

    Where these are wrong, they move the pose.
    """

    data: LoadedDrive
    """The drive, as seen by the camera that the pose belongs to."""
    stages: Stages
    config: PolishConfig
    clock: UnknownClock | None
    """What the frames show of the clock at the pose; None without a motion."""

    @property
    def tells_clock(self) -> bool:
        """Whether a check of the clock is meaningful: at constant speed, any time offset fits equally well."""
        return self.clock is not None and self.clock.is_checked

    @property
    def is_clock_estimated(self) -> bool:
        """Whether a joint estimate, or its open part, covers the error of the clock."""
        joint = self.stages.joint
        if joint is None or joint.clock is None:
            return False
        return joint.left_open is not None or joint.clock.is_determined

    @property
    def label_gain(self) -> Matrix | None:
        """Gain (6, 6) from a twist of the labels' optimum to one of the pose; None where they are the same."""
        return None if self.stages.fused is None else self.stages.fused.label_gain

    @cached_property
    def around(self) -> Sensitivity | None:
        """Sensitivity to the pose and the intrinsics."""
        return around_intrinsics(self.data.observations, self.stages.T_camera_lidar)

    @cached_property
    def shift(self) -> Matrix | None:
        """(6, n) twist of the pose per unit of each intrinsic; None if it is unknown."""
        shift = shift_by(self.around)
        return shift if shift is None or self.label_gain is None else self.label_gain @ shift

    @property
    def of_stated(self) -> Matrix | None:
        """(6, 6) covariance of the pose from errors of the intrinsics that no estimate replaces; None if unknown."""
        camera, joint = self.data.observations.camera, self.stages.joint
        if joint is not None and joint.camera is not None:
            # An estimate states the errors of the intrinsics that it found.
            found = {name: 0.0 for name in joint.camera.intrinsics if name in K_ENTRIES}
            stated = sigma_of(camera).model_copy(update=found)
            camera = camera.model_copy(update={"intrinsics_sigma": stated})
        return covariance_of_intrinsics(self.shift, camera)

    @property
    def of_intrinsics(self) -> Matrix | None:
        """(6, 6) part of the covariance of the pose from errors of the intrinsics; None if there is none."""
        fused = self.stages.fused
        return self.of_stated if fused is None else fused.of_intrinsics

    @property
    def of_clock(self) -> Matrix | None:
        """(6, 6) covariance of the pose from a clock that is not checked; None if it has no effect."""
        if self.clock is None or self.is_clock_estimated:
            return None
        return self.clock.covariance(self.label_gain)

    @property
    def of_poses(self) -> Matrix | None:
        """(6, 6) covariance of the pose by errors of the motion; None if the drive takes it as right."""
        joint = self.stages.joint
        later_s = 0.0
        if joint is not None and joint.is_kept and joint.clock is not None:
            later_s = joint.clock.time_offset_s - self.data.drive.time_offset_s
        return covariance_of_motion(self.data, self.stages.T_camera_lidar, self.label_gain, later_s)

    @property
    def of_motion(self) -> Matrix | None:
        """(6, 6) covariance of the pose by the clock and by the motion; None if both cost nothing."""
        return sum_of(self.of_clock, self.of_poses)


def _judge(answer: _Answer, *, with_label_bleed: bool) -> Assessment:
    """Estimate the uncertainty of a top of the mutual information, and run all checks."""
    data, T, with_priors = answer.data, answer.stages.T_camera_lidar, answer.stages.fused is not None
    checked, camera = data.for_checks, data.observations.camera
    cost = None if answer.shift is None else intrinsics_cost(answer.shift, camera)
    around = answer.around if checked is data.observations else around_intrinsics(checked, T)
    # While one check runs Python code, the core works on another one.
    with thread_pool() as pool:
        of_frames = pool.submit(_compare_frames, answer)
        of_consistency = pool.submit(check_consistency, checked, T, with_clock=answer.tells_clock)
        of_scale = pool.submit(check_scale, checked)
        of_pose = pool.submit(_uncertainty, answer, with_label_bleed=with_label_bleed)
        frames, uncertainty = of_frames.result(), of_pose.result()
        found = frames.with_measured(
            *of_consistency.result(),
            *_rivals(data, T, uncertainty, with_priors=with_priors),
            *wrong_intrinsics(around, camera, checked.num_cues * len(set(checked.scenes))),
        )
        notes = (*frames.notes, *notes_on_intrinsics(camera, cost), *of_scale.result())
    if uncertainty is None:
        none = TOGETHER if with_priors else NOTHING
        return replace(found, findings=(none, *found.findings), notes=notes)
    uncertainty = uncertainty.model_copy(update={"intrinsics_cost": cost})
    findings = (*found.findings, *undetermined(uncertainty, _advice(answer, uncertainty)))
    return replace(found, uncertainty=uncertainty, findings=findings, notes=notes, of_motion=answer.of_motion)


def _uncertainty(answer: _Answer, *, with_label_bleed: bool) -> Uncertainty | None:
    """Estimate the uncertainty of the pose, or take that of the estimate with priors, intrinsics or the clock."""
    observations, T = answer.data.observations, answer.stages.T_camera_lidar
    fused, joint, config = answer.stages.fused, answer.stages.joint, answer.config
    of_others = sum_of(answer.of_stated, answer.of_motion)
    if joint is not None:
        of_others = sum_of(of_others, joint.left_open)
    if joint is not None and joint.uncertainty is not None:
        found: Uncertainty | None = with_others(joint.uncertainty, T, of_others)
    elif fused is not None:
        found = fused.uncertainty
    else:
        found = estimate_uncertainty(observations, T, edge_band_px=config.edge_band_px, of_others=of_others)
    if found is None:
        return None
    of_K = answer.of_intrinsics
    parts = {
        "label_bleed": label_bleed(observations, T, config, answer.label_gain) if with_label_bleed else None,
        "covariance_of_intrinsics": None if of_K is None else tuple(map(tuple, of_K.tolist())),
    }
    return found.model_copy(update=parts)


def _advice(answer: _Answer, found: Uncertainty) -> str | None:
    """Say what to do where only unknowns besides the pose make an interval too wide; None for other intervals."""
    joint = answer.stages.joint

    def is_narrow_without(part: Matrix | None) -> bool:
        if part is None:
            return False
        # Half widths need only the variances.
        variances = np.maximum(np.diag(found.covariance) - np.diag(part), 0.0)
        freedom = np.array(found.degrees_of_freedom)
        alone = Uncertainty.from_covariance(answer.stages.T_camera_lidar, np.diag(variances), freedom)
        return not undetermined(alone)

    if joint is not None and is_narrow_without(joint.left_open):
        return joint.advice
    if is_narrow_without(answer.of_clock):
        return KNOW_MOTION
    if is_narrow_without(answer.of_poses):
        return KNOW_POSES
    return KNOW_K if is_narrow_without(answer.of_intrinsics) else None


def _compare_frames(answer: _Answer) -> Assessment:
    """Look for findings about single frames and labels, and say what could not be checked."""
    data, T, frames = answer.data, answer.stages.T_camera_lidar, answer.data.drive.frames
    observations, names = data.for_checks, [frame.points for frame in frames]
    check = check_frames(observations, T, names)
    measured = [*check.measured, *check_pairs(observations, T, answer.stages.last.agreement, names)]
    num_scenes = len(set(observations.scenes))
    if data.is_refined_by_edges:
        compared = f"edges were compared in {counted(num_scenes, 'scene')}"
        measured.append(FEW_SCENES.measured(num_scenes, f"{compared}, needed at least {MIN_SCENES}"))
    notes = [*data.notes]
    if num_scenes < observations.num_frames:
        same = "the others show the same scenes"
        if num_scenes == 1:
            same = "all show the same scene, so whether sweeps and images belong together cannot be checked"
        notes.append(
            f"the {observations.num_frames} frames count as {counted(num_scenes, 'frame')}, because {same}: add frames "
            "recorded while driving"
        )
    if not answer.is_clock_estimated:
        notes += notes_on_clock(data, answer.clock)
    has_labels = any(frame.image_labels is not None for frame in frames)
    if has_labels and all(frame.image is None for frame in frames):
        notes.append("labels were not checked against images: the drive has no images")
    if "labels" in data.cues:
        measured += check_leaks(data.of_cue("labels"), T)
    if data.cues[0] in ("labels", "segments"):
        aligned = check_label_alignment(data.drive, data.of_cue(data.cues[0]))
        measured += aligned.measured
        notes += aligned.notes
    return Assessment(notes=tuple(notes), parts=check.parts).with_measured(*measured)


def _rivals(
    data: LoadedDrive, T_camera_lidar: Pose, found: Uncertainty | None, *, with_priors: bool
) -> tuple[Measured, ...]:
    """Look for rivals, except with labels of enough scenes, which have one top, or priors, which exclude them."""
    observations = data.observations
    if observations.starts is None and (with_priors or len(set(observations.scenes)) >= MIN_SCENES):
        return ()
    return check_rivals(observations, T_camera_lidar, found)


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
