"""The last stage: the uncertainty of a polished pose, and findings against it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from semcal_cli.assessment.clock_error import KNOW_MOTION, UnknownClock, notes_on_clock
from semcal_cli.assessment.consistency import check_consistency
from semcal_cli.assessment.disagreement import check_frames
from semcal_cli.assessment.intrinsics import (
    around_intrinsics,
    covariance_of_intrinsics,
    intrinsics_cost,
    notes_on_intrinsics,
    shift_by,
    wrong_intrinsics,
)
from semcal_cli.assessment.label_alignment import check_label_alignment, check_leaks
from semcal_cli.assessment.pairing import check_pairs
from semcal_cli.assessment.remedies import advise
from semcal_cli.assessment.rivals import check_guide, check_rivals
from semcal_cli.assessment.scale import check_scale
from semcal_cli.assessment.sensitivity import Matrix, Sensitivity, sum_of
from semcal_cli.assessment.stages import Assessment, Stages
from semcal_cli.assessment.uncertainty import estimate_uncertainty, label_bleed, undetermined, with_others
from semcal_cli.config import PolishConfig, RefinementConfig
from semcal_cli.drive.camera import Camera, intrinsic_value, sigma_of, with_intrinsics
from semcal_cli.drive.events import Listener, Progress, StageDone, ignore
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.camera import RefinedCamera
from semcal_cli.result.checks import FEW_SCENES, NOT_DETERMINED, NOT_DETERMINED_TOGETHER, Measured
from semcal_cli.result.uncertainty import IntrinsicsCost, Uncertainty, as_entries
from semcal_cli.threads import thread_pool

NOTHING = NOT_DETERMINED.finding(
    "points and pictures do not determine the pose, their agreement does not fall in every direction"
)
TOGETHER = NOT_DETERMINED_TOGETHER.finding("labels and what is known do not determine the pose together")
KNOW_K = "give --intrinsics-sigma, if K is known better than it says"
"""What to do about an interval that errors of K alone make too wide: more frames do not narrow it."""
MIN_SCENES = FEW_SCENES.limit()
"""Least number of scenes whose edges are trusted, and whose labels tell one top."""


def assess(
    data: LoadedDrive,
    stages: Stages,
    config: RefinementConfig,
    on_event: Listener = ignore,
    *,
    with_label_bleed: bool = True,
    with_remedies: bool = True,
) -> Stages:
    """Estimate the uncertainty of a polished or fused pose and look for findings.

    Where intrinsics or clocks look wrong, they are estimated once, unless `with_remedies` is false. Of several cues,
    rivals are looked for by all, and the rest is checked by `LoadedDrive.for_checks`.

    A pose whose polish was rejected has no uncertainty, since it is no top, and is checked otherwise. One that was not
    polished stays as it is.
    """
    if stages.fused is None and stages.polished is None:
        return stages
    on_event(Progress("assessing"))
    start = perf_counter()
    seen = replace(data, observations=stages.seen or data.observations)
    clock = UnknownClock.of(seen, stages.T_camera_lidar, config.polish)
    answer = _Answer(seen, stages, config.polish, clock)
    if stages.is_rejected:
        measured = check_consistency(
            answer.data.for_checks, answer.T_camera_lidar, with_clock=answer.tells_clock
        )
        found = _compare_frames(answer).with_measured(*measured)
    else:
        found = _judge(answer, with_label_bleed=with_label_bleed and {*data.cues} <= {"labels", "segments"})
    if data.guide is not None and data.is_refined_by_edges:
        T_initial = stages.initial.T_camera_lidar
        found = found.with_measured(check_guide(data.guide, answer.T_camera_lidar, T_initial))
    if with_remedies:
        advised = advise(
            found.findings,
            answer.observations,
            answer.T_camera_lidar,
            answer.config,
            done=config.jointly,
            with_priors=stages.fused is not None,
            time_offset_s=data.drive.time_offset_s,
        )
        found = replace(found, findings=advised)
    stages = replace(stages, assessment=found)
    count = len(stages.findings)
    doubts = {0: "nothing speaks", 1: "1 doubt speaks"}.get(count, f"{count} doubts speak")
    note = f"{doubts} against the pose that was found"
    on_event(StageDone("assessed", perf_counter() - start, note))
    return stages


@dataclass(frozen=True)
class _Answer:
    """The pose that is judged, and where it comes from."""

    data: LoadedDrive
    """The drive, as the camera sees it that the pose belongs to."""
    stages: Stages
    config: PolishConfig
    clock: UnknownClock | None
    """What the frames tell of the clock at the pose; None without a motion."""

    @property
    def tells_clock(self) -> bool:
        """Whether a check of the clock means anything: at one steady speed, any offset fits alike."""
        return self.clock is not None and self.clock.is_checked

    @property
    def is_clock_estimated(self) -> bool:
        """Whether an estimate tells how far the clock may be off, or what is left open beside it does."""
        joint = self.stages.joint
        if joint is None or joint.clock is None:
            return False
        return joint.left_open is not None or joint.clock.is_determined

    @property
    def observations(self) -> Observations:
        return self.data.observations

    @property
    def T_camera_lidar(self) -> Pose:
        return self.stages.T_camera_lidar

    @property
    def label_gain(self) -> Matrix | None:
        """Gain (6, 6) from a twist of the labels' optimum to one of the pose; None where they are the same."""
        return None if self.stages.fused is None else self.stages.fused.label_gain

    @property
    def unknown_camera(self) -> Camera:
        """The camera, which states the errors of those intrinsics alone that no estimate replaces."""
        joint = self.stages.joint
        camera = self.observations.camera
        return camera if joint is None or joint.camera is None else _without_stated(camera, joint.camera)


