"""Frames that disagree about the camera, because it was moved during the drive or because each fits its own pose.

At the pose that all frames fit best, their scores add up to zero; a frame whose camera was elsewhere pulls towards its
own optimum. A score is compared with the scatter of the squares of its image, as in the stated uncertainty, on blocks
of pixels: a block senses label borders up to about its own size away.

Where scores show that there is not one pose, a change point is searched for along the drive (binary segmentation: Scott
and Knott, *A cluster analysis method for grouping means in the analysis of variance*, 1974): both parts are refined and
polished on their own, and must be farther apart than their intervals explain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.checks.pairing import frame_list, frame_name
from semcal_cli.config import SensitivityConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.adjust.frame_offsets import Part, fit_part
from semcal_cli.estimation.uncertainty.information import (
    compared_by,
    information_by_frame,
    pointwise_information,
)
from semcal_cli.estimation.uncertainty.quantiles import hotelling_quantile
from semcal_cli.estimation.uncertainty.sensitivity import squares_of, summed
from semcal_cli.findings.check import FRAMES_DISAGREE, MOVED_CAMERA, Measured
from semcal_cli.geometry.arrays import Matrices, Pose, Vectors
from semcal_cli.geometry.twists import camera_motions, local_coordinates
from semcal_cli.observations.observations import Observations
from semcal_cli.result.sections import DrivePart, Movement

FINE_DEG, FINE_PX = 0.3, (2, 4)
"""Fine blocks for comparing frames, which sense small offsets: their angle, limited to these sides in pixels."""
COARSE_DEG = 1.0
"""Coarse blocks, which sense offsets of several degrees."""
MAX_PARTS = 4
"""Largest number of parts of a drive."""
MAX_POINTS = 300_000
"""Largest number of points that are used, over all frames."""
LEAST_SQUARES = 24
"""Least number of squares beyond one in each frame: fewer cannot estimate a covariance of six axes."""
LEAST_RANK = 1e-9
"""Smallest eigenvalue of a correlation matrix of full rank."""
MAX_STEP_BLOCKS = 1.0
"""Largest distance of the optimum of all frames, in blocks, at which the local curvature locates it. By intensity in a
real jam, where the curvature nearly vanishes along some axis, the distance was 7."""
SHRINKAGE = 0.5
"""Weight of the mean covariance of all frames in that of a frame, which few squares estimate only roughly."""


@dataclass(frozen=True)
class FrameScores:
    """Score of each frame at one pose, relative to the optimum of all frames on these blocks."""

    scores: Vectors
    """(F, 6) contribution of each frame to the gradient, less what the optimum of all frames explains, nats."""
    covariances: Matrices
    """(F, 6, 6) covariance of the contribution of each frame to the gradient."""
    counts: npt.NDArray[np.integer]
    """(F,) number of squares of each frame's image that have labelled points."""

    @classmethod
    def of_squares(cls, squares: Vectors, frames: npt.NDArray[np.integer], num_frames: int) -> FrameScores:
        """Sum the scores (N, 6) of squares of images over the frames (N,) that they belong to."""
        scores, counts = np.zeros((num_frames, 6)), np.bincount(frames, minlength=num_frames)
        covariances = np.zeros((num_frames, 6, 6))
        for frame in np.flatnonzero(counts > 1).tolist():
            of_frame = squares[frames == frame]
            centred = of_frame - of_frame.mean(axis=0)
            scores[frame] = of_frame.sum(axis=0)
            covariances[frame] = centred.T @ centred * len(of_frame) / (len(of_frame) - 1)
        typical = covariances.mean(axis=0) * (counts / counts.mean())[:, None, None]
        # A frame without points has neither a score nor a scatter, and must not divide by zero.
        typical[counts == 0] = covariances.mean(axis=0)
        return cls(scores, SHRINKAGE * typical + (1.0 - SHRINKAGE) * covariances, counts)

    @property
    def num_squares(self) -> int:
        """Number of squares of all images that have labelled points."""
        return int(self.counts.sum())

    @property
    def squares(self) -> Vectors:
        """Squared length (F,) of each score in its standard errors; by chance, about 6 (F - 1) / F."""
        return _squared(self.scores, self.covariances)

    @property
    def heterogeneity(self) -> float:
        """Cochran's Q, with 6 (F - 1) degrees of freedom (*The combination of estimates*, 1954)."""
        return float(self.squares.sum())

    def outliers(self, alpha: float) -> npt.NDArray[np.bool_]:
        """Find the frames (F,) whose score is farther from zero than chance explains with this probability."""
        # The scatter of few squares is hardly known; that of many is still shrunk to the mean of all frames.
        counts = np.clip(self.counts, 1.0, self.num_squares / len(self.scores)).tolist()
        return self.squares > [hotelling_quantile(alpha, 2.0 * count) for count in counts]

    def splits(self) -> Vectors:
        """Compute the squared length (F - 1,) of the sum of the first 1, 2, ... scores, in its standard errors."""
        sums, known = np.cumsum(self.scores, axis=0), np.cumsum(self.covariances, axis=0)
        before = known[:-1]
        # The scores of all frames add up to zero, so the sum of the first is that of a bridge.
        return _squared(sums[:-1], before - before @ np.linalg.solve(known[-1], before))


