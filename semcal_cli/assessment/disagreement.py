"""Frames that disagree about the camera: one that was moved in mid-drive, or frames that each fit their own pose.

Scores of the frames tell whether there is one pose at all. Where they do not, a change point is looked for along the
drive (binary segmentation: Scott and Knott, *A cluster analysis method for grouping means in the analysis of variance*,
1974): both parts are refined and polished on their own, and have to lie farther apart than their intervals explain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.frame_names import frame_list, frame_name
from semcal_cli.assessment.frame_scores import score_frames
from semcal_cli.assessment.information import compared_by
from semcal_cli.assessment.limits import hotelling_quantile
from semcal_cli.assessment.pairing import information_by_frame, pointwise_information
from semcal_cli.assessment.sensitivity import determined_sensitivity
from semcal_cli.config import ExactConfig, PolishConfig, PyramidConfig, SensitivityConfig
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import camera_motions, local_coordinates
from semcal_cli.refinement.exact import refine_exactly
from semcal_cli.refinement.polish import newton
from semcal_cli.result.checks.check import Measured, findings_among
from semcal_cli.result.checks.table import FRAMES_DISAGREE, MOVED_CAMERA
from semcal_cli.result.sections import DrivePart, Movement
from semcal_cli.result.stage import Finding
from semcal_cli.result.uncertainty import Uncertainty

FINE_DEG, FINE_PX = 0.3, (2, 4)
"""Fine blocks on which frames are compared, which feel small offsets: their angle, within these sides in pixels."""
COARSE_DEG = 1.0
"""Coarse blocks, which feel offsets of several degrees."""
MAX_PARTS = 4
"""Largest number of parts of a drive."""
FAR_PYRAMID = PyramidConfig(coarsest_block_deg=4.0)
"""Pyramid of the refinement of a part, which may lie several degrees off."""


@dataclass(frozen=True)
class Part:
    """Consecutive frames, with the pose that they fit."""

    frames: range
    T_camera_lidar: Pose
    """(4, 4), metres."""
    uncertainty: Uncertainty
    """Uncertainty of the pose."""


@dataclass(frozen=True)
class FrameCheck:
    """Result of comparing the frames: what was measured, and the parts of the drive if the camera was moved."""

    measured: tuple[Measured, ...] = ()
    parts: tuple[DrivePart, ...] = ()
    """At least two parts; empty if no movement was found."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What speaks against one pose of all frames."""
        return findings_among(self.measured)


def check_frames(observations: Observations, T_camera_lidar: Pose, names: Sequence[str]) -> FrameCheck:
    """Check that all frames fit one pose.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        names: Name of each frame: its point cloud.
    """
    whole = range(observations.num_frames)
    if len(whole) < 2:
        return FrameCheck()
    suspicion = _compare(observations, T_camera_lidar)
    if suspicion is None:
        return FrameCheck()
    scatter = _measured_scatter(suspicion, observations)
    if not suspicion.is_grave:
        return FrameCheck((scatter,))
    parts = _split(observations, whole, T_camera_lidar, suspicion, MAX_PARTS) if suspicion.place else []
    if len(parts) > 1 and all(_is_one(observations, part) for part in parts):
        described = tuple(_describe(parts, names))
        moved = MOVED_CAMERA.without_value(_moved_sentence(parts, described, names))
        return FrameCheck((scatter, moved), described)
    return FrameCheck((scatter, FRAMES_DISAGREE.without_value(_scatter_sentence(suspicion, names))))


@dataclass(frozen=True)
class _Suspicion:
    """What the scores of frames say against one pose."""

    place: int | None
    """Number of frames before the likeliest change; None if no change explains the scores better than chance."""
    apart: float
    """Distance of the scores before and after the likeliest change, in standard errors."""
    allowed_apart: float
    """Largest allowed `apart`."""
    scatter: float
    """Cochran's Q over its degrees of freedom."""
    allowed: float
    """Largest allowed `scatter`."""
    outliers: tuple[int, ...]
    """Frames whose own score is farther from zero than chance explains."""

    @property
    def is_grave(self) -> bool:
        """Whether anything speaks against one pose."""
        return self.place is not None or bool(self.outliers) or not self.scatter <= self.allowed


def _measured_scatter(suspicion: _Suspicion, observations: Observations) -> Measured:
    """Hand out the scatter as a multiple of what chance exceeds; whether it is a finding, parts decide as well."""
    by = compared_by(observations)
    share = suspicion.scatter / suspicion.allowed
    return FRAMES_DISAGREE.measured(share * FRAMES_DISAGREE.limit(by), limit=by)


