"""The last stage: the uncertainty of a polished pose, and findings against it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from semcal_cli import _core
from semcal_cli.assessment.clock_error import KNOW_MOTION, covariance_of_clock, notes_on_clock
from semcal_cli.assessment.consistency import check_consistency
from semcal_cli.assessment.disagreement import check_frames
from semcal_cli.assessment.fusion import Fused
from semcal_cli.assessment.intrinsics import (
    around_intrinsics,
    covariance_of_intrinsics,
    intrinsics_cost,
    notes_on_intrinsics,
    shift_by,
    wrong_intrinsics,
)
from semcal_cli.assessment.joint import Joint
from semcal_cli.assessment.label_alignment import check_label_alignment
from semcal_cli.assessment.leaked_labels import check_leaks
from semcal_cli.assessment.measurement import sum_of
from semcal_cli.assessment.pairing import check_pairs
from semcal_cli.assessment.rivals import check_rivals
from semcal_cli.assessment.scale import check_scale
from semcal_cli.assessment.sensitivity import Matrix, Sensitivity
from semcal_cli.assessment.uncertainty import estimate_uncertainty, label_bleed, undetermined, with_others
from semcal_cli.checks.check import Measured, findings_among
from semcal_cli.checks.determination import NOT_DETERMINED, NOT_DETERMINED_TOGETHER
from semcal_cli.checks.mounting import FEW_SCENES
from semcal_cli.config import PolishConfig
from semcal_cli.drive.document import Camera
from semcal_cli.drive.intrinsics import intrinsic_value, sigma_of, with_intrinsics
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.camera import RefinedCamera
from semcal_cli.result.parts import DrivePart
from semcal_cli.result.stage import Finding
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


@dataclass(frozen=True)
class Assessment:
    """Uncertainty of a pose, and findings against it."""

    uncertainty: Uncertainty | None
    """Uncertainty of the pose; None if the data do not determine it."""
    findings: tuple[Finding, ...]
    """Findings of the assessment against the pose."""
    notes: tuple[str, ...] = ()
    """Sentences that a person should know and that do not speak against the pose."""
    parts: tuple[DrivePart, ...] = ()
    """Parts of the drive, if its frames fit several poses."""
    measured: tuple[Measured, ...] = ()
    """What the checks measured, whether or not it is beyond their limits."""

    def with_measured(self, *measured: Measured) -> Assessment:
        """Add what more checks measured, with their findings."""
        findings = (*self.findings, *findings_among(measured))
        return replace(self, findings=findings, measured=(*self.measured, *measured))


def assess(
    data: LoadedDrive,
    T_camera_lidar: Pose,
    agreement: _core.Agreement,
    config: PolishConfig,
    fused: Fused | None = None,
    joint: Joint | None = None,
    *,
    with_label_bleed: bool = True,
) -> Assessment:
    """Estimate the uncertainty of a polished pose, and look for findings against it.

    Of several cues, rivals are looked for by all, and the rest is checked by `LoadedDrive.for_checks`.

    Args:
        data: The drive, as `load` returns it.
        T_camera_lidar: (4, 4), p_camera = T_camera_lidar @ p_lidar, metres.
        agreement: Agreement of the observations at this pose.
        config: Settings of the polish.
        fused: Result of the fusion with priors, if there are any.
        joint: Estimate of the pose with intrinsics or the clock, whether or not it was kept, if there is one.
        with_label_bleed: Whether to compute the effect of bleeding labels.
    """
    observations, checked, camera = data.observations, data.for_checks, data.observations.camera
    label_gain = None if fused is None else fused.label_gain
    stated = camera if joint is None or joint.camera is None else _without_stated(camera, joint.camera)
    effect = _EffectOfIntrinsics.at(observations, T_camera_lidar, label_gain, stated)
    around = effect.around if checked is observations else around_intrinsics(checked, T_camera_lidar)

    of_intrinsics = effect.of_stated if fused is None else fused.of_intrinsics
    # An estimate of the clock tells how far it may be off.
    is_estimated = joint is not None and joint.clock is not None
    of_clock = None if is_estimated else covariance_of_clock(data.drive, T_camera_lidar, label_gain)

    def uncertain() -> Uncertainty | None:
        of_others = sum_of(effect.of_stated, of_clock)
        found = _uncertainty(observations, T_camera_lidar, config, fused, joint, of_others)
        if found is None:
            return None
        bleed = label_bleed(observations, T_camera_lidar, config, label_gain) if with_label_bleed else None
        return found.model_copy(
            update={
                "label_bleed": bleed,
                "intrinsics_cost": effect.cost,
                "covariance_of_intrinsics": None if of_intrinsics is None else as_entries(of_intrinsics),
            }
        )

    # While one check is in Python, the core works for another one.
    with thread_pool() as pool:
        of_frames = pool.submit(compare_frames, data, T_camera_lidar, agreement)
        of_consistency = pool.submit(check_consistency, checked, T_camera_lidar)
        of_scale = pool.submit(check_scale, checked)
        of_pose = pool.submit(uncertain)
        frames, found = of_frames.result(), of_pose.result()
        checked_all = frames.with_measured(
            *of_consistency.result(),
            *_rivals(data, T_camera_lidar, found, with_priors=fused is not None),
            *wrong_intrinsics(around, camera, checked.num_cues * len(set(checked.scenes))),
        )
        notes = (*frames.notes, *notes_on_intrinsics(camera, effect.cost), *of_scale.result())
    findings = checked_all.findings
    if found is None:
        none = NOTHING if fused is None else TOGETHER
        return replace(checked_all, findings=(none, *findings), notes=notes)
    too_wide = undetermined(found, _advice(found, T_camera_lidar, joint, of_intrinsics, of_clock))
    return replace(checked_all, uncertainty=found, findings=(*findings, *too_wide), notes=notes)


def assess_rejected(data: LoadedDrive, T_camera_lidar: Pose, agreement: _core.Agreement) -> Assessment:
    """Look for findings against a pose whose polish was rejected: it is no top, and so has no uncertainty.

    Args:
        data: The drive, as `load` returns it.
        T_camera_lidar: (4, 4) pose before the polish, metres.
        agreement: Agreement of the observations at this pose.
    """
    frames = compare_frames(data, T_camera_lidar, agreement)
    return frames.with_measured(*check_consistency(data.for_checks, T_camera_lidar))


class _EffectOfIntrinsics(NamedTuple):
    """What intrinsics that are off do to the pose."""

    around: Sensitivity | None
    of_stated: Matrix | None
    """(6, 6) covariance of the pose by errors of the intrinsics; None if it is not known."""
    cost: IntrinsicsCost | None

    @classmethod
    def at(
        cls, observations: Observations, T_camera_lidar: Pose, label_gain: Matrix | None, stated: Camera
    ) -> _EffectOfIntrinsics:
        """Compute the effect at a pose (4, 4), to whose twist (6, 6) `label_gain` brings one of the labels' optimum.

        `stated` is the camera with the errors that no estimate replaces.
        """
        around = around_intrinsics(observations, T_camera_lidar)
        shift = shift_by(around)
        if shift is not None and label_gain is not None:
            shift = label_gain @ shift
        cost = None if shift is None else intrinsics_cost(shift, observations.camera)
        return cls(around, covariance_of_intrinsics(shift, stated), cost)


def _uncertainty(
    observations: Observations,
    T_camera_lidar: Pose,
    config: PolishConfig,
    fused: Fused | None,
    joint: Joint | None,
    of_others: Matrix | None,
) -> Uncertainty | None:
    """Estimate the uncertainty of the pose, or take that of the estimate with priors, intrinsics or the clock."""
    if joint is not None:
        of_others = sum_of(of_others, joint.left_open)
    if joint is not None and joint.uncertainty is not None:
        return with_others(joint.uncertainty, T_camera_lidar, of_others)
    if fused is not None:
        return fused.uncertainty
    return estimate_uncertainty(
        observations, T_camera_lidar, edge_band_px=config.edge_band_px, of_others=of_others
    )


def _without_stated(camera: Camera, found: RefinedCamera) -> Camera:
    """Leave out the errors of intrinsics that were estimated: the estimate tells how far they may be off."""
    stating = camera.model_copy(update={"intrinsics_sigma": sigma_of(camera)})
    return with_intrinsics(stating, {name: intrinsic_value(camera, name) for name in found.intrinsics})


def _advice(
    found: Uncertainty,
    T_camera_lidar: Pose,
    joint: Joint | None,
    of_intrinsics: Matrix | None,
    of_clock: Matrix | None,
) -> str | None:
    """Say what to do about an interval that only what stays open beside the pose makes too wide; None of any other."""

    def is_narrow_without(part: Matrix | None) -> bool:
        if part is None:
            return False
        # Half widths need the variances alone.
        variances = np.maximum(np.diag(found.covariance) - np.diag(part), 0.0)
        freedom = np.array(found.degrees_of_freedom)
        alone = Uncertainty.from_covariance(T_camera_lidar, np.diag(variances), freedom)
        return not undetermined(alone)

    if joint is not None and is_narrow_without(joint.left_open):
        return joint.advice
    if is_narrow_without(of_clock):
        return KNOW_MOTION
    return KNOW_K if is_narrow_without(of_intrinsics) else None


def compare_frames(data: LoadedDrive, T_camera_lidar: Pose, agreement: _core.Agreement) -> Assessment:
    """Look for findings about single frames and labels.

    Args:
        data: The drive, as `load` returns it.
        T_camera_lidar: (4, 4), metres.
        agreement: Agreement of the observations at this pose.
    """
    observations, names = data.for_checks, [frame.points for frame in data.drive.frames]
    check = check_frames(observations, T_camera_lidar, names)
    measured = [*check.measured, *check_pairs(observations, T_camera_lidar, agreement, names)]
    if data.is_refined_by_edges:
        measured.append(_few_scenes(observations))
    notes = (*data.notes, *_notes_on_scenes(observations), *_unchecked(data))
    if "labels" in data.cues:
        measured += check_leaks(data.of_cue("labels"), T_camera_lidar)
    if data.cues[0] in ("labels", "segments"):
        aligned = check_label_alignment(data.drive, data.of_cue(data.cues[0]))
        measured += aligned.measured
        notes += aligned.notes
    return Assessment(None, (), notes, check.parts).with_measured(*measured)


def _rivals(
    data: LoadedDrive, T_camera_lidar: Pose, found: Uncertainty | None, *, with_priors: bool
) -> tuple[Measured, ...]:
    """Look for rivals, but for labels of some scenes, which tell one top, and priors, which rule others out."""
    observations = data.observations
    if observations.starts is None and (with_priors or len(set(observations.scenes)) >= MIN_SCENES):
        return ()
    return check_rivals(observations, T_camera_lidar, found)


def _unchecked(data: LoadedDrive) -> tuple[str, ...]:
    """Say what could not be checked, since the drive lacks what tells it."""
    notes = notes_on_clock(data)
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
