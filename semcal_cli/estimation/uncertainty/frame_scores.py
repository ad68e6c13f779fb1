"""Scores of single frames: the contribution of each to the gradient of the mutual information at a pose.

At the pose that all frames fit best, their scores add up to zero; a frame whose camera was elsewhere pulls towards its
own optimum. A score is compared with the scatter of the squares of its image, as in the stated uncertainty, on blocks
of pixels: a block senses label borders up to about its own size away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import SensitivityConfig
from semcal_cli.estimation.uncertainty.quantiles import hotelling_quantile
from semcal_cli.estimation.uncertainty.sensitivity import squares_of, summed
from semcal_cli.geometry.arrays import Matrices, Pose, Vectors
from semcal_cli.observations.observations import Observations

MAX_POINTS = 60_000
"""Number of points in the images that is enough, over all frames."""
MIN_SQUARES = 24
"""Smallest number of squares beyond one in each frame: fewer cannot estimate a covariance of six axes."""
MIN_RANK = 1e-9
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
            frame_squares = squares[frames == frame]
            centred = frame_squares - frame_squares.mean(axis=0)
            scores[frame] = frame_squares.sum(axis=0)
            covariances[frame] = centred.T @ centred * len(frame_squares) / (len(frame_squares) - 1)
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
        sums, covariances = np.cumsum(self.scores, axis=0), np.cumsum(self.covariances, axis=0)
        before = covariances[:-1]
        # The scores of all frames add up to zero, so the sum of the first is that of a bridge.
        return _squared(sums[:-1], before - before @ np.linalg.solve(covariances[-1], before))


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
    config = SensitivityConfig(factor=factor, max_points=MAX_POINTS)
    around = core.sensitivity(observations.without_edge_band.core, T_camera_lidar, config)
    if around is None or np.linalg.eigvalsh(around.curvature)[0] <= 0.0:
        return None
    squares, places = squares_of(around)
    num_squares, num_frames = len(squares), observations.num_frames
    if num_squares - num_frames < MIN_SQUARES:
        return None
    frames = FrameScores.of_squares(summed(around.scores, places, num_squares), squares[:, 0], num_frames)
    if not _has_full_rank(frames.covariances.mean(axis=0)):
        return None
    step = np.linalg.solve(around.curvature, frames.scores.sum(axis=0))
    if step @ around.motions @ step > (MAX_STEP_BLOCKS * factor) ** 2:
        return None
    explained = around.frame_curvatures @ step
    return replace(frames, scores=frames.scores - explained)


def _has_full_rank(covariance: Vectors) -> bool:
    """Whether a covariance (6, 6) has scatter in every direction, apart from rounding."""
    sigmas = np.sqrt(np.diag(covariance))
    if not sigmas.all():
        return False
    return bool(np.linalg.eigvalsh(covariance / np.outer(sigmas, sigmas))[0] > MIN_RANK)


def _squared(vectors: Vectors, covariances: Matrices) -> Vectors:
    solutions = np.linalg.solve(covariances, vectors[..., None])[..., 0]
    return np.asarray(np.einsum("fi,fi->f", vectors, solutions))