def _suspect(observations: Observations, T_camera_lidar: Pose) -> _Suspicion | None:
    """Test whether the frames fit one pose; None if nothing speaks against it."""
    found = _compare(observations, T_camera_lidar)
    return found if found is not None and found.is_grave else None


def _compare(observations: Observations, T_camera_lidar: Pose) -> _Suspicion | None:
    """Compare the frames with one pose; None if their scores tell nothing."""
    blocks_px = _blocks_px(observations.camera)
    found = [score_frames(observations, T_camera_lidar, block_px) for block_px in blocks_px]
    scored = [scores for scores in found if scores is not None]
    if not scored:
        return None
    count = observations.num_frames
    num_squares = min(scores.num_squares for scores in scored)
    alpha = FRAMES_DISAGREE.limit("chance") / (len(blocks_px) * count)
    # Two frames, one at either side of a change, have this many squares.
    limit = hotelling_quantile(alpha, 2.0 * num_squares / count)
    splits = max((scores.splits() for scores in scored), key=np.max)
    place = int(np.argmax(splits)) + 1 if splits.max() > limit else None
    outliers = tuple(np.flatnonzero(np.any([each.outliers(alpha) for each in scored], axis=0)).tolist())
    scatter = max(scores.heterogeneity for scores in scored) / (6.0 * (count - 1))
    allowed = FRAMES_DISAGREE.limit(compared_by(observations)) * _scatter_by_chance(count, num_squares)
    return _Suspicion(place, math.sqrt(max(splits.max(), 0.0)), math.sqrt(limit), scatter, allowed, outliers)


def _blocks_px(camera: Camera) -> tuple[int, int]:
    """Sides of the blocks on which frames are compared, in pixels."""
    px_per_deg = math.radians(core_camera(camera).pixels_per_radian)
    fine = int(np.clip(round(FINE_DEG * px_per_deg), *FINE_PX))
    return fine, max(round(COARSE_DEG * px_per_deg), fine + 1)


def _scatter_by_chance(num_frames: int, num_squares: int) -> float:
    """Compute the Q over its degrees of freedom that chance exceeds with the probability of the table."""
    return _core.fisher_limit(FRAMES_DISAGREE.limit("chance"), 6 * (num_frames - 1), num_squares - num_frames)


def _is_one(observations: Observations, part: Part) -> bool:
    if len(part.frames) == 1:
        return True
    found = _suspect(observations.of_frames(part.frames), part.T_camera_lidar)
    return found is None or found.scatter <= found.allowed


def _split(
    observations: Observations, frames: range, T_start: Pose, suspicion: _Suspicion, num_parts: int
) -> list[Part]:
    """Split frames where they fit two poses, and each part again; no parts where they do not."""
    found: list[Part] = []
    parts = _two_parts(observations, frames, T_start, suspicion.place or 0)
    for later, part in zip((1, 0), parts, strict=False):
        # One part is kept for each of those that follow.
        left, again = num_parts - later - len(found), None
        if len(part.frames) > 1 and left > 1:
            again = _suspect(observations.of_frames(part.frames), part.T_camera_lidar)
        smaller = []
        if again is not None and again.place is not None:
            smaller = _split(observations, part.frames, part.T_camera_lidar, again, left)
        found += smaller or [part]
    return found


def _two_parts(observations: Observations, frames: range, T_start: Pose, place: int) -> tuple[Part, ...]:
    """Fit both sides of a change; no parts if their poses are no farther apart than chance explains."""
    pair = _fit_both(observations, frames, place, (T_start, T_start))
    if pair is None:
        return ()
    poses = pair[0].T_camera_lidar, pair[1].T_camera_lidar
    again = _best_place(observations.of_frames(frames), *poses)
    if again != place:
        pair = _fit_both(observations, frames, again, poses)
    return pair if pair is not None and _is_apart(*pair) else ()


def _fit_both(
    observations: Observations, frames: range, place: int, starts: tuple[Pose, Pose]
) -> tuple[Part, Part] | None:
    before = fit_part(observations, frames[:place], starts[0])
    after = fit_part(observations, frames[place:], starts[1])
    return None if before is None or after is None else (before, after)


