"""The last stage: the uncertainty of a polished pose, and findings against it."""

from __future__ import annotations

from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter

import numpy as np

from semcal_cli.checks.cues_disagree import check_coarse_cue
from semcal_cli.checks.families import check_consistency, check_labels, check_recording, check_uncertainty
from semcal_cli.checks.implausible_intrinsics import notes_on_intrinsics
from semcal_cli.checks.moved_camera import check_frames
from semcal_cli.checks.odd_frames import check_pairs
from semcal_cli.checks.other_pose import check_rivals
from semcal_cli.checks.scale import check_scale
from semcal_cli.checks.wrong_intrinsics import check_intrinsics
from semcal_cli.checks.wrong_origin import check_origin
from semcal_cli.config import PolishConfig, RefinementConfig
from semcal_cli.drive.camera import K_ENTRIES, sigma_of
from semcal_cli.errors import counted
from semcal_cli.estimation.adjust.clock import KNOW_MOTION, ClockUncertainty, notes_on_clock
from semcal_cli.estimation.adjust.intrinsics_estimate import IntrinsicsEstimate, estimate_intrinsics
from semcal_cli.estimation.uncertainty.covariance import (
    estimate_uncertainty,
    label_bleed,
    with_others,
)
from semcal_cli.estimation.uncertainty.intrinsics import (
    around_intrinsics,
    intrinsics_cost,
    shift_by,
    twist_by_intrinsics,
)
from semcal_cli.estimation.uncertainty.motion_error import KNOW_POSES, covariance_of_motion
from semcal_cli.estimation.uncertainty.sensitivity import Sensitivity, sum_of
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.findings.check import findings_among
from semcal_cli.findings.symptoms import CLOCKS, OF_A_LOST_POSE, UNTIED_CLOCKS
from semcal_cli.geometry.arrays import Matrix
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.pipeline.stages import Assessment, Stages
from semcal_cli.result.uncertainty import Uncertainty
from semcal_cli.threads import thread_pool

KNOW_SPEED = "give motion.poses, or state time_offset_sigma_s if the moment of the images is known better"
"""Advice where the speed that sweeps show alone makes an interval too wide."""
ADVICE_K = "give a smaller --intrinsics-sigma if K is known better"
"""Advice where errors of K alone make an interval too wide, which more frames do not narrow."""


def assess(
    data: LoadedDrive,
    stages: Stages,
    config: RefinementConfig,
    on_event: Listener = ignore,
    *,
    with_label_bleed: bool = True,
) -> Stages:
    """Estimate the uncertainty of a polished or fused pose and look for findings.

    With several cues, rivals are searched for by all of them, and the other checks use `LoadedDrive.checked_by`.

    A pose whose polish was rejected is not at a maximum: it gets no uncertainty, but is checked. A pose that was not
    polished is returned unchanged.
    """
    if stages.fused is None and stages.polished is None:
        return stages
    on_event(Progress("assessing"))
    start = perf_counter()
    seen, T = stages.seen or data.observations, stages.T_camera_lidar
    used = replace(data, observations=seen)
    pose = _AssessedPose(used, stages, config.polish, ClockUncertainty.of(used, T, config.polish))
    if stages.is_rejected:
        measured = check_consistency(
            used.checked_by, T, estimated_s=pose.estimated_s, T_start=stages.initial.T_camera_lidar
        )
        assessment = _compare_frames(pose).with_measured(*measured)
    else:
        can_bleed = with_label_bleed and data.policy.has_label_bleed
        assessment = _judge(pose, on_event, with_label_bleed=can_bleed)
    if any(finding.topic == CLOCKS for finding in assessment.findings):
        # The finding states the offset.
        clock_notes = notes_on_clock(used, pose.clock)
        assessment = replace(
            assessment, notes=tuple(note for note in assessment.notes if note not in clock_notes)
        )
    if data.coarse_cue is not None and data.policy.needs_near_start:
        # The pose belongs to the camera that was estimated with it.
        coarse_cue = replace(data.coarse_cue, camera=seen.camera)
        by_coarse_cue = check_coarse_cue(coarse_cue, T, stages.initial.T_camera_lidar)
        assessment = assessment.with_measured(by_coarse_cue)
    stages = replace(stages, assessment=assessment)
    if stages.findings and data.policy.wanting_scenes:
        # Rays that start elsewhere explain what speaks against a pose by edges. One sweep shows it.
        origin = check_origin(data.drive, [seen.rays(seen.clouds[0].points)])
        assessment = replace(assessment, findings=(*origin, *assessment.findings))
        stages = replace(stages, assessment=assessment)
    doubts = "there are doubts" if stages.findings else "no doubts"
    on_event(StageDone("assessed", perf_counter() - start, f"{doubts} about the pose"))
    return stages