class _Open(NamedTuple):
    """What stays as the drive says beside the pose, and moves the pose where it is wrong."""

    around: Sensitivity | None
    """Sensitivity to the pose and the intrinsics."""
    cost: IntrinsicsCost | None
    """How far the pose moves by intrinsics that are a little off; None if it is not known."""
    of_stated: Matrix | None
    """(6, 6) covariance of the labels' optimum by errors of the intrinsics, at the pose; None if it is not known."""
    of_intrinsics: Matrix | None
    """(6, 6) part of the covariance of the pose by errors of the intrinsics; None if there is none."""
    of_clock: Matrix | None
    """(6, 6) covariance of the pose by a clock that is not checked; None if that costs nothing."""

    @classmethod
    def beside(cls, answer: _Answer) -> _Open:
        """Compute it at the pose."""
        T, fused, gain = answer.T_camera_lidar, answer.stages.fused, answer.label_gain
        around = around_intrinsics(answer.observations, T)
        shift = shift_by(around)
        if shift is not None and gain is not None:
            shift = gain @ shift
        cost = None if shift is None else intrinsics_cost(shift, answer.observations.camera)
        of_stated = covariance_of_intrinsics(shift, answer.unknown_camera)
        of_intrinsics = of_stated if fused is None else fused.of_intrinsics
        clock = None if answer.is_clock_estimated else answer.clock
        of_clock = None if clock is None else clock.covariance(gain)
        return cls(around, cost, of_stated, of_intrinsics, of_clock)


def _judge(answer: _Answer, *, with_label_bleed: bool) -> Assessment:
    """Estimate the uncertainty of a top of the mutual information, and check it in every way."""
    data, T, with_priors = answer.data, answer.T_camera_lidar, answer.stages.fused is not None
    checked, camera = data.for_checks, data.observations.camera
    beside = _Open.beside(answer)
    around = beside.around if checked is data.observations else around_intrinsics(checked, T)
    # While one check is in Python, the core works for another one.
    with thread_pool() as pool:
        of_frames = pool.submit(_compare_frames, answer)
        of_consistency = pool.submit(check_consistency, checked, T, with_clock=answer.tells_clock)
        of_scale = pool.submit(check_scale, checked)
        of_pose = pool.submit(_uncertainty, answer, beside, with_label_bleed=with_label_bleed)
        frames, uncertainty = of_frames.result(), of_pose.result()
        found = frames.with_measured(
            *of_consistency.result(),
            *_rivals(data, T, uncertainty, with_priors=with_priors),
            *wrong_intrinsics(around, camera, checked.num_cues * len(set(checked.scenes))),
        )
        notes = (*frames.notes, *notes_on_intrinsics(camera, beside.cost), *of_scale.result())
    if uncertainty is None:
        none = TOGETHER if with_priors else NOTHING
        return replace(found, findings=(none, *found.findings), notes=notes)
    too_wide = undetermined(uncertainty, _advice(answer, uncertainty, beside))
    findings = (*found.findings, *too_wide)
    return replace(found, uncertainty=uncertainty, findings=findings, notes=notes, of_clock=beside.of_clock)


