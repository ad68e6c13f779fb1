"""The labels as a measurement: how the mutual information depends on a pose, and where its optimum is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import SensitivityConfig
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.observations.observations import Observations

MAX_LEVERAGE = 0.75
"""Largest fraction of the curvature along a direction that counts as one class's, so that the pull of a class counts at
most four times. On 18 drives whose classes' borders are off in all frames alike, 88 to 91 % of the axes were inside
with three, four or ten times."""
MIN_CLASSES = 4.0
"""Least number of independent classes that the degrees of freedom of their scatter count, where there are so many.
With fewer, Student's t makes intervals wide that need not be: on drives whose classes' borders are off in all frames
alike, 93 and 92 % of the axes lie within the intervals with it (15 drives, 5 and 20 frames), 92 and 87 % with eight."""
MIN_BEND = 1e-6
"""Curvature floor per pixel, relative to the steepest direction. Less is rounding."""
BLOCKS_PX = (1, 2, 4)
"""Blocks of the images on which a pose may be determined, finest first."""
MIN_SPREAD = 1e-12
"""Smallest variance along a direction, relative to that of a measurement alone. Less is rounding."""
MANY = 1e6
"""Degrees of freedom of what is known exactly."""


class Scatter(NamedTuple):
    """Scatter of the sum of the influences of all parts on m variables, as the data show it."""

    squares: Matrix
    """(squares, m) influence of each square of the scenes, centred and weighted for the sum of their products."""
    of_squares: Matrix
    """(m, m) covariance from what differs from square to square."""
    classes: Matrix
    """(classes, m) influence of the points of each class on the optimum of the other classes."""
    of_classes: Matrix
    """(m, m) covariance from errors that the points of a class share in all squares."""

    @property
    def covariance(self) -> Matrix:
        """Covariance (m, m) of the sum."""
        return np.asarray(self.of_squares + self.of_classes)

    def along(self, directions: Matrix) -> Scatter:
        """Return the scatter of the products with directions (m, k)."""
        return Scatter(
            self.squares @ directions,
            directions.T @ self.of_squares @ directions,
            self.classes @ directions,
            directions.T @ self.of_classes @ directions,
        )

    @property
    def degrees_of_freedom(self) -> npt.NDArray[np.float64]:
        """Satterthwaite's degrees of freedom (m,) of the variances, as if squares and classes were independent.

        What classes share is a difference, which is as uncertain as the scatter of the classes that it is part of. They
        are at least those of the smaller of the two numbers of parts, as those of any sum of variances.
        """
        of_squares, of_classes = np.diag(self.of_squares), np.diag(self.of_classes)
        by_square = _effective_number(self.squares)
        max_freedom = max(float(np.count_nonzero(self.classes.any(axis=1))) - 1.0, 1.0)
        num_classes = _effective_number(self.classes)
        by_class = num_classes.clip(min(MIN_CLASSES, max_freedom), max_freedom)
        spread = of_squares**2 / by_square + (self.classes**2).sum(axis=0) ** 2 / by_class
        freedom = (of_squares + of_classes) ** 2 / np.maximum(spread, np.finfo(float).tiny)
        return np.asarray(np.maximum(freedom, np.minimum(by_square, by_class)))


def _effective_number(influences: Matrix) -> npt.NDArray[np.float64]:
    """Count the independent parts (m,) that sums of influences (parts, m) rest on."""
    squares, tiny = influences**2, np.finfo(float).tiny
    fourth = (squares**2).sum(axis=0)
    return np.asarray(np.maximum(squares.sum(axis=0) ** 2, tiny) / np.maximum(fourth, tiny))


@dataclass(frozen=True)
class Sensitivity:
    """Curvature and scores of the mutual information for n variables, the first six a twist of the pose."""

    curvature: Matrix
    """(n, n) minus the second derivative, nats."""
    class_curvatures: Matrix
    """(classes, n, n) share of the points of each class in `curvature`, nats."""
    scores: Matrix
    """(parts, n) contribution to the gradient of each part, the points of one class in a square of an image, nats."""
    squares: npt.NDArray[np.intp]
    """(parts,) number of the square of each part, over all scenes: frames of one scene share their squares."""
    classes: npt.NDArray[np.intp]
    """(parts,) class of the points of each part."""
    motions: Matrix
    """(n, n) mean products of the pixels by which the variables move the points."""
    num_squares: int
    """Number of squares."""

    @property
    def is_determined(self) -> bool:
        """Whether the mutual information falls in every direction of the pose, with all other variables fixed."""
        return self.of_first(6).is_maximum and self.num_squares > 6 + 1

    @property
    def is_maximum(self) -> bool:
        """Whether the mutual information falls in every direction of all variables together."""
        return self._smallest_of(self.curvature) > 0.0

    @property
    def is_distinct(self) -> bool:
        """Whether no change of some variables hides one of others: on a plane, intrinsics and the pose do."""
        return self._smallest_of(self.motions) > MIN_SPREAD

    def _smallest_of(self, matrix: Matrix) -> float:
        """Compute the smallest eigenvalue of a matrix (n, n), for variables that each move points by a pixel."""
        scale = 1.0 / np.sqrt(np.diag(self.motions))
        return float(np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0])

    def of_first(self, count: int) -> Sensitivity:
        """Return the sensitivity to the first variables, with the others fixed."""
        kept = slice(0, count)
        return replace(
            self,
            curvature=self.curvature[kept, kept],
            class_curvatures=self.class_curvatures[:, kept, kept],
            scores=self.scores[:, kept],
            motions=self.motions[kept, kept],
        )

    @property
    def influence(self) -> Matrix:
        """Influence (n, n) of a score on the optimum: the inverse of the curvature."""
        return np.asarray(np.linalg.inv(self.curvature), np.float64)

    def scatter(self, influence: Matrix) -> Scatter:
        """Compute the scatter of the sum of `scores @ influence`, where `influence` is (n, m).

        Squares of the images are independent, except for errors that the points of a class share: a network moves the
        borders of a class in the same way in every frame. The covariance is that of both kinds of clusters (Cameron,
        Gelbach and Miller, *Robust inference with multiway clustering*, 2011), less what they have in common. Classes
        are few and unequal, and the optimum yields to the largest, so that each counts by where the optimum would lie
        without it (the jackknife CV3 of MacKinnon, Nielsen and Webb, *Fast and reliable jackknife and bootstrap methods
        for cluster-robust inference*, 2023). What is in common may come out below nothing and then counts as nothing,
        so that the covariance is never smaller than that of squares alone.

        Influences of frames that show one scene repeat one another, and are summed before they are squared.
        """
        centred = self._centred(influence)
        of_squares = centred.T @ centred
        count = max(len(np.unique(self.classes)), 1)
        without = np.sqrt((count - 1) / count) * self._scores_without_class() @ influence
        by_class = summed(without, self.classes, len(self.class_curvatures))
        # The points of a class in a square are one part in each of the frames of its scene.
        _, parts = np.unique(np.column_stack([self.squares, self.classes]), axis=0, return_inverse=True)
        alone = summed(without, parts.ravel(), int(parts.max(initial=-1)) + 1)
        common = by_class.T @ by_class - alone.T @ alone
        return Scatter(centred, of_squares, by_class, _positive_part(common, of_squares))

    def noise(self, influence: Matrix) -> tuple[Matrix, npt.NDArray[np.float64]]:
        """Compute the part (m, m) of the covariance that differs from square to square, and its degrees of freedom.

        It is that of a difference of two optima by the same classes, which cancels what the classes share.
        """
        centred = self._centred(influence)
        return np.asarray(centred.T @ centred), _effective_number(centred)

    def _centred(self, influence: Matrix) -> Matrix:
        by_square = summed(self.scores, self.squares, self.num_squares) @ influence
        count = len(by_square)
        return np.asarray((by_square - by_square.mean(axis=0)) * np.sqrt(count / (count - 1)))

    def _scores_without_class(self) -> Matrix:
        """Compute scores (parts, n) that move the optimum as far as leaving out the class of each part would.

        With the curvature `H` and the share `H_k` of a class, `(H - H_k)^-1 s = H^-1 s_k` for `s_k = H (H - H_k)^-1 s`.
        That takes the gradient at the optimum, with that of what was known before, as nothing.
        """
        scale, bends, directions = bending(self.curvature, self.motions)
        # Along the columns of this basis the curvature is one.
        basis = scale[:, None] * directions / np.sqrt(bends)
        back = self.curvature @ basis
        scores = self.scores.copy()
        for index, curvature in enumerate(self.class_curvatures):
            leverages, axes = np.linalg.eigh(basis.T @ curvature @ basis)
            more = 1.0 / (1.0 - np.clip(leverages, 0.0, MAX_LEVERAGE)) - 1.0
            in_class = self.classes == index
            scores[in_class] += self.scores[in_class] @ (basis @ (axes * more) @ axes.T @ back.T)
        return scores


def bending(curvature: Matrix, motions: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Find the directions along which the mutual information falls, of variables that each move points by a pixel.

    Args:
        curvature: (n, n) negated Hessian of the mutual information.
        motions: (n, n) mean products of the motions of points by the variables, in pixels.

    Returns:
        (n,) change of each variable that moves points by a pixel, root mean square; (k,) curvatures along the
        directions, ascending; and (n, k) the directions, in units of these changes.
    """
    scale = 1.0 / np.sqrt(np.diag(motions))
    bends, directions = np.linalg.eigh(curvature * np.outer(scale, scale))
    falls = bends > MIN_BEND * max(float(bends[-1]), 0.0)
    return scale, bends[falls], directions[:, falls]


