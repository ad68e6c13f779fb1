"""Priors, which are measurements of the pose that are known beforehand, and their fusion with the labels.

The labels give a measurement of the pose, whose covariance is the sandwich of `uncertainty.covariance`. The
priors give others, and all are weighted by their information (Gauss-Newton). Axes that are known exactly are
constraints. Directions in which the mutual information does not curve carry no information of the labels, so the priors
alone decide there. Stated errors of the intrinsics add to the covariance of the labels' measurement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import SensitivityConfig
from semcal_cli.drive.camera import IntrinsicsSigma, sigma_of
from semcal_cli.estimation.stage import StageResult
from semcal_cli.estimation.uncertainty.intrinsics import (
    around_intrinsics,
    shift_by,
    twist_by_intrinsics,
)
from semcal_cli.estimation.uncertainty.sensitivity import (
    Measurement,
    Sensitivity,
    measure,
    sensitivity,
    sum_of,
)
from semcal_cli.geometry.arrays import Matrix, Numbers, Pose
from semcal_cli.geometry.poses import camera_center, rotation_difference
from semcal_cli.geometry.twists import apply_twist, inverse_left_jacobian, pose_at
from semcal_cli.observations.observations import Observations
from semcal_cli.result.uncertainty import Uncertainty

CLAMP_SIGMAS = 3.0
"""Standard deviations to which the refinement clamps a pose at the start of each level. A normal error exceeds them
once in 400 times."""
EXACT = 1e-6
"""Standard deviation, metres or radians, below which an axis counts as known exactly, so that sums do not round."""
MAX_ROUNDS = 20
"""Largest number of Gauss-Newton rounds."""
LONGEST_STEP_PX = 2.0
"""Largest movement of the points in one round, in pixels, root mean square; the curvature holds about that far."""
SETTLED_PX = 0.1
"""Movement of the points below which the rounds end, in pixels, root mean square, as `PolishConfig.settled_px`."""
MIN_INFORMATION = 1e-13
"""Smallest information along a direction, relative to the best known direction. Less is rounding."""


@dataclass(frozen=True)
class Prior:
    """Known pose of a camera, with a standard deviation for each axis."""

    name: str
    """Name of the prior in messages and results."""
    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres; arbitrary along unknown axes."""
    sigmas: tuple[float, ...]
    """(6,) standard deviations of the camera's position along its axes, metres, and of its rotation about them,
    radians: 0 for an exact axis, infinite for an unknown one."""

    def residual(self, T_camera_lidar: Pose) -> npt.NDArray[np.float64]:
        """Compute the offset (6,) of a pose along the axes of this camera: position, metres, and rotation, radians."""
        center_offset = camera_center(T_camera_lidar) - camera_center(self.T_camera_lidar)
        rotation = rotation_difference(T_camera_lidar, self.T_camera_lidar)
        return np.concatenate([self.T_camera_lidar[:3, :3] @ center_offset, rotation])

    def jacobian(self, T_camera_lidar: Pose) -> npt.NDArray[np.float64]:
        """Compute the derivatives (6, 6) of the residual with respect to a twist on the left of the pose."""
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = -self.T_camera_lidar[:3, :3] @ T_camera_lidar[:3, :3].T
        jacobian[3:, 3:] = inverse_left_jacobian(rotation_difference(T_camera_lidar, self.T_camera_lidar))
        return jacobian

    def describe(self) -> dict[str, object]:
        """Describe the prior for a result file, with null for unknown axes."""
        sigmas = [sigma if math.isfinite(sigma) else None for sigma in self.sigmas]
        return {
            "name": self.name,
            "T_camera_lidar": self.T_camera_lidar.tolist(),
            "sigma_camera_center_m": sigmas[:3],
            "sigma_rotation_deg": [None if sigma is None else math.degrees(sigma) for sigma in sigmas[3:]],
        }

    @property
    def exact(self) -> Prior:
        """The same prior with only its exact axes known."""
        return replace(self, sigmas=tuple(0.0 if sigma <= EXACT else math.inf for sigma in self.sigmas))

    def allows(self, T_camera_lidar: Pose, center_m: float, rotation_rad: float) -> bool:
        """Whether a pose is possible under this prior, within `CLAMP_SIGMAS`.

        Args:
            T_camera_lidar: (4, 4), metres.
            center_m: Possible error of the pose's position along each axis.
            rotation_rad: Possible error of its rotation about each axis.
        """
        slack = np.repeat([center_m, rotation_rad], 3)
        limits = CLAMP_SIGMAS * np.array(self.sigmas) + slack
        return bool((np.abs(self.residual(T_camera_lidar)) <= limits).all())

    def clamp(self, T_camera_lidar: Pose) -> Pose:
        """Clamp a pose (4, 4) to within `CLAMP_SIGMAS` of the prior, axis by axis."""
        residual = self.residual(T_camera_lidar)
        limits = CLAMP_SIGMAS * np.array(self.sigmas)
        if (np.abs(residual) <= limits).all():
            return T_camera_lidar
        clamped = np.clip(residual, -limits, limits)
        # The translation of a twist moves the camera's centre in the opposite direction.
        return pose_at(self.T_camera_lidar, np.concatenate([-clamped[:3], clamped[3:]]))