def fit_part(
    observations: Observations,
    frames: range,
    T_start: Pose,
    pyramid: PyramidConfig = FAR_PYRAMID,
) -> Part | None:
    """Refine and polish the pose of some frames; None if they do not determine one."""
    few = observations.of_frames(frames)
    refined = refine_exactly(few, T_start, ExactConfig(), pyramid)
    if refined is None:
        return None
    T = newton(few, refined.T_camera_lidar, PolishConfig()).T_camera_lidar
    around = determined_sensitivity(few, T, SensitivityConfig())
    if around is None:
        return None
    # What the points of a class share moves the poses of all parts alike, and parts are only compared.
    noise = around.noise(around.influence)
    return Part(frames, T, Uncertainty.from_covariance(T, *noise))


def _best_place(observations: Observations, T_before: Pose, T_after: Pose) -> int:
    """Find after how many frames the pose of the second part explains the labels better than that of the first."""
    before, after = (_core.agreement(observations.core, T).frame_joints for T in (T_before, T_after))
    table = pointwise_information((before + after).sum(axis=0))
    gains = information_by_frame(before, table) - information_by_frame(after, table)
    # The sum of the gains before the place, less the sum after it, is largest at the change.
    return int(np.argmax(np.cumsum(gains)[:-1])) + 1


def _is_apart(before: Part, after: Part) -> bool:
    offset, covariance, dof = _offset(before, after)
    return float(offset @ np.linalg.solve(covariance, offset)) > hotelling_quantile(
        MOVED_CAMERA.limit("chance"), dof
    )


def _offset(before: Part, after: Part) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], float]:
    """Local coordinates (6,) of a part about the one before, their covariance (6, 6), and degrees of freedom."""
    (offset,) = local_coordinates([after.T_camera_lidar], before.T_camera_lidar)
    covariance = np.array(before.uncertainty.covariance) + np.array(after.uncertainty.covariance)
    dof = np.add(before.uncertainty.degrees_of_freedom, after.uncertainty.degrees_of_freedom)
    return offset, covariance, float(dof.mean())


def _describe(parts: Sequence[Part], names: Sequence[str]) -> list[DrivePart]:
    described = []
    for before, part in zip((None, *parts), parts, strict=False):
        described.append(
            DrivePart(
                first_frame=names[part.frames[0]],
                last_frame=names[part.frames[-1]],
                num_frames=len(part.frames),
                T_camera_lidar=part.T_camera_lidar.tolist(),
                moved=None if before is None else _movement(before, part),
            )
        )
    return described


def _movement(before: Part, after: Part) -> Movement:
    offset, covariance, dof = _offset(before, after)
    half_widths = math.sqrt(hotelling_quantile(0.05, dof)) * np.sqrt(np.diag(covariance))
    (motion,) = camera_motions(offset[None])
    return Movement(
        camera_center_m=motion[:3].tolist(),
        rotation_deg=motion[3:].tolist(),
        half_width_95_camera_center_m=half_widths[:3].tolist(),
        half_width_95_rotation_deg=np.degrees(half_widths[3:]).tolist(),
    )


def _moved_sentence(parts: Sequence[Part], described: Sequence[DrivePart], names: Sequence[str]) -> str:
    """Say which frames fit which camera, and where it may have been knocked."""
    sentences = []
    moved = [part.moved.words for part in described if part.moved is not None]
    for part, words in zip(parts[1:], moved, strict=True):
        first = frame_name(names, part.frames[0])
        stretch = _stretch(part.frames, names)
        sentences.append(f"{stretch} fit a camera {words}, as if it was knocked at {first}")
    return "; ".join(sentences)


def _stretch(frames: range, names: Sequence[str]) -> str:
    first, last = frame_name(names, frames[0]), frame_name(names, frames[-1])
    return f"frame {first} alone would" if len(frames) == 1 else f"frames {first} to {last}"


def _scatter_sentence(suspicion: _Suspicion, names: Sequence[str]) -> str:
    """Say how far frames disagree that fit no few poses."""
    found = []
    if suspicion.scatter > suspicion.allowed:
        ratio, allowed = math.sqrt(suspicion.scatter), math.sqrt(suspicion.allowed)
        found.append(
            f"they scatter {ratio:.2f} times as widely as their labels explain, needed at most {allowed:.2f}"
        )
    if suspicion.place is not None:
        found.append(
            f"those from {frame_name(names, suspicion.place)} on are {suspicion.apart:.1f} standard errors from those "
            f"before, needed at most {suspicion.allowed_apart:.1f}"
        )
    if suspicion.outliers:
        found.append(f"farthest off {frame_list(names, suspicion.outliers)}")
    return f"frames disagree about the camera, {', '.join(found)}"