def score_frames(observations: Observations, T_camera_lidar: Pose, block_px: int) -> FrameScores | None:
    """Compute the scores of all frames.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        block_px: Side of a block of the label images, in pixels.

    Returns:
        The scores; None if labels do not determine a pose on these blocks, or determine one that is far away.
    """
    factor = min(block_px, observations.camera.width, observations.camera.height)
    config = SensitivityConfig(factor=factor, edge_band_px=0, max_points=MAX_POINTS)
    around = core.sensitivity(observations.core, T_camera_lidar, config)
    if around is None or np.linalg.eigvalsh(around.curvature)[0] <= 0.0:
        return None
    squares, places = squares_of(around)
    num_squares, num_frames = len(squares), observations.num_frames
    if num_squares - num_frames < LEAST_SQUARES:
        return None
    found = FrameScores.of_squares(summed(around.scores, places, num_squares), squares[:, 0], num_frames)
    if not _has_full_rank(found.covariances.mean(axis=0)):
        return None
    step = np.linalg.solve(around.curvature, found.scores.sum(axis=0))
    if step @ around.motions @ step > (MAX_STEP_BLOCKS * factor) ** 2:
        return None
    explained = around.frame_curvatures @ step
    return replace(found, scores=found.scores - explained)


def _has_full_rank(covariance: Vectors) -> bool:
    """Whether a covariance (6, 6) has scatter in every direction, apart from rounding."""
    sigmas = np.sqrt(np.diag(covariance))
    if not sigmas.all():
        return False
    return bool(np.linalg.eigvalsh(covariance / np.outer(sigmas, sigmas))[0] > LEAST_RANK)


def _squared(vectors: Vectors, covariances: Matrices) -> Vectors:
    solved = np.linalg.solve(covariances, vectors[..., None])[..., 0]
    return np.asarray(np.einsum("fi,fi->f", vectors, solved))


class FrameCheck(NamedTuple):
    """Result of comparing the frames: what was measured, and the parts of the drive if the camera was moved."""

    measured: tuple[Measured, ...] = ()
    parts: tuple[DrivePart, ...] = ()
    """At least two parts; empty if no movement was found."""


def check_frames(observations: Observations, T_camera_lidar: Pose, names: Sequence[str]) -> FrameCheck:
    """Check that all frames fit one pose.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        names: Name of each frame: its point cloud.
    """
    suspicion = _compare(observations, T_camera_lidar)
    if suspicion is None:
        return FrameCheck()
    # The scatter is given as a multiple of its limit by chance; whether it is a finding also depends on the parts.
    by, share = compared_by(observations), suspicion.scatter / suspicion.allowed
    scatter = FRAMES_DISAGREE.measured(share * FRAMES_DISAGREE.limit(by), limit=by)
    if not suspicion.is_grave:
        return FrameCheck((scatter,))
    parts, whole = list[Part](), range(observations.num_frames)
    if suspicion.place is not None:
        parts = _split(observations, whole, T_camera_lidar, suspicion.place, MAX_PARTS)
    if len(parts) > 1 and all(_is_one(observations, part) for part in parts):
        described = tuple(
            DrivePart(
                first_frame=names[part.frames[0]],
                last_frame=names[part.frames[-1]],
                num_frames=len(part.frames),
                T_camera_lidar=part.T_camera_lidar.tolist(),
                moved=None if before is None else _movement(before, part),
            )
            for before, part in zip((None, *parts), parts, strict=False)
        )
        moved = MOVED_CAMERA.without_value(_moved_sentence(parts, described, names))
        return FrameCheck((scatter, moved), described)
    return FrameCheck((scatter, FRAMES_DISAGREE.without_value(_scatter_sentence(suspicion, names))))


@dataclass(frozen=True)
class _Suspicion:
    """Evidence in the scores of frames against a single pose."""

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
        """Whether anything speaks against a single pose."""
        return self.place is not None or bool(self.outliers) or not self.scatter <= self.allowed


def _compare(observations: Observations, T_camera_lidar: Pose) -> _Suspicion | None:
    """Compare the frames with one pose; None if they have no scores."""
    count = observations.num_frames
    if count < 2:
        return None
    px_per_deg = math.radians(core_camera(observations.camera).pixels_per_radian)
    fine = int(np.clip(round(FINE_DEG * px_per_deg), *FINE_PX))
    blocks_px = fine, max(round(COARSE_DEG * px_per_deg), fine + 1)
    found = [score_frames(observations, T_camera_lidar, block_px) for block_px in blocks_px]
    scored = [scores for scores in found if scores is not None]
    if not scored:
        return None
    num_squares = min(scores.num_squares for scores in scored)
    chance = FRAMES_DISAGREE.limit("chance")
    alpha = chance / (len(blocks_px) * count)
    # Two frames, one on either side of a change, have this many squares.
    limit = hotelling_quantile(alpha, 2.0 * num_squares / count)
    splits = max((scores.splits() for scores in scored), key=np.max)
    outliers = tuple(np.flatnonzero(np.any([each.outliers(alpha) for each in scored], axis=0)).tolist())
    # Limit of Q over its degrees of freedom, which chance alone exceeds in this fraction of cases.
    by_chance = core.fisher_limit(chance, 6 * (count - 1), num_squares - count)
    return _Suspicion(
        place=int(np.argmax(splits)) + 1 if splits.max() > limit else None,
        apart=math.sqrt(max(splits.max(), 0.0)),
        allowed_apart=math.sqrt(limit),
        scatter=max(scores.heterogeneity for scores in scored) / (6.0 * (count - 1)),
        allowed=FRAMES_DISAGREE.limit(compared_by(observations)) * by_chance,
        outliers=outliers,
    )


