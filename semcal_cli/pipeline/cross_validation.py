"""Cross-validation: the pose by each part of a drive alone, with what chance alone would make it differ from others.

Intervals are computed from the scatter of scores over squares of the images. Parts of a drive that share no scene
measure that scatter: their poses should differ by it and by no more, as mrcal's tour cross-validates calibrations of
cameras (https://mrcal.secretsauce.net). What all parts share, such as errors of K or shifted borders of a class, does
not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from semcal_cli.config import PolishConfig, SensitivityConfig
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.uncertainty.sensitivity import determined_sensitivity
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.observations import Observations


class Fold(NamedTuple):
    """A part of the scenes of a drive, and the pose by these alone."""

    T_camera_lidar: Pose
    """(4, 4) pose, metres."""
    sigmas: Matrix | None
    """(6,) standard errors of the camera's centre, metres, and of the rotation, degrees, along and about the camera's
    axes, without errors that all folds share; None if its frames do not determine the pose."""
    degrees_of_freedom: Matrix | None
    """(6,) degrees of freedom of these standard errors; None likewise."""

    def offsets_from(self, T_camera_lidar: Pose) -> Matrix:
        """Offsets (6,) from another pose (4, 4), metres and degrees, along and about the camera's axes."""
        return np.array(compare_poses(self.T_camera_lidar, T_camera_lidar).offsets)


def split_scenes(scenes: Sequence[int], num_folds: int) -> list[tuple[int, ...]]:
    """Deal scenes into folds of about as many frames, larger scenes first.

    Args:
        scenes: Number of the scene of each frame.
        num_folds: Number of folds, at most that of scenes.

    Returns:
        Frames of each fold, ascending. Frames of one scene are in one fold.
    """
    numbers, counts = np.unique(np.asarray(scenes), return_counts=True)
    folds: list[list[int]] = [[] for _ in range(num_folds)]
    for scene in numbers[np.argsort(-counts, kind="stable")]:
        min(folds, key=len).extend(np.flatnonzero(np.asarray(scenes) == scene).tolist())
    return [tuple(sorted(frames)) for frames in folds]


def estimate_folds(
    observations: Observations, T_camera_lidar: Pose, config: PolishConfig, folds: Sequence[Sequence[int]]
) -> list[Fold]:
    """Polish a pose by each of some parts of the frames alone.

    Args:
        observations: Labelled points and label images of all frames.
        T_camera_lidar: (4, 4) polished pose, metres.
        config: Settings of the polish.
        folds: Frames of each fold.
    """

    def fold(frames: Sequence[int]) -> Fold:
        some = observations.of_frames(frames)
        T = newton(some, T_camera_lidar, config).T_camera_lidar
        around = determined_sensitivity(some, T, SensitivityConfig())
        if around is None:
            return Fold(T, None, None)
        covariance, degrees_of_freedom = around.noise(around.influence)
        sigmas = np.sqrt(np.diag(covariance))
        return Fold(T, np.concatenate([sigmas[:3], np.degrees(sigmas[3:])]), degrees_of_freedom)

    return [fold(frames) for frames in folds]