def squares_of(around: core.Sensitivity) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.intp]]:
    """List the squares (squares, 3), frame, row and column, and the number (parts,) of the square of each part."""
    squares, places = np.unique(around.parts[:, :3], axis=0, return_inverse=True)
    return squares, places


def summed(values: Matrix, places: npt.NDArray[np.intp], count: int) -> Matrix:
    """Sum values (parts, n) by their places (parts,) into (count, n)."""
    sums = np.zeros((count, values.shape[1]))
    np.add.at(sums, places, values)
    return sums


def _positive_part(matrix: Matrix, covariance: Matrix) -> Matrix:
    """Leave out the directions of a symmetric matrix (m, m) along which it is negative, in units of a covariance."""
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    spreads, directions = np.linalg.eigh(covariance / np.outer(scale, scale))
    is_spread = spreads > MIN_BEND
    root = scale[:, None] * directions[:, is_spread] * np.sqrt(spreads[is_spread])
    inverse = directions[:, is_spread] / np.sqrt(spreads[is_spread]) / scale[:, None]
    values, axes = np.linalg.eigh(inverse.T @ matrix @ inverse)
    basis = root @ axes
    return np.asarray(basis * np.maximum(values, 0.0) @ basis.T)


def sensitivity(
    observations: Observations,
    T_camera_lidar: Pose,
    config: SensitivityConfig,
    intrinsics: Sequence[str] = (),
    twists_per_s: Sequence[Sequence[float]] | None = None,
) -> Sensitivity | None:
    """Compute the curvature and scores of the mutual information at a pose (4, 4).

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4), metres.
        config: Settings.
        intrinsics: Variables after the pose, as `core.maximise` names them.
        twists_per_s: Twist (6,) of the LiDAR in each of `frame_observations`, if the time offset is a variable.

    Returns:
        The sensitivity; None if no variable changes the mutual information.
    """
    measured = core.sensitivity(observations.core, T_camera_lidar, config, intrinsics, twists_per_s)
    if measured is None:
        return None
    scene_squares = measured.parts[:, :3].copy()
    scene_squares[:, 0] = np.array(observations.scene_numbers)[scene_squares[:, 0]]
    squares, places = np.unique(scene_squares, axis=0, return_inverse=True)
    return Sensitivity(
        curvature=measured.curvature,
        class_curvatures=measured.class_curvatures,
        scores=measured.scores,
        squares=places.ravel(),
        classes=measured.parts[:, 3].astype(np.intp),
        motions=measured.motions,
        num_squares=len(squares),
    )