def _is_one(observations: Observations, part: Part) -> bool:
    found = _compare(observations.of_frames(part.frames), part.T_camera_lidar)
    return found is None or not found.is_grave or found.scatter <= found.allowed


def _split(
    observations: Observations, frames: range, T_start: Pose, place: int, num_parts: int
) -> list[Part]:
    """Split frames where they fit two poses, and each part again; no parts where they do not."""
    found: list[Part] = []
    parts = _two_parts(observations, frames, T_start, place)
    for later, part in zip((1, 0), parts, strict=False):
        # One part is reserved for each of those that follow.
        left, again = num_parts - later - len(found), None
        if left > 1:
            again = _compare(observations.of_frames(part.frames), part.T_camera_lidar)
        smaller = []
        if again is not None and again.place is not None:
            smaller = _split(observations, part.frames, part.T_camera_lidar, again.place, left)
        found += smaller or [part]
    return found


def _two_parts(observations: Observations, frames: range, T_start: Pose, place: int) -> tuple[Part, ...]:
    """Fit both sides of a change; no parts if their poses are no farther apart than chance explains."""

    def fit_both(place: int, T_before: Pose, T_after: Pose) -> tuple[Part, Part] | None:
        before = fit_part(observations, frames[:place], T_before)
        after = fit_part(observations, frames[place:], T_after)
        return None if before is None or after is None else (before, after)

    pair = fit_both(place, T_start, T_start)
    if pair is None:
        return ()
    poses = pair[0].T_camera_lidar, pair[1].T_camera_lidar
    again = _best_place(observations.of_frames(frames), *poses)
    if again != place:
        pair = fit_both(again, *poses)
    if pair is None:
        return ()
    offset, covariance, dof = _offset(*pair)
    apart = float(offset @ np.linalg.solve(covariance, offset))
    return pair if apart > hotelling_quantile(MOVED_CAMERA.limit("chance"), dof) else ()


def _best_place(observations: Observations, T_before: Pose, T_after: Pose) -> int:
    """Find after how many frames the pose of the second part explains the labels better than that of the first."""
    before, after = (core.agreement(observations.core, T).frame_joints for T in (T_before, T_after))
    table = pointwise_information((before + after).sum(axis=0))
    gains = information_by_frame(before, table) - information_by_frame(after, table)
    # The sum of the gains before the place, less the sum after it, is largest at the change.
    return int(np.argmax(np.cumsum(gains)[:-1])) + 1


def _offset(before: Part, after: Part) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], float]:
    """Local coordinates (6,) of a part about the one before, their covariance (6, 6), and degrees of freedom."""
    (offset,) = local_coordinates([after.T_camera_lidar], before.T_camera_lidar)
    covariance = np.array(before.uncertainty.covariance) + np.array(after.uncertainty.covariance)
    dof = np.add(before.uncertainty.degrees_of_freedom, after.uncertainty.degrees_of_freedom)
    return offset, covariance, float(dof.mean())


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
    for part, each in zip(parts[1:], described[1:], strict=True):
        assert each.moved is not None
        first, last = frame_name(names, part.frames[0]), frame_name(names, part.frames[-1])
        stretch = f"frame {first} alone would" if len(part.frames) == 1 else f"frames {first} to {last}"
        sentences.append(f"{stretch} fit a camera {each.moved.words}, as if it had been knocked at {first}")
    return "; ".join(sentences)


def _scatter_sentence(suspicion: _Suspicion, names: Sequence[str]) -> str:
    """Say how far frames disagree that a few poses do not explain."""
    found = []
    if suspicion.scatter > suspicion.allowed:
        ratio, most = format_against_limit(math.sqrt(suspicion.scatter), math.sqrt(suspicion.allowed), 2)
        found.append(f"they scatter {ratio} times as widely as their labels explain, needed at most {most}")
    if suspicion.place is not None:
        apart, most = format_against_limit(suspicion.apart, suspicion.allowed_apart, 1)
        found.append(
            f"those from {frame_name(names, suspicion.place)} on are {apart} standard errors from those "
            f"before, needed at most {most}"
        )
    if suspicion.outliers:
        found.append(f"above all {frame_list(names, suspicion.outliers)}")
    return f"frames disagree about the camera, {', '.join(found)}"
