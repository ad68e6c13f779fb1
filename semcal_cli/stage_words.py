"""What each stage of a calibration did, in words: a note for anybody, and details for an expert."""

from __future__ import annotations

import math
from collections.abc import Sequence

from semcal_cli.assessment.fusion import Fused
from semcal_cli.assessment.joint import Joint
from semcal_cli.assessment.priors import Prior
from semcal_cli.events import StageDone
from semcal_cli.geometry.pose_error import PoseError, compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.search import MIN_RUNNER_UP_MARGIN, Initialization
from semcal_cli.refinement.polish import Polish
from semcal_cli.refinement.pyramid import Refinement
from semcal_cli.result.stage import Finding, StageResult


def movement(moved: PoseError) -> str:
    """Say how far a stage moved the pose."""
    return f"moved {moved.rotation_deg:.3f} degrees and {moved.camera_center_cm:.2f} cm"


def initial(found: Initialization, seconds: float, *, is_searched: bool) -> StageDone:
    """Tell how many mountings were compared, and whether the best one is clear."""
    count, margin = len(found.hypotheses), found.runner_up_margin
    if not is_searched:
        note = "started at the given transform"
    elif margin is None:
        note = "mounting found, no other one to compare with"
    elif margin >= MIN_RUNNER_UP_MARGIN:
        note = f"{count} mountings compared, the best one is clear"
    else:
        note = f"{count} mountings compared, another one fits almost as well"
    details = "" if margin is None else f"runner-up {margin:.1f} standard errors behind"
    return StageDone("initial", seconds, note, found.agreement, details=details)


def started(found: StageResult, seconds: float, name: str) -> StageDone:
    """Tell that a given transform is the start."""
    return StageDone(
        "initial", seconds, "started at the given transform", found.agreement, details=f"from {name}"
    )


def refined(found: Refinement, seconds: float, T_before: Pose, estimator: str) -> StageDone:
    """Tell how far the refinement moved the pose, and whether it had ended."""
    note = "" if found.converged else "still moving at the end"
    details = f"{estimator}, {len(found.levels)} levels, {'settled' if found.converged else 'not settled'}"
    moved = compare_poses(found.T_camera_lidar, T_before)
    return StageDone("refined", seconds, note, found.agreement, moved, details)


def polished(found: Polish, seconds: float, T_before: Pose, unit: str) -> StageDone:
    """Tell whether the polish is kept, which data decide that it did not use; gains are in `unit`."""
    if not found.is_accepted:
        note = "not better, so the pose before it is kept"
    else:
        note = "kept" if found.is_settled else "kept, still moving at the end"
    gain, sigma = found.held_out.held_out_gain_nats, found.held_out.held_out_sigma_nats
    details = f"held out {gain:+.4f} +- {math.inf if sigma is None else sigma:.4f} {unit}"
    moved = compare_poses(found.T_camera_lidar, T_before) if found.is_accepted else None
    return StageDone("polished", seconds, note, found.agreement, moved, details)


def estimated_jointly(found: Joint, seconds: float, T_before: Pose) -> StageDone:
    """Tell whether intrinsics and the offset of the clock are kept, and by how much they differ."""
    told = []
    if found.camera is not None:
        told = [
            f"{name} {each.found - each.given:+.4g}"
            for name, each in found.camera.intrinsics.items()
            if each.is_determined
        ]
    if found.clock is not None and found.clock.is_determined:
        told.append(f"clock {1e3 * found.clock.time_offset_s:+.1f} ms")
    note = f"{', '.join(told) or 'nothing determined'}, {'kept' if found.is_kept else 'not kept'}"
    moved = compare_poses(found.T_camera_lidar, T_before) if found.is_kept else None
    return StageDone("joint", seconds, note, found.agreement, moved)


def fused(found: Fused, seconds: float, T_before: Pose, priors: Sequence[Prior]) -> StageDone:
    """Tell how far what is known moved the pose."""
    note = "with " + ", ".join(prior.name for prior in priors)
    return StageDone("fused", seconds, note, found.agreement, compare_poses(found.T_camera_lidar, T_before))


def assessed(findings: Sequence[Finding], seconds: float) -> StageDone:
    """Tell whether anything speaks against the pose."""
    count = len(findings)
    found = {0: "nothing speaks", 1: "1 doubt speaks"}.get(count, f"{count} doubts speak")
    return StageDone("assessed", seconds, f"{found} against the pose that was found")


def repeated(num_seeds: int, findings: Sequence[Finding], seconds: float) -> StageDone:
    """Tell whether poses of other seeds speak against the pose."""
    count = len(findings)
    found = {0: "the pose is the same", 1: "1 more doubt"}.get(count, f"{count} more doubts")
    return StageDone("repeated", seconds, f"{num_seeds} seeds compared, {found}")
