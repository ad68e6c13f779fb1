"""One estimate of all sensors of a rig from the ties between them: a Kalman filter over their twists.

The frame of the rig is that of its first LiDAR. T_s_lidar of a sensor s has the error of a twist xi_s on its left, and
T_a_b = T_a_lidar T_b_lidar^-1 of a tie changes with both, to first order, by

    xi_a - Ad(T_a_b) xi_b

The first tie that reaches a sensor places it, with xi_a = mu + Ad(T_a_b) xi_b for the error mu of the tie. Each further
one is a measurement, taken in after the others (Barfoot, *State Estimation for Robotics*, 2017, section 3.3) and
linearised anew until it settles.

Calibrations of one camera with several LiDARs share the errors k of its intrinsics: four numbers in units of their
standard deviations, which are estimated with the poses. Each calibration of the camera errs by mu + J k then, where mu
has the covariance C - J J^T.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.files.validation import StrictModel, Width
from semcal_cli.findings.check import LIMITS
from semcal_cli.geometry.arrays import Matrix, Numbers, Pose, TwistVector
from semcal_cli.geometry.poses import compare_poses, inverse, rotation_difference
from semcal_cli.geometry.twists import adjoint, apply_twist
from semcal_cli.many.rig.rig_document import FIRST_LIDAR
from semcal_cli.many.rig.ties import Tie, in_reach
from semcal_cli.readable import figure, lengths

NUM_AXES, NUM_INTRINSICS = 6, 4
"""Number of degrees of freedom of a pose, and of errors of intrinsics: fx, fy, cx and cy."""
SMALLEST_SHARE = 1e-6
"""Smallest part of a covariance that is left without errors of intrinsics, so that it stays positive."""
MANY = 1e4
"""Degrees of freedom that are as good as infinite."""
NUM_ROUNDS = 4
"""Number of linearisations. Errors of a linearisation are a hundredth of a step of a degree, and shrink as it does."""


class Difference(StrictModel):
    """Difference of a tie from what other ties say."""

    rotation_deg: Width
    """Angle that is left between the transform and what the others say, in degrees."""
    distance_m: Width
    """Distance that is left between the positions that they give the first sensor, in metres."""
    chi_square: Width
    """Squared difference of all six axes in units of its covariance."""
    largest: Width
    """Largest value that chance explains."""

    @property
    def is_explained(self) -> bool:
        """Whether chance explains the difference."""
        return self.chi_square <= self.largest

    @property
    def size(self) -> str:
        """The difference in words."""
        return f"{figure(self.rotation_deg)} degrees and {lengths([self.distance_m])}"


class Closure(Difference):
    """Difference of a tie from what other ties say, with its expected size."""

    expected_rotation_deg: Width
    """Standard error of the rotation, over three axes, in degrees."""
    expected_distance_m: Width
    """Standard error of the position, over three axes, in metres."""

    @property
    def times_the_limit(self) -> float:
        """The square beside its largest value; infinite beside none."""
        return self.chi_square / self.largest if self.largest > 0.0 else math.inf


@dataclass(frozen=True)
class RigEstimate:
    """Poses of sensors and errors of intrinsics with their covariance, and where their errors come from.

    The state has the errors of intrinsics first, four numbers for each camera, then the twists of the n sensors.
    """

    intrinsics: Mapping[str, Numbers]
    """Errors (4,) of the intrinsics of each camera with several calibrations, in standard deviations."""
    poses: Mapping[str, Pose]
    """T_sensor_lidar (4, 4) of each sensor but the first LiDAR."""
    covariance: Matrix
    """(s, s) covariance of the state, with independent errors of the ties."""
    sources: tuple[Tie, ...]
    """The m measured ties."""
    gain: Matrix
    """(s, 4 c + 6 m) gain from the errors of the stated intrinsics of c cameras, then from those of ties."""
    of_constraints: Matrix
    """(s, s) part of the covariance by errors of constraints."""

    @classmethod
    def fit(cls, ties: Iterable[Tie], cameras: Iterable[str] = ()) -> RigEstimate:
        """Estimate the sensors that ties reach from the first LiDAR.

        Args:
            ties: The ties.
            cameras: Cameras whose calibrations share the errors of intrinsics.
        """
        intrinsics = {camera: np.zeros(NUM_INTRINSICS) for camera in cameras}
        stated: Matrix = np.eye(NUM_INTRINSICS * len(intrinsics))
        estimate = cls(intrinsics, {}, stated, (), stated, np.zeros_like(stated))
        for tie, new in in_reach(list(ties)):
            estimate = estimate._updated(tie) if new is None else estimate._extended(tie, new)
        return estimate

    def has(self, *sensors: str) -> bool:
        """Whether all these sensors have a pose."""
        return all(sensor == FIRST_LIDAR or sensor in self.poses for sensor in sensors)

    @property
    def place_of_intrinsics(self) -> slice:
        """Rows of the errors of all intrinsics, and their columns in the gain."""
        return slice(NUM_INTRINSICS * len(self.intrinsics))

    @property
    def place_of_poses(self) -> slice:
        """Rows of the twists of all sensors."""
        return slice(self.place_of_intrinsics.stop, None)

    def intrinsics_place(self, camera: str) -> slice:
        """Return the rows of the errors of a camera's intrinsics, and their columns in the gain."""
        index = list(self.intrinsics).index(camera)
        return slice(NUM_INTRINSICS * index, NUM_INTRINSICS * (index + 1))

    def place(self, sensor: str) -> slice:
        """Return the rows of a sensor other than the first LiDAR."""
        return self._nth(list(self.poses).index(sensor))

    def source_place(self, source: Tie) -> slice:
        """Return the columns of a measured tie in the gain."""
        return self._nth(self.sources.index(source))

    def own_covariance(self, tie: Tie) -> Matrix:
        """Return the covariance (6, 6) of the errors of a tie without those of intrinsics that are estimated."""
        J = self.slope_of_intrinsics(tie)
        return tie.covariance if J is None else _without(tie.covariance, J @ J.T)

    def own_degrees(self, tie: Tie) -> Numbers:
        """Return the degrees of freedom (6,) of these errors; none for a constraint, whose covariance is stated."""
        if tie.uncertainty is None:
            return np.zeros(0)
        degrees = np.array(tie.uncertainty.degrees_of_freedom)
        if self.slope_of_intrinsics(tie) is None:
            return degrees
        # The errors of intrinsics are stated, so that the rest has fewer than the whole (Satterthwaite).
        share = np.diag(self.own_covariance(tie)) / np.diag(tie.covariance)
        return np.asarray(np.maximum(degrees * share**2, 1.0))

    def slope_of_intrinsics(self, tie: Tie) -> Matrix | None:
        """Return the twist (6, 4) of a calibration by the errors of intrinsics; None unless these are estimated."""
        if tie.to not in self.intrinsics or tie.uncertainty is None:
            return None
        twist = tie.uncertainty.twist_by_intrinsics
        return None if twist is None else np.array(twist)

    def compare(self, tie: Tie) -> Closure:
        """Compare a tie that took no part with the poses."""
        T, residual, slope = self._linearised(tie, self)
        own = self.own_covariance(tie)
        innovation = slope @ self.covariance @ slope.T + own
        weighted = np.linalg.solve(innovation, residual)
        chi_square, error = float(residual @ weighted), compare_poses(T, tie.pose)
        # Only what is measured is estimated: Satterthwaite's degrees of freedom along the residual.
        of_K = self.gain[:, self.place_of_intrinsics]
        measured = self.covariance - self.of_constraints - of_K @ of_K.T
        estimated = float(weighted @ slope @ measured @ slope.T @ weighted)
        degrees = [MANY, *(each for source in self.sources for each in self.own_degrees(source))]
        if tie.uncertainty is not None:
            estimated += float(weighted @ own @ weighted)
            degrees += [*self.own_degrees(tie)]
        share = estimated / chi_square if chi_square > 0.0 else 1.0
        freedom = min(float(min(degrees)) / max(share, 1.0 / MANY) ** 2, MANY)
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
        known, by_intrinsics = (tie.source if new == tie.to else tie.to), self._by_intrinsics(tie)
        T_to_source = apply_twist(tie.pose, -self._twist_of_intrinsics(tie))
        T_new_known = T_to_source if new == tie.to else inverse(T_to_source)
        carry = adjoint(T_new_known)
        own = np.eye(NUM_AXES) if new == tie.to else -carry
        placed = carry @ self._selection(known) + own @ by_intrinsics
        passed_on = np.vstack([np.eye(len(self.covariance)), placed])
        added: Matrix = np.zeros((len(passed_on), NUM_AXES))
        added[-NUM_AXES:] = own
        poses = {**self.poses, new: T_new_known @ self._pose_of(known)}
        return self._after(tie, replace(self, poses=poses), passed_on, added)

    def _updated(self, tie: Tie) -> RigEstimate:
        """Move the poses to what they and a tie say together."""
        moved, twists = self, np.zeros(len(self.covariance))
        for _ in range(NUM_ROUNDS):
            _, residual, slope = self._linearised(tie, moved)
            innovation = slope @ self.covariance @ slope.T + self.own_covariance(tie)
            filtering = np.linalg.solve(innovation, slope @ self.covariance).T
            twists = filtering @ (slope @ twists - residual)
            moved = self._moved(twists)
        left: Matrix = np.eye(len(twists)) - filtering @ slope
        after = self._after(tie, moved, left, np.asarray(filtering))
        covariances = symmetric(after.covariance), symmetric(after.of_constraints)
        return replace(after, covariance=covariances[0], of_constraints=covariances[1])

    def _moved(self, change: Numbers) -> RigEstimate:
        """Return the estimate with the errors of its state changed: moved poses, and other intrinsics."""
        # What is left of the errors of intrinsics grows as what is known of them shrinks.
        return replace(
            self,
            poses={name: apply_twist(pose, change[self.place(name)]) for name, pose in self.poses.items()},
            intrinsics={name: k - change[self.intrinsics_place(name)] for name, k in self.intrinsics.items()},
        )

    def _after(self, tie: Tie, moved: RigEstimate, passed_on: Matrix, added: Matrix) -> RigEstimate:
        """Return the estimate after a tie.

        Args:
            tie: The tie.
            moved: The estimate with the poses after it.
            passed_on: (s', s) effect of the errors before it.
            added: (s', 6) effect of its own.
        """
        by_tie = added @ self.own_covariance(tie) @ added.T
        is_measured = tie.uncertainty is not None
        of_constraints = passed_on @ self.of_constraints @ passed_on.T
        gain = passed_on @ self.gain
        return replace(
            moved,
            # Joseph's form, which stays positive.
            covariance=passed_on @ self.covariance @ passed_on.T + by_tie,
            sources=(*self.sources, tie) if is_measured else self.sources,
            gain=np.hstack([gain, added]) if is_measured else gain,
            of_constraints=of_constraints if is_measured else of_constraints + by_tie,
        )

    def _linearised(self, tie: Tie, moved: RigEstimate) -> tuple[Pose, TwistVector, Matrix]:
        """Return the transform (4, 4) that a state says, the residual (6,) of a tie, and the slopes (6, s) of that."""
        T = moved._pose_of(tie.to) @ inverse(moved._pose_of(tie.source))
        slope = self._selection(tie.to) - adjoint(T) @ self._selection(tie.source)
        residual = twist_between(T, tie.pose) + moved._twist_of_intrinsics(tie)
        return T, residual, slope - self._by_intrinsics(tie)

    def _pose_of(self, sensor: str) -> Pose:
        return np.eye(4) if sensor == FIRST_LIDAR else self.poses[sensor]

    def _twist_of_intrinsics(self, tie: Tie) -> TwistVector:
        """Return the twist (6,) of a tie by the estimated errors of intrinsics."""
        J = self.slope_of_intrinsics(tie)
        return np.zeros(NUM_AXES) if J is None else np.asarray(J @ self.intrinsics[tie.to])

    def _by_intrinsics(self, tie: Tie) -> Matrix:
        """Return the matrix (6, s) from the errors of intrinsics to the twist of a tie."""
        slope: Matrix = np.zeros((NUM_AXES, len(self.covariance)))
        if (J := self.slope_of_intrinsics(tie)) is not None:
            slope[:, self.intrinsics_place(tie.to)] = J
        return slope

    def _selection(self, sensor: str) -> Matrix:
        """Return the matrix (6, s) that selects the twist of a sensor; zero for the first LiDAR, which has none."""
        selection = np.zeros((NUM_AXES, len(self.covariance)))
        if sensor != FIRST_LIDAR:
            selection[:, self.place(sensor)] = np.eye(NUM_AXES)
        return selection

    def _nth(self, index: int) -> slice:
        start = NUM_INTRINSICS * len(self.intrinsics) + NUM_AXES * index
        return slice(start, start + NUM_AXES)


def symmetric(covariance: Matrix) -> Matrix:
    """Remove the round-off of a covariance across its diagonal."""
    return np.asarray(0.5 * (covariance + covariance.T))


def _without(covariance: Matrix, part: Matrix) -> Matrix:
    """Subtract a part (6, 6) from a covariance, which keeps at least a millionth of itself in every direction."""
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh((covariance - part) / np.outer(scale, scale))
    return np.asarray((vectors * values.clip(min=SMALLEST_SHARE)) @ vectors.T * np.outer(scale, scale))


def twist_between(T: Pose, T_stated: Pose) -> TwistVector:
    """Compute the twist (6,), to first order, on the left of a stated transform that gives another one."""
    return np.concatenate([(T @ inverse(T_stated))[:3, 3], rotation_difference(T, T_stated)])
