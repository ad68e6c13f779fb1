"""Checks that are made together: of the data, of the stages, of a pose, and of its uncertainty."""

from __future__ import annotations

from semcal_cli import core
from semcal_cli.checks.baseline import check_baseline
from semcal_cli.checks.chance import check_chance
from semcal_cli.checks.few_scenes import check_scenes
from semcal_cli.checks.label_overlap import check_overlap
from semcal_cli.checks.leaked_labels import check_leaks
from semcal_cli.checks.mirrored_clouds import check_mirrored_edges
from semcal_cli.checks.motion_unstated import check_motion, check_shutter, check_unstated
from semcal_cli.checks.no_direction import check_directions
from semcal_cli.checks.not_determined import UNDETERMINED, UNDETERMINED_WITH_PRIORS
from semcal_cli.checks.one_class import check_classes
from semcal_cli.checks.other_azimuth import check_azimuth
from semcal_cli.checks.polish_rejected import check_held_out
from semcal_cli.checks.prior import check_priors
from semcal_cli.checks.refined_aspect import check_aspect
from semcal_cli.checks.refits import check_other_models
from semcal_cli.checks.settled import check_fusion, check_polish, check_refinement
from semcal_cli.checks.shifted_labels import check_label_alignment
from semcal_cli.checks.shifted_pairing import check_shifted_pairing
from semcal_cli.checks.untied_clocks import check_clocks
from semcal_cli.checks.wide_interval import check_interval
from semcal_cli.checks.wrong_pairing import check_pairing
from semcal_cli.drive.document import Drive
from semcal_cli.estimation.adjust.clock import ClockUncertainty
from semcal_cli.estimation.adjust.joint import JointEstimate
from semcal_cli.estimation.adjust.priors import Fused
from semcal_cli.estimation.refine.polish import Polish
from semcal_cli.estimation.refine.pyramid import Refinement
from semcal_cli.findings.check import Measured, findings_among
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.symptoms import OF_A_LOST_POSE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.result.uncertainty import Uncertainty

NUM_FRAMES = 4
"""Number of frames whose consistency is checked."""


def check_data(
    drive: Drive, observations: Observations, *, is_compensated: bool
) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """Check that the motion of a drive is known and compensated.

    Args:
        drive: The drive.
        observations: Observations of it.
        is_compensated: Whether the method compensates a rolling shutter where the motion is known.

    Returns:
        Findings, and notes that do not speak against a pose.
    """
    shutter_findings, notes = check_shutter(drive, observations, is_compensated=is_compensated)
    motion_findings = check_motion(observations.motion_error_px)
    num_scenes, num_frames = len(set(observations.scenes)), observations.num_frames
    unstated = check_unstated(drive, num_scenes, num_frames, have_times=observations.have_times)
    return (*motion_findings, *shutter_findings, *unstated), notes


def check_recording(
    data: LoadedDrive, clock: ClockUncertainty | None, *, with_clock: bool
) -> tuple[Measured, ...]:
    """Check that a drive shows enough scenes, and that something ties its images to the moments of its sweeps.

    Args:
        data: The drive.
        clock: What the frames show of the clock; None if the rig stands or its motion is not stated.
        with_clock: Whether the clock is left as the drive states it.
    """
    observations, measured = data.checked_by, list[Measured]()
    if cues := data.policy.wanting_scenes:
        measured.append(check_scenes(len(set(observations.scenes)), cues))
    # A single frame that is too little in any case needs no further reason.
    is_too_little = observations.num_frames == 1 and findings_among(measured)
    if with_clock and not is_too_little:
        measured.append(check_clocks(data, clock))
    return tuple(measured)