@dataclass(frozen=True)
class ErrorBudget:
    """Parts of the covariance (6, 6) of a pose by what more frames do not show; None where a part is absent."""

    intrinsics: Matrix | None
    """By errors of the intrinsics that no estimate replaces."""
    clock: Matrix | None
    """By a clock that is not checked."""
    motion: Matrix | None
    """By errors of the motion."""
    speed: Matrix | None
    """By errors of the speed that stands for the motion, and of the moment of the images."""
    left_open: Matrix | None
    """By intrinsics and the clock that a joint estimate leaves as they are."""

    @property
    def clock_and_motion(self) -> Matrix | None:
        """The part by the clock and the motion together."""
        return sum_of(self.clock, self.motion, self.speed)

    @property
    def total(self) -> Matrix | None:
        """All parts together."""
        return sum_of(sum_of(self.intrinsics, self.clock_and_motion), self.left_open)


@dataclass(frozen=True)
class _AssessedPose:
    """The pose to assess, its origin, and the intrinsics and the clock that stay as the drive states them.

    Where these are wrong, they move the pose.
    """

    data: LoadedDrive
    """The drive, as seen by the camera that the pose belongs to."""
    stages: Stages
    config: PolishConfig
    clock: ClockUncertainty | None
    """What the frames show of the clock at the pose; None without a motion."""

    @property
    def estimated_s(self) -> float | None:
        """Estimate of the offset of the clock; None where any fits equally well, as at constant speed."""
        return self.clock.offset_s if self.clock is not None and self.clock.is_checked else None

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

    def tested_intrinsics(self) -> IntrinsicsEstimate | None:
        """Estimate the intrinsics to test them; None if the frames determine none.

        A speed looks like an error of cx, or of cy if the camera is on its side: on KITTI raw, -10 m/s in place of 7
        hide a cx that is 20 pixels off.
        """
        observations, T = self.data.checked_by, self.stages.T_camera_lidar
        is_same = observations is self.data.observations
        # Where the principal point was estimated, it was free when sweeps were deskewed.
        for_intrinsics = None if self.stages.deskewed is None else self.stages.deskewed.for_intrinsics
        if for_intrinsics is not None:
            seen, T = for_intrinsics(self.data.observations.camera)
            observations = replace(self.data, observations=seen).checked_by
        # Where there are many maxima, as by edges, only the motions of the points in the image count. On KITTI object
        # and raw, the speed with cx changes the standard errors by at most 1 %.
        is_known = is_same and (for_intrinsics is None or observations.is_multimodal)
        around = self.around if is_known else around_intrinsics(observations, T)
        return estimate_intrinsics(observations, T, around)

    @cached_property
    def around(self) -> Sensitivity | None:
        """Sensitivity to the pose and the intrinsics."""
        return around_intrinsics(self.data.observations, self.stages.T_camera_lidar)

    @cached_property
    def shift(self) -> Matrix | None:
        """(6, n) twist of the pose per unit of each intrinsic; None if it is unknown."""
        shift = shift_by(self.around)
        return shift if shift is None or self.label_gain is None else self.label_gain @ shift

    @cached_property
    def budget(self) -> ErrorBudget:
        """Parts of the covariance of the pose by the intrinsics, the clock and the motion."""
        joint, clock, twist = self.stages.joint, self.clock, self.twist_by_intrinsics
        return ErrorBudget(
            intrinsics=None if twist is None else np.asarray(twist @ twist.T),
            clock=None if clock is None or self.is_clock_estimated else clock.covariance(self.label_gain),
            motion=self._covariance_of_motion(),
            speed=self._covariance_of_speed(),
            left_open=None if joint is None else joint.left_open,
        )

    @cached_property
    def twist_by_intrinsics(self) -> Matrix | None:
        """(6, 4) twist of the pose by an error of one standard deviation of fx, fy, cx and cy; None without errors."""
        camera, joint, fused = self.data.observations.camera, self.stages.joint, self.stages.fused
        if fused is not None:
            return fused.twist_by_intrinsics
        if joint is not None and joint.camera is not None:
            # An estimate states the errors of the intrinsics that it has.
            exact = {name: 0.0 for name in joint.camera.intrinsics if name in K_ENTRIES}
            stated = sigma_of(camera).model_copy(update=exact)
            camera = camera.model_copy(update={"intrinsics_sigma": stated})
        return twist_by_intrinsics(self.shift, camera)

    def _covariance_of_motion(self) -> Matrix | None:
        joint, later_s = self.stages.joint, 0.0
        if joint is not None and joint.is_kept and joint.clock is not None:
            later_s = joint.clock.time_offset_s - self.data.drive.time_offset_s
        return covariance_of_motion(self.data, self.stages.T_camera_lidar, self.label_gain, later_s)

    def _covariance_of_speed(self) -> Matrix | None:
        if self.stages.is_joint:
            # That of the estimate includes it.
            return None
        covariance = None if self.stages.deskewed is None else self.stages.deskewed.covariance
        if covariance is None or self.label_gain is None:
            return covariance
        return np.asarray(self.label_gain @ covariance @ self.label_gain.T)