def clamp(T_camera_lidar: Pose, priors: Sequence[Prior]) -> Pose:
    """Clamp a pose (4, 4) to each prior in turn; only the last one is met exactly."""
    for prior in priors:
        T_camera_lidar = prior.clamp(T_camera_lidar)
    return T_camera_lidar


class OffsetFromLabels(NamedTuple):
    """Offset of the pose that labels alone give from a prior, over all known axes at once."""

    axis: int
    """Known axis that is farthest off in standard deviations: 0 to 2 position, 3 to 5 rotation."""
    offset: float
    """Offset along that axis, metres, or about it, radians."""
    chi2: float
    num_axes: int
    """Number of known axes, the degrees of freedom of chi-square."""
    degrees_of_freedom: float
    """Fewest degrees of freedom of the covariance of the labels along any axis."""


class PriorOffset(NamedTuple):
    """Offset of the final pose from a prior, along the axis that is farthest off in standard deviations."""

    name: str
    """Name of the prior."""
    axis: int
    """The axis: 0 to 2 position, 3 to 5 rotation."""
    offset: float
    """Offset along it, metres, or about it, radians."""
    deviations: float
    """The same in standard deviations of the prior."""
    from_labels: OffsetFromLabels | None
    """Offset of the pose that labels alone give; None if they determine none."""


@dataclass(frozen=True, kw_only=True)
class Fused(StageResult):
    """Pose that labels and priors determine together."""

    prior_offsets: tuple[PriorOffset, ...]
    """Offset from each prior; empty if labels carry no information at all."""
    is_settled: bool
    """Whether the last round moved the points little."""

    uncertainty: Uncertainty | None
    """Uncertainty of the pose; None if labels and priors together do not determine it."""
    is_alone: bool
    """Whether the labels determine the pose without priors."""
    label_gain: Matrix
    """(6, 6) gain from a twist of the labels' optimum to a twist of the pose."""
    twist_by_intrinsics: Matrix | None
    """(6, 4) twist of the pose by an error of one standard deviation of fx, fy, cx and cy; None if they are exact."""


def fuse_with_priors(
    observations: Observations,
    T_camera_lidar: Pose,
    priors: Sequence[Prior],
    *,
    motion_covariance: Matrix | None = None,
) -> Fused:
    """Find the pose that labels and priors determine together.

    Args:
        observations: The observations that the pose was polished on.
        T_camera_lidar: (4, 4) pose polished without priors, metres.
        priors: The priors, which leave at least one direction free.
        motion_covariance: (6, 6) covariance of the labels' optimum by the clock and the motion that the drive states;
            None if there is none.
    """
    around = sensitivity(observations, T_camera_lidar, SensitivityConfig())
    is_alone = around is not None and around.is_determined
    T = T_camera_lidar if is_alone else clamp(T_camera_lidar, priors)
    twist = _twist_by_intrinsics(observations, T)
    systematic = sum_of(None if twist is None else twist @ twist.T, motion_covariance)
    from_labels: list[OffsetFromLabels | None] = [None] * len(priors)
    if around is not None and is_alone:
        labels = measure(around, systematic)
        from_labels = [_offset_from_labels(labels, prior, T_camera_lidar) for prior in priors]
    T, fit = _iterate(observations, T, priors, around, systematic, is_alone)
    offsets, uncertainty, label_gain = list[PriorOffset](), None, np.eye(6)
    if fit is not None:
        # Steps are of first order, so exact axes are restored to the last digit.
        T = clamp(T, [prior.exact for prior in priors])
        offsets = [_offset(prior, T, alone) for prior, alone in zip(priors, from_labels, strict=True)]
        label_gain = fit.covariance @ fit.labels.information
        if fit.is_closed:
            degrees_of_freedom = fit.labels.degrees_of_freedom(fit.covariance)
            uncertainty = Uncertainty.from_covariance(T, fit.covariance, degrees_of_freedom)
    if twist is not None:
        twist = None if fit is None else np.asarray(label_gain @ twist)
    return Fused(
        T_camera_lidar=T,
        agreement=core.agreement(observations.core, T),
        note=f"with {', '.join(prior.name for prior in priors)}",
        prior_offsets=tuple(offsets),
        is_settled=fit is not None and fit.moved_px < SETTLED_PX,
        uncertainty=uncertainty,
        is_alone=is_alone,
        label_gain=label_gain,
        twist_by_intrinsics=twist,
    )


class _Fit(NamedTuple):
    """State after the last round of Gauss-Newton."""

    labels: Measurement
    """Measurement of the pose by the labels."""
    covariance: Matrix
    """(6, 6) covariance of a twist on the left of the pose."""
    is_closed: bool
    """Whether every direction is determined."""
    moved_px: float
    """Movement of the points in the last round, in pixels, root mean square."""