def determined_sensitivity(
    observations: Observations, T_camera_lidar: Pose, config: SensitivityConfig
) -> Sensitivity | None:
    """Compute the sensitivity on the finest of `BLOCKS_PX` that determine every axis; None if none do."""
    for factor in BLOCKS_PX:
        around = sensitivity(observations, T_camera_lidar, replace(config, factor=factor))
        if around is not None and around.is_determined:
            return around
    return None


class Measurement(NamedTuple):
    """Measurement of n variables by the labels: `reads @ change` is normal with this mean and covariance."""

    reads: Matrix
    """(k, n) directions in which the mutual information curves."""
    scatter: Scatter
    """Scatter of the data along these directions."""
    mean: npt.NDArray[np.float64]
    """(k,) mean."""
    covariance: Matrix
    """(k, k) covariance."""
    systematic: Matrix | None = None
    """(k, k) part of the covariance that systematic errors add, which all frames share; None without them."""

    @property
    def information(self) -> Matrix:
        """Information (n, n) about a change, 0 in directions that are not measured."""
        return np.asarray(self.reads.T @ self._weight @ self.reads)

    @property
    def _weight(self) -> Matrix:
        """Inverse (k, k) of the covariance; zero along directions in which too few parts scatter to estimate it."""
        scale = np.sqrt(np.diag(self.covariance))
        scale = np.where(scale > 0.0, scale, np.inf)
        spreads, directions = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        is_measured = spreads > MIN_SPREAD
        basis = directions[:, is_measured] / scale[:, None]
        return np.asarray(basis / spreads[is_measured] @ basis.T)

    def degrees_of_freedom(self, covariance: Matrix) -> npt.NDArray[np.float64]:
        """Compute Satterthwaite's degrees of freedom (n,) of a covariance (n, n) to which labels contribute.

        Only the scatter of the labels is estimated, and not the part that systematic errors make.
        """
        gain, label_covariance = (
            self._weight @ self.reads @ covariance,
            covariance @ self.information @ covariance,
        )
        if self.systematic is not None:
            label_covariance = label_covariance - gain.T @ self.systematic @ gain
        share = np.diag(label_covariance) / np.maximum(np.diag(covariance), np.finfo(float).tiny)
        estimated = self.scatter.along(gain).degrees_of_freedom
        return np.asarray(np.clip(estimated / np.maximum(share, 1e-3) ** 2, 1.0, MANY))