def check_labels(data: LoadedDrive, T_camera_lidar: Pose) -> tuple[tuple[Measured, ...], tuple[str, ...]]:
    """Check that no labels come from the other side, and that label images lie on their images.

    Args:
        data: The drive.
        T_camera_lidar: (4, 4) pose, metres.

    Returns:
        What was measured, and notes on what was not checked.
    """
    measured, notes, frames = list[Measured](), list[str](), data.drive.frames
    has_labels = any(frame.image_labels is not None for frame in frames)
    if has_labels and all(frame.image is None for frame in frames):
        notes.append("labels were not checked against images: the drive has no images")
    for name, cue in data.policy.cues.items():
        if cue.has_point_labels:
            measured += check_leaks(data.of_cue(name), T_camera_lidar)
    if data.policy.cues[data.cues[0]].has_image_labels:
        aligned = check_label_alignment(data.drive, data.of_cue(data.cues[0]))
        measured += aligned.measured
        notes += aligned.notes
    return tuple(measured), tuple(notes)


def check_stages(
    refined: Refinement | None,
    polished: Polish | None,
    fused: Fused | None,
    joint: JointEstimate | None = None,
) -> tuple[Finding, ...]:
    """Check that the stages that lead to a pose settled, that held-out data accept it, and that priors agree.

    Args:
        refined: The refinement; None if it was not run.
        polished: The polish; None if it was not run.
        fused: The fusion with priors; None without priors.
        joint: The joint estimate with intrinsics or the clock; None if none was asked for.
    """
    if joint is not None and joint.is_kept:
        return () if joint.camera is None else check_aspect(joint.camera)
    findings = list[Finding]()
    # If labels alone determine no pose, their polish is not expected to settle.
    if polished is not None and (fused is None or fused.is_alone):
        findings += [*check_held_out(polished), *check_directions(polished), *check_polish(polished)]
    # A pose that is polished or fused need not have settled before.
    is_last = fused is None and (polished is None or not polished.is_accepted)
    if refined is not None and is_last:
        findings += check_refinement(refined)
    if fused is not None:
        findings += [*check_fusion(fused), *check_priors(fused)]
    return tuple(findings)


def check_pose(T_camera_lidar: Pose, agreement: core.Agreement, max_baseline_m: float) -> tuple[Finding, ...]:
    """Check that a pose is not at a limit, shows enough points, and explains more than chance.

    Args:
        T_camera_lidar: (4, 4), metres.
        agreement: Agreement of the labels at this pose.
        max_baseline_m: Limit of the distance between camera and LiDAR that the refinement respected.
    """
    return (
        *check_baseline(T_camera_lidar, max_baseline_m),
        *check_overlap(agreement.overlap),
        *check_chance(agreement),
    )


def check_consistency(
    observations: Observations,
    T_camera_lidar: Pose,
    *,
    estimated_s: float | None,
    T_start: Pose | None = None,
) -> tuple[Measured, ...]:
    """Check a pose against its labels, its surroundings, the camera's focal length and the clocks.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) refined pose, metres.
        estimated_s: Estimate of the time offset, seconds; None if the motions of the frames do not determine it.
        T_start: (4, 4) pose from which it was refined, metres; None if there is none.
    """
    few = few_frames(observations, NUM_FRAMES)
    measured = [
        *check_classes(few, T_camera_lidar),
        *check_pairing(few, T_camera_lidar),
        *check_shifted_pairing(observations, T_camera_lidar),
        check_azimuth(few, T_camera_lidar),
        *check_other_models(few, T_camera_lidar, estimated_s),
    ]
    is_lost = any(finding.topic in OF_A_LOST_POSE for finding in findings_among(measured))
    if is_lost and T_start is not None:
        measured += check_mirrored_edges(observations, T_camera_lidar, T_start)
    return tuple(measured)


def check_uncertainty(
    uncertainty: Uncertainty | None, *, with_priors: bool = False, advice: str | None = None
) -> tuple[Finding, ...]:
    """Check that a pose is determined, and that its interval is narrow enough.

    Args:
        uncertainty: Uncertainty of the pose; None if the data do not determine it.
        with_priors: Whether the pose is fused with priors.
        advice: What to do about a wide interval, if it is not more frames.
    """
    if uncertainty is None:
        return (UNDETERMINED_WITH_PRIORS if with_priors else UNDETERMINED,)
    return check_interval(uncertainty, advice)