def _judge(pose: _AssessedPose, on_event: Listener, *, with_label_bleed: bool) -> Assessment:
    """Estimate the uncertainty of a maximum of the mutual information, and run all checks."""
    data, T, with_priors = pose.data, pose.stages.T_camera_lidar, pose.stages.fused is not None
    of_checks, camera, budget = data.checked_by, data.observations.camera, pose.budget
    cost = None if pose.shift is None else intrinsics_cost(pose.shift, camera)
    # While one check runs Python code, the core works on another one.
    with thread_pool() as pool:
        of_frames = pool.submit(_compare_frames, pose)
        of_consistency = pool.submit(
            check_consistency,
            of_checks,
            T,
            estimated_s=pose.estimated_s,
            T_start=pose.stages.initial.T_camera_lidar,
        )
        of_scale = pool.submit(check_scale, of_checks)
        of_pose = pool.submit(_uncertainty, pose, with_label_bleed=with_label_bleed)
        started = of_frames, of_consistency, of_scale, of_pose
        for done, _ in enumerate(as_completed(started), start=1):
            on_event(Progress("assessing", done, len(started) + 2))
        frames, uncertainty, consistency = of_frames.result(), of_pose.result(), of_consistency.result()
        rivals = check_rivals(data.observations, T, uncertainty, with_priors=with_priors)
        on_event(Progress("assessing", len(started) + 1, len(started) + 2))
        # Where the pose itself is wrong, its surroundings say nothing about K.
        is_lost = any(finding.topic in OF_A_LOST_POSE for finding in findings_among(consistency))
        tested = check_intrinsics(None if is_lost else pose.tested_intrinsics(), camera)
        assessment = frames.with_measured(
            *consistency,
            *rivals,
            *tested.measured,
        )
        notes_on_scale = (finding.sentence for finding in of_scale.result())
        notes = (*frames.notes, *tested.notes, *notes_on_intrinsics(camera, cost), *notes_on_scale)
    assessment = replace(assessment, checked_intrinsics=tested.checked)
    if uncertainty is None:
        undetermined = check_uncertainty(None, with_priors=with_priors)
        return replace(assessment, findings=(*undetermined, *assessment.findings), notes=notes)
    wide = check_uncertainty(uncertainty, advice=_advice(pose, uncertainty))
    return replace(
        assessment,
        uncertainty=uncertainty.model_copy(update={"intrinsics_cost": cost}),
        findings=(*assessment.findings, *wide),
        notes=notes,
        motion_covariance=budget.clock_and_motion,
    )


