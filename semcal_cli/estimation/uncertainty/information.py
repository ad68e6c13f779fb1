"""Information of points about the pixels they land on, by squares of the images: over all frames, and for each.

For classes it is the mutual information, nats. For segments it is the adjusted mutual information (AMI): 0 where they
carry no more information than null partitions, and 1 where they determine every label; see
`rust/alignment/adjusted.rs`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.observations.observations import Observations


def compared_by(observations: Observations) -> str:
    """Name what points are compared by, as in the names of limits: `segments` or `labels`."""
    return "segments" if observations.has_partitions else "labels"


@dataclass(frozen=True, eq=False)
class InformationBySquares:
    """Information of points and pixels at a pose."""

    squares: npt.NDArray[np.intp]
    """(parts, 3) frame, row and column of each square of the images."""
    sums: Numbers
    """(parts,) sum over the visible points of each square."""
    weights: Numbers
    """(parts,) weight of these points."""
    scenes: npt.NDArray[np.intp]
    """(F,) number of the scene that each frame shows."""

    @property
    def num_frames(self) -> int:
        """Number of frames."""
        return len(self.scenes)

    @property
    def by_scene(self) -> npt.NDArray[np.intp]:
        """(parts, 3) `squares` with the scene in place of the frame."""
        return np.column_stack([self.scenes[self.frames], self.squares[:, 1:]])

    @property
    def frames(self) -> npt.NDArray[np.intp]:
        """(parts,) frame of each square."""
        return self.squares[:, 0]

    @property
    def mean(self) -> float:
        """Mean over all points, nats or AMI."""
        return float(self.sums.sum() / max(self.weights.sum(), 1.0))

    @property
    def influence(self) -> Numbers:
        """(parts,) pull of each square on the mean."""
        return np.asarray((self.sums - self.mean * self.weights) / max(self.weights.sum(), 1.0))

    @property
    def weight_by_frame(self) -> Numbers:
        """(F,) weight of the points of each frame."""
        return np.asarray(np.bincount(self.frames, self.weights, self.num_frames), np.float64)

    @property
    def by_frame(self) -> Numbers:
        """(F,) mean over the points of each frame."""
        sums = np.bincount(self.frames, self.sums, self.num_frames)
        return np.asarray(sums / np.maximum(self.weight_by_frame, 1.0))

    @property
    def sigma_by_frame(self) -> Numbers:
        """(F,) standard error of each frame's mean over independent squares; infinite with fewer than two."""
        weights = np.maximum(self.weight_by_frame, 1.0)
        counts = np.bincount(self.frames, minlength=self.num_frames)
        influence = (self.sums - self.by_frame[self.frames] * self.weights) / weights[self.frames]
        squares = np.bincount(self.frames, influence**2, self.num_frames)
        return np.where(counts > 1, np.sqrt(squares * counts / np.maximum(counts - 1, 1)), np.inf)


def information_by_squares(observations: Observations, T_camera_lidar: Pose) -> InformationBySquares:
    """Measure the information of points about pixels at a pose (4, 4), in full resolution."""
    parts = core.information(observations.core, T_camera_lidar)
    squares, sums, weights = zip(*parts, strict=True) if parts else ((), (), ())
    places = np.array(squares, np.intp).reshape(-1, 3)
    places[:, 0] = observations.frame_indices[places[:, 0]]
    return InformationBySquares(
        places,
        np.array(sums, np.float64),
        np.array(weights, np.float64),
        np.array(observations.scenes, np.intp),
    )


def paired_gain(before: InformationBySquares, after: InformationBySquares) -> core.InformationGain:
    """Compute the gain of the mean from one model to another of the same frames.

    Squares are paired, and those of one scene are summed first: more frames of it are no further evidence.
    """
    _, places = np.unique(np.vstack([before.by_scene, after.by_scene]), axis=0, return_inverse=True)
    influences = np.bincount(places.ravel(), np.concatenate([-before.influence, after.influence]))
    return core.InformationGain.of_parts(
        (influences + (after.mean - before.mean) / max(len(influences), 1)).tolist()
    )


def sigmas_behind(observations: Observations, T_camera_lidar: Pose, rivals: Sequence[Pose]) -> list[float]:
    """Compute the standard errors by which rivals (4, 4) are behind a pose (4, 4); 0 if too few squares are seen."""
    gains = core.information_gains(observations.core, T_camera_lidar, rivals)
    return [-gain.significance if math.isfinite(gain.sigma) else 0.0 for gain in gains]


def information_by_frame(joints: Numbers, table: Numbers) -> Numbers:
    """Compute the mean pointwise information (F,) of the pairs of each frame from a common table, nats.

    Args:
        joints: (F, X, Y) weights of the pairs of each frame.
        table: (X, Y) pointwise mutual information.
    """
    weights = np.maximum(joints.sum(axis=(1, 2)), 1.0)
    return np.asarray((joints * table).sum(axis=(1, 2)) / weights)


def pointwise_information(joint: Numbers) -> Numbers:
    """Compute the pointwise mutual information of a histogram (X, Y), nats; zero for pairs that were never seen."""
    expected = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0) / max(joint.sum(), 1.0)
    is_observed = joint > 0.0
    ratio = np.divide(joint, expected, out=np.ones_like(joint), where=is_observed)
    return np.asarray(np.log(ratio))


def entropy(counts: npt.NDArray[Any]) -> float:
    """Compute the entropy of classes, nats, from how often they come up."""
    shares = counts[counts > 0] / max(counts.sum(), 1)
    return float(-(shares * np.log(shares)).sum())
