"""One estimate of all sensors of a rig from the ties between them: a Kalman filter over their twists.

The frame of the rig is that of its first LiDAR. T_s_lidar of a sensor s has the error of a twist xi_s on its left, and
T_a_b = T_a_lidar T_b_lidar^-1 of a tie changes with both, to first order, by

    xi_a - Ad(T_a_b) xi_b

The first tie that reaches a sensor places it, with xi_a = mu + Ad(T_a_b) xi_b for the error mu of the tie. Each further
one is a measurement, taken in after the others (Barfoot, *State Estimation for Robotics*, 2017, section 3.3) and
linearised anew until it settles.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.findings.check import LIMITS
from semcal_cli.geometry.arrays import Matrix, Pose, TwistVector
from semcal_cli.geometry.poses import compare_poses, inverse, rotation_difference
from semcal_cli.geometry.twists import adjoint, apply_twist
from semcal_cli.many.rig.rig_document import FIRST_LIDAR
from semcal_cli.many.rig.ties import Tie, in_reach

NUM_AXES = 6
"""Number of degrees of freedom of a pose."""
MANY = 1e4
"""Degrees of freedom that are as good as infinite."""
NUM_ROUNDS = 4
"""Number of linearisations. Errors of a linearisation are a hundredth of a step of a degree, and shrink as it does."""


class Closure(NamedTuple):
    """Difference of a tie from what other ties say, with its expected size."""

    rotation_deg: float
    """Angle between the two, in degrees."""
    distance_m: float
    """Distance between the positions of the first sensor in the frame of the second, in metres."""
    chi_square: float
    """Squared difference of all six axes in units of its covariance."""
    largest: float
    """Largest value that chance explains."""
    expected_rotation_deg: float
    """Standard error of the rotation: the root of the sum of its variances about three axes, in degrees."""
    expected_distance_m: float
    """Standard error of the position, likewise, in metres."""

    @property
    def times_the_limit(self) -> float:
        """The square beside its largest value; infinite beside none."""
        return self.chi_square / self.largest if self.largest > 0.0 else math.inf

    @property
    def is_explained(self) -> bool:
        """Whether chance explains the difference."""
        return self.chi_square <= self.largest


@dataclass(frozen=True)
class RigEstimate:
    """Poses of sensors with their covariance, and where their errors come from."""

    poses: Mapping[str, Pose]
    """T_sensor_lidar (4, 4) of each sensor but the first LiDAR."""
    covariance: Matrix
    """(6 n, 6 n) covariance of their twists, with independent errors of the ties."""
    sources: tuple[Tie, ...]
    """The m measured ties."""
    gain: Matrix
    """(6 n, 6 m) gain from their errors."""
    of_constraints: Matrix
    """(6 n, 6 n) part of the covariance by errors of constraints."""

    @classmethod
    def fit(cls, ties: Iterable[Tie]) -> RigEstimate:
        """Estimate the sensors that ties reach from the first LiDAR."""
        none = np.zeros((0, 0))
        estimate = cls({}, none, (), none, none)
        for tie, new in in_reach(list(ties)):
            estimate = estimate._updated(tie) if new is None else estimate._extended(tie, new)
        return estimate

    def has(self, *sensors: str) -> bool:
        """Whether all these sensors have a pose."""
        return all(sensor == FIRST_LIDAR or sensor in self.poses for sensor in sensors)

    def place(self, sensor: str) -> slice:
        """Return the rows of a sensor other than the first LiDAR."""
        index = list(self.poses).index(sensor)
        return slice(NUM_AXES * index, NUM_AXES * (index + 1))

    def source_place(self, source: Tie) -> slice:
        """Return the columns of a measured tie in the gain."""
        index = self.sources.index(source)
        return slice(NUM_AXES * index, NUM_AXES * (index + 1))

    def compare(self, tie: Tie) -> Closure:
        """Compare a tie that took no part with the poses."""
        T, residual, slope = self._linearised(tie, self.poses)
        innovation = slope @ self.covariance @ slope.T + tie.covariance
        weighted = np.linalg.solve(innovation, residual)
        chi_square, error = float(residual @ weighted), compare_poses(T, tie.pose)
        # Only what is measured is estimated: Satterthwaite's degrees of freedom along the residual.
        estimated = float(weighted @ slope @ (self.covariance - self.of_constraints) @ slope.T @ weighted)
        degrees = [MANY, *(each for source in self.sources for each in _degrees(source))]
        if tie.uncertainty is not None:
            estimated += float(weighted @ tie.covariance @ weighted)
            degrees += _degrees(tie)
        share = estimated / chi_square if chi_square > 0.0 else 1.0
        freedom = min(min(degrees) / max(share, 1.0 / MANY) ** 2, MANY)
        # With few parts of the images, chance explains almost any distance, so the distance is limited as well.
        by_chance = joint_quantile(LIMITS["prior"]["chance"].value, freedom)
        variances = np.diag(innovation)
        return Closure(
            rotation_deg=error.rotation_deg,
            distance_m=error.camera_center_m,
            chi_square=chi_square,
            largest=min(by_chance, NUM_AXES * LIMITS["prior"]["one axis"].value ** 2),
            expected_rotation_deg=math.degrees(math.sqrt(variances[3:].sum())),
            expected_distance_m=math.sqrt(variances[:3].sum()),
        )

    def _extended(self, tie: Tie, new: str) -> RigEstimate:
        """Place a sensor by the first tie that reaches it."""
        known = tie.source if new == tie.to else tie.to
        T_new_known = tie.across(known)
        carry = adjoint(T_new_known)
        pose = T_new_known @ self._pose_of(known, self.poses)
        passed_on = np.vstack([np.eye(len(self.covariance)), carry @ self._selection(known)])
        added: Matrix = np.zeros((len(passed_on), NUM_AXES))
        added[-NUM_AXES:] = np.eye(NUM_AXES) if new == tie.to else -carry
        return self._after(tie, {**self.poses, new: pose}, passed_on, added)

    def _updated(self, tie: Tie) -> RigEstimate:
        """Move the poses to what they and a tie say together."""
        poses, twists = self.poses, np.zeros(len(self.covariance))
        for _ in range(NUM_ROUNDS):
            _, residual, slope = self._linearised(tie, poses)
            innovation = slope @ self.covariance @ slope.T + tie.covariance
            filtering = np.linalg.solve(innovation, slope @ self.covariance).T
            twists = filtering @ (slope @ twists - residual)
            poses = {name: apply_twist(pose, twists[self.place(name)]) for name, pose in self.poses.items()}
        left: Matrix = np.eye(len(twists)) - filtering @ slope
        after = self._after(tie, poses, left, np.asarray(filtering))
        covariances = symmetric(after.covariance), symmetric(after.of_constraints)
        return replace(after, covariance=covariances[0], of_constraints=covariances[1])

    def _after(self, tie: Tie, poses: Mapping[str, Pose], passed_on: Matrix, added: Matrix) -> RigEstimate:
        """Return the estimate after a tie.

        Args:
            tie: The tie.
            poses: The poses after it.
            passed_on: (6 n', 6 n) effect of the errors before it.
            added: (6 n', 6) effect of its own.
        """
        by_tie = added @ tie.covariance @ added.T
        is_measured = tie.uncertainty is not None
        of_constraints = passed_on @ self.of_constraints @ passed_on.T
        gain = passed_on @ self.gain
        return RigEstimate(
            poses=poses,
            # Joseph's form, which stays positive.
            covariance=passed_on @ self.covariance @ passed_on.T + by_tie,
            sources=(*self.sources, tie) if is_measured else self.sources,
            gain=np.hstack([gain, added]) if is_measured else gain,
            of_constraints=of_constraints if is_measured else of_constraints + by_tie,
        )

    def _linearised(self, tie: Tie, poses: Mapping[str, Pose]) -> tuple[Pose, TwistVector, Matrix]:
        """Return the transform (4, 4) of the poses, its residual (6,) and the slopes (6, 6 n) of that."""
        T = self._pose_of(tie.to, poses) @ inverse(self._pose_of(tie.source, poses))
        slope = self._selection(tie.to) - adjoint(T) @ self._selection(tie.source)
        return T, twist_between(T, tie.pose), slope

    def _pose_of(self, sensor: str, poses: Mapping[str, Pose]) -> Pose:
        return np.eye(4) if sensor == FIRST_LIDAR else poses[sensor]

    def _selection(self, sensor: str) -> Matrix:
        """Return the matrix (6, 6 n) that selects the twist of a sensor; zero for the first LiDAR, which has none."""
        selection = np.zeros((NUM_AXES, len(self.covariance)))
        if sensor != FIRST_LIDAR:
            selection[:, self.place(sensor)] = np.eye(NUM_AXES)
        return selection


def symmetric(covariance: Matrix) -> Matrix:
    """Remove the round-off of a covariance across its diagonal."""
    return np.asarray(0.5 * (covariance + covariance.T))


def _degrees(tie: Tie) -> tuple[float, ...]:
    return () if tie.uncertainty is None else tie.uncertainty.degrees_of_freedom


def twist_between(T: Pose, T_stated: Pose) -> TwistVector:
    """Compute the twist (6,), to first order, on the left of a stated transform that gives another one."""
    return np.concatenate([(T @ inverse(T_stated))[:3, 3], rotation_difference(T, T_stated)])
