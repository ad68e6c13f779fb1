"""What segments tell of the pictures at a pose, the adjusted mutual information (AMI): of all frames, and of each.

It is 0 where they tell no more than null partitions do, and 1 where they tell every label: see
`rust/alignment/adjusted.rs`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.config import EDGE_BAND_PX
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose


@dataclass(frozen=True, eq=False)
class SegmentInformation:
    """Information of segments and pixels at a pose."""

    frames: npt.NDArray[np.intp]
    """(parts,) frame of each square of the pictures."""
    sums: npt.NDArray[np.float64]
    """(parts,) sum over the visible points of each square."""
    weights: npt.NDArray[np.float64]
    """(parts,) weight of these points."""
    num_frames: int

    @property
    def mean(self) -> float:
        """Mean over all points: the AMI."""
        return float(self.sums.sum() / max(self.weights.sum(), 1.0))

    @property
    def sigma(self) -> float:
        """Standard error of the mean: squares are independent. Infinite with fewer than two."""
        count = len(self.sums)
        if count < 2:
            return float("inf")
        influence = (self.sums - self.mean * self.weights) / max(self.weights.sum(), 1.0)
        return float(np.sqrt((influence**2).sum() * count / (count - 1)))

    @property
    def weight_by_frame(self) -> npt.NDArray[np.float64]:
        """(F,) weight of the points of each frame."""
        return np.asarray(np.bincount(self.frames, self.weights, self.num_frames), np.float64)

    @property
    def by_frame(self) -> npt.NDArray[np.float64]:
        """(F,) mean over the points of each frame."""
        sums = np.bincount(self.frames, self.sums, self.num_frames)
        return np.asarray(sums / np.maximum(self.weight_by_frame, 1.0))

    @property
    def sigma_by_frame(self) -> npt.NDArray[np.float64]:
        """(F,) standard error of each frame's mean: squares are independent. Infinite with fewer than two."""
        weights, counts = (
            np.maximum(self.weight_by_frame, 1.0),
            np.bincount(self.frames, minlength=self.num_frames),
        )
        influence = (self.sums - self.by_frame[self.frames] * self.weights) / weights[self.frames]
        squares = np.bincount(self.frames, influence**2, self.num_frames)
        return np.where(counts > 1, np.sqrt(squares * counts / np.maximum(counts - 1, 1)), np.inf)


def segment_information(observations: Observations, T_camera_lidar: Pose) -> SegmentInformation:
    """Measure what segments tell of the pictures at a pose (4, 4), in full resolution."""
    parts = _core.segment_information(observations.core, T_camera_lidar, EDGE_BAND_PX)
    squares, sums, weights = zip(*parts, strict=True) if parts else ((), (), ())
    return SegmentInformation(
        observations.frame_indices[[observed for observed, _, _ in squares]],
        np.array(sums, np.float64),
        np.array(weights, np.float64),
        observations.num_frames,
    )