def _iterate(
    observations: Observations,
    T: Pose,
    priors: Sequence[Prior],
    around: Sensitivity | None,
    systematic: Matrix | None,
    is_alone: bool,
) -> tuple[Pose, _Fit | None]:
    """Weigh labels and priors until a round moves the points little; no fit if labels carry no information at all.

    If the labels alone determine the pose, they are evaluated once; otherwise they are evaluated in every round.
    """
    fit: _Fit | None = None
    for _ in range(MAX_ROUNDS):
        if fit is not None and not is_alone:
            around = sensitivity(observations, T, SensitivityConfig())
        if around is None:
            return T, None
        labels = fit.labels if fit is not None and is_alone else measure(around, systematic)
        step, covariance, is_closed = _solve(labels, *_stack_priors(T, priors), around.motions)
        moved_px = float(np.sqrt(step @ around.motions @ step))
        step *= 1.0 if is_alone else min(1.0, LONGEST_STEP_PX / max(moved_px, SETTLED_PX))
        T = apply_twist(T, step)
        # The labels' optimum stays where it is, so its distance from the pose changes by the step.
        labels = labels._replace(mean=labels.mean - labels.reads @ step)
        fit = _Fit(labels, covariance, is_closed, moved_px)
        if moved_px < SETTLED_PX:
            break
    return T, fit


def _twist_by_intrinsics(observations: Observations, T_camera_lidar: Pose) -> Matrix | None:
    """Compute the twist (6, 4) of the labels' optimum by errors of the intrinsics; None if K is exact."""
    camera = observations.camera
    if sigma_of(camera) == IntrinsicsSigma():
        return None
    return twist_by_intrinsics(shift_by(around_intrinsics(observations, T_camera_lidar)), camera)


def _stack_priors(T_camera_lidar: Pose, priors: Sequence[Prior]) -> tuple[Matrix, Numbers, Numbers]:
    """List the known axes of all priors, a row each: `jacobian @ twist` should be minus the residual.

    Returns:
        (k, 6) the jacobian, (k,) the residual, and (k,) standard deviations.
    """
    sigmas = np.concatenate([prior.sigmas for prior in priors])
    stated = np.isfinite(sigmas)
    jacobian = np.concatenate([prior.jacobian(T_camera_lidar) for prior in priors])
    residual = np.concatenate([prior.residual(T_camera_lidar) for prior in priors])
    return jacobian[stated], residual[stated], sigmas[stated]


def _solve(
    labels: Measurement, jacobian: Matrix, residual: Numbers, sigmas: Numbers, motions: Matrix
) -> tuple[Numbers, Matrix, bool]:
    """Compute the twist to the best pose, its covariance, and whether every direction is determined.

    The pose does not move along directions that are not determined.
    """
    is_exact = sigmas <= EXACT
    weight = 1.0 / sigmas[~is_exact] ** 2
    J, e = jacobian[~is_exact], residual[~is_exact]
    information = labels.information + J.T @ (weight[:, None] * J)
    pull = labels.reads.T @ np.linalg.solve(labels.covariance, labels.mean) - J.T @ (weight * e)
    to_exact, free = np.zeros(6), np.eye(6)
    if is_exact.any():
        to_exact = -np.linalg.pinv(jacobian[is_exact]) @ residual[is_exact]
        _, values, rows = np.linalg.svd(jacobian[is_exact])
        free = rows[int((values > 1e-9 * values[0]).sum()) :].T
    # The basis is scaled so that each direction moves the points by the same number of pixels.
    free = free / np.sqrt(np.diag(free.T @ motions @ free))
    weights, directions = np.linalg.eigh(free.T @ information @ free)
    closed = weights > MIN_INFORMATION * weights[-1]
    basis = free @ directions[:, closed]
    covariance = basis / weights[closed] @ basis.T
    return to_exact + covariance @ (pull - information @ to_exact), covariance, bool(closed.all())


def _offset_from_labels(labels: Measurement, prior: Prior, T_camera_lidar: Pose) -> OffsetFromLabels:
    """Compute the offset of the optimum of the labels alone from a prior, over all known axes at once."""
    jacobian, residual, sigmas = _stack_priors(T_camera_lidar, [prior])
    alone: Matrix = np.asarray(np.linalg.inv(labels.information), np.float64)
    off = residual + jacobian @ np.linalg.solve(labels.reads, labels.mean)
    covariance = jacobian @ alone @ jacobian.T + np.diag(np.square(sigmas))
    worst = int((np.abs(off) / np.sqrt(np.diag(covariance))).argmax())
    return OffsetFromLabels(
        axis=int(np.flatnonzero(np.isfinite(prior.sigmas))[worst]),
        offset=float(off[worst]),
        chi2=float(off @ np.linalg.solve(covariance, off)),
        num_axes=len(sigmas),
        degrees_of_freedom=float(labels.degrees_of_freedom(alone).min()),
    )


def _offset(prior: Prior, T_camera_lidar: Pose, from_labels: OffsetFromLabels | None) -> PriorOffset:
    """Compute the offset of the final pose (4, 4) from a prior."""
    residual = prior.residual(T_camera_lidar)
    deviations = np.abs(residual) / np.maximum(prior.sigmas, EXACT)
    worst = int(deviations.argmax())
    return PriorOffset(prior.name, worst, float(residual[worst]), float(deviations.max()), from_labels)