def _uncertainty(pose: _AssessedPose, *, with_label_bleed: bool) -> Uncertainty | None:
    """Estimate the uncertainty of the pose, or take that of the estimate with priors, intrinsics or the clock."""
    observations, T = pose.data.observations, pose.stages.T_camera_lidar
    fused, joint, config, budget = pose.stages.fused, pose.stages.joint, pose.config, pose.budget
    if joint is not None and joint.uncertainty is not None:
        uncertainty: Uncertainty | None = with_others(joint.uncertainty, T, budget.total)
    elif fused is not None:
        uncertainty = fused.uncertainty
    else:
        uncertainty = estimate_uncertainty(observations, T, of_others=budget.total)
    if uncertainty is None:
        return None
    of_K, twist = budget.intrinsics, pose.twist_by_intrinsics
    parts = {
        "label_bleed": label_bleed(observations, T, config, pose.label_gain) if with_label_bleed else None,
        "covariance_of_intrinsics": None if of_K is None else tuple(map(tuple, of_K.tolist())),
        "twist_by_intrinsics": None if twist is None else tuple(map(tuple, twist.tolist())),
    }
    return uncertainty.model_copy(update=parts)


def _advice(pose: _AssessedPose, uncertainty: Uncertainty) -> str | None:
    """Describe what to do where only unknowns besides the pose make an interval too wide; None for other intervals."""
    joint, budget = pose.stages.joint, pose.budget

    def is_narrow_without(part: Matrix | None) -> bool:
        if part is None:
            return False
        # Half widths need only the variances.
        variances = np.maximum(np.diag(uncertainty.covariance) - np.diag(part), 0.0)
        freedom = np.array(uncertainty.degrees_of_freedom)
        alone = Uncertainty.from_covariance(pose.stages.T_camera_lidar, np.diag(variances), freedom)
        return not check_uncertainty(alone)

    if joint is not None and is_narrow_without(budget.left_open):
        return joint.advice
    if is_narrow_without(budget.clock):
        return KNOW_MOTION
    if is_narrow_without(budget.motion):
        return KNOW_POSES
    if is_narrow_without(budget.speed):
        return KNOW_SPEED
    return ADVICE_K if is_narrow_without(budget.intrinsics) else None


def _compare_frames(pose: _AssessedPose) -> Assessment:
    """Look for findings about single frames and labels, and say what could not be checked."""
    data, T, frames = pose.data, pose.stages.T_camera_lidar, pose.data.drive.frames
    observations, names = data.checked_by, [frame.points for frame in frames]
    check = check_frames(observations, T, names)
    measured = [*check.measured, *check_pairs(observations, T, pose.stages.last.agreement, names)]
    measured += check_recording(data, pose.clock, with_clock=not pose.is_clock_estimated)
    num_scenes = len(set(observations.scenes))
    deskewed = pose.stages.deskewed
    notes = [*data.notes, *(data.notes_on_spin if deskewed is None else (deskewed.note,))]
    if num_scenes < observations.num_frames:
        same = "the others show the same scenes"
        if num_scenes == 1:
            same = "all show the same scene, so whether sweeps and images belong together cannot be checked"
        notes.append(
            f"the {observations.num_frames} frames count as {counted(num_scenes, 'frame')}, because {same}: add frames "
            "from other places"
        )
    topics = {finding.topic for finding in findings_among(measured)}
    if not pose.is_clock_estimated and UNTIED_CLOCKS not in topics:
        notes += notes_on_clock(data, pose.clock)
    label_checks, notes_on_labels = check_labels(data, T)
    notes += notes_on_labels
    return Assessment(notes=tuple(notes), parts=check.parts).with_measured(*measured, *label_checks)