def sum_of(*parts: Matrix | None) -> Matrix | None:
    """Add covariances (n, n) of independent errors; None if there are none."""
    covariances = [part for part in parts if part is not None]
    return np.asarray(np.sum(covariances, axis=0)) if covariances else None


def no_information(count: int) -> Measurement:
    """Make the measurement of `count` variables by labels without information."""
    nothing = np.zeros((0, 0))
    scatter = Scatter(np.zeros((1, 0)), nothing, np.zeros((1, 0)), nothing)
    return Measurement(np.zeros((0, count)), scatter, np.zeros(0), nothing)


def measure(around: Sensitivity, systematic: Matrix | None = None) -> Measurement:
    """Measure the optimum of the labels.

    Args:
        around: Curvature and scores of the mutual information around the variables.
        systematic: (n, n) covariance that systematic errors add, such as stated ones of the intrinsics.
    """
    scale, bends, directions = bending(around.curvature, around.motions)
    if around.num_squares <= len(scale) + 1:  # Too few squares determine the covariance.
        return no_information(len(scale))
    influence = scale[:, None] * directions / bends
    scatter = around.scatter(influence)
    reads = (directions / scale[:, None]).T
    mean, covariance = around.scores.sum(axis=0) @ influence, scatter.covariance
    labels = Measurement(reads, scatter, mean, covariance)
    if systematic is None:
        return labels
    along = labels.reads @ systematic @ labels.reads.T
    return labels._replace(covariance=covariance + along, systematic=along)