def _uncertainty(answer: _Answer, beside: _Open, *, with_label_bleed: bool) -> Uncertainty | None:
    """Estimate the uncertainty of the pose, or take that of the estimate with priors, intrinsics or the clock."""
    observations, T, fused, joint = (
        answer.observations,
        answer.T_camera_lidar,
        answer.stages.fused,
        answer.stages.joint,
    )
    of_others = sum_of(beside.of_stated, beside.of_clock)
    if joint is not None:
        of_others = sum_of(of_others, joint.left_open)
    if joint is not None and joint.uncertainty is not None:
        found: Uncertainty | None = with_others(joint.uncertainty, T, of_others)
    elif fused is not None:
        found = fused.uncertainty
    else:
        band_px = answer.config.edge_band_px
        found = estimate_uncertainty(observations, T, edge_band_px=band_px, of_others=of_others)
    if found is None:
        return None
    bleed = label_bleed(observations, T, answer.config, answer.label_gain) if with_label_bleed else None
    of_intrinsics = None if beside.of_intrinsics is None else as_entries(beside.of_intrinsics)
    parts = {
        "label_bleed": bleed,
        "intrinsics_cost": beside.cost,
        "covariance_of_intrinsics": of_intrinsics,
    }
    return found.model_copy(update=parts)


def _without_stated(camera: Camera, found: RefinedCamera) -> Camera:
    """Leave out the errors of intrinsics that were estimated: the estimate tells how far they may be off."""
    stating = camera.model_copy(update={"intrinsics_sigma": sigma_of(camera)})
    return with_intrinsics(stating, {name: intrinsic_value(camera, name) for name in found.intrinsics})


def _advice(answer: _Answer, found: Uncertainty, beside: _Open) -> str | None:
    """Say what to do about an interval that only what stays open beside the pose makes too wide; None of any other."""
    joint = answer.stages.joint

    def is_narrow_without(part: Matrix | None) -> bool:
        if part is None:
            return False
        # Half widths need the variances alone.
        variances = np.maximum(np.diag(found.covariance) - np.diag(part), 0.0)
        freedom = np.array(found.degrees_of_freedom)
        alone = Uncertainty.from_covariance(answer.T_camera_lidar, np.diag(variances), freedom)
        return not undetermined(alone)

    if joint is not None and is_narrow_without(joint.left_open):
        return joint.advice
    if is_narrow_without(beside.of_clock):
        return KNOW_MOTION
    return KNOW_K if is_narrow_without(beside.of_intrinsics) else None


def _compare_frames(answer: _Answer) -> Assessment:
    """Look for findings about single frames and labels."""
    data, T = answer.data, answer.T_camera_lidar
    observations, names = data.for_checks, [frame.points for frame in data.drive.frames]
    check = check_frames(observations, T, names)
    measured = [*check.measured, *check_pairs(observations, T, answer.stages.last.agreement, names)]
    if data.is_refined_by_edges:
        measured.append(_few_scenes(observations))
    notes = (*data.notes, *_notes_on_scenes(observations), *_unchecked(answer))
    if "labels" in data.cues:
        measured += check_leaks(data.of_cue("labels"), T)
    if data.cues[0] in ("labels", "segments"):
        aligned = check_label_alignment(data.drive, data.of_cue(data.cues[0]))
        measured += aligned.measured
        notes += aligned.notes
    return Assessment(notes=notes, parts=check.parts).with_measured(*measured)


def _rivals(
    data: LoadedDrive, T_camera_lidar: Pose, found: Uncertainty | None, *, with_priors: bool
) -> tuple[Measured, ...]:
    """Look for rivals, but for labels of some scenes, which tell one top, and priors, which rule others out."""
    observations = data.observations
    if observations.starts is None and (with_priors or len(set(observations.scenes)) >= MIN_SCENES):
        return ()
    return check_rivals(observations, T_camera_lidar, found)


def _unchecked(answer: _Answer) -> tuple[str, ...]:
    """Say what could not be checked, since the drive lacks what tells it."""
    data = answer.data
    notes = () if answer.is_clock_estimated else notes_on_clock(data, answer.clock)
    has_labels = any(frame.image_labels is not None for frame in data.drive.frames)
    if has_labels and all(frame.image is None for frame in data.drive.frames):
        notes += ("labels were not checked against pictures: the drive gives no image",)
    return notes


def _few_scenes(observations: Observations) -> Measured:
    """Check that edges were compared in scenes enough to tell the right top from others."""
    num_scenes = len(set(observations.scenes))
    found = f"edges of {num_scenes} scene{'s' * (num_scenes > 1)} were compared, needed at least {MIN_SCENES}"
    return FEW_SCENES.measured(num_scenes, found)


def _notes_on_scenes(observations: Observations) -> tuple[str, ...]:
    """Say how many frames are no new evidence."""
    num_frames, num_scenes = observations.num_frames, len(set(observations.scenes))
    if num_scenes == num_frames:
        return ()
    count = f"{num_scenes} frame" if num_scenes == 1 else f"{num_scenes} frames"
    same = "all show the same scene" if num_scenes == 1 else "others show the same scenes"
    sentence = f"the {num_frames} frames count as {count}, because {same}"
    if num_scenes == 1:
        sentence += "; whether sweeps and pictures belong together cannot be told"
    return (f"{sentence}: add frames from a moving car",)
