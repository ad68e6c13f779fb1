"""One estimate of all cameras of a rig, from what each says alone and from known transforms between them.

Each calibration measures T_camera_lidar, with the covariance of a twist on its left. A constraint measures
T_a_b = T_a_lidar T_b_lidar^-1. Twists xi_a and xi_b of the cameras change its residual, to first order, by

    xi_a - Ad(T_a_b) xi_b

A Kalman filter takes in one constraint after the other (Barfoot, *State Estimation for Robotics*, 2017, section 3.3),
linearised anew until it settles. Each constraint is compared with what the cameras and all other constraints say: its
squared innovation, in units of its covariance, is chi-square's if all are right. The one that is farthest beyond chance
is left out, and the others are compared again.

By labels, errors of cameras are taken as independent. Those of other cues are mostly of whole classes of points, which
cameras of one LiDAR share to an unknown degree. The covariance of a sum of errors e_c of unknown correlation is at most
sum C_c / w_c with any weights that sum to one (the bound of covariance intersection: Julier and Uhlmann, *A
non-divergent estimation algorithm in the presence of unknown correlations*, ACC 1997); it is smallest in proportion to
the sizes of the errors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import model_validator

from semcal_cli import core
from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.errors import listed, mismatch
from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.files.validation import Figure, StrictModel, Width, length
from semcal_cli.findings.check import LIMITS
from semcal_cli.geometry.arrays import Matrix, Pose, TwistVector
from semcal_cli.geometry.poses import compare_poses, inverse, rotation_difference
from semcal_cli.geometry.twists import adjoint, apply_twist
from semcal_cli.many.rig.rig_document import MAX_CONSTRAINTS, Constraint
from semcal_cli.observations.observations import Observations
from semcal_cli.readable import figure, lengths
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.sections import Quality, Stage
from semcal_cli.result.uncertainty import Uncertainty

STAGE = "adjusted"
"""Name of the stage in the calibration of a camera."""
POSE_FORMS = {
    "semcal_calibration",
    "rows_camera_lidar",
    "rows_lidar_camera",
    "translation_m",
    "quaternion_xyzw",
}
"""Fields that `CalibrationDocument.from_pose` derives from a pose."""
NUM_AXES = 6
"""Number of degrees of freedom of a pose."""
MAX_ROWS = NUM_AXES * MAX_CAMERAS
"""Largest number of rows of the covariance of all cameras."""
MAX_VARIANCE = 1e20
"""Largest variance, square metres or radians, whose matrix is looked at."""
ROUND_OFF, TINY, MANY = 1e-9, 1e-300, 1e4
"""Relative round-off, a positive number beside zero, and degrees of freedom that are as good as infinite."""
NUM_ROUNDS = 4
"""Number of linearisations. Errors of a linearisation are a hundredth of a step of a degree, and shrink as it does."""


class ComparedConstraint(StrictModel):
    """A constraint beside what the cameras and all other constraints say."""

    to: str
    """Camera to whose frame the constraint leads."""
    source: str
    """Camera from whose frame it leads."""
    rotation_deg: Width
    """Angle between the two, in degrees."""
    distance_m: Width
    """Distance between the positions of the first camera in the frame of the second, in metres."""
    chi_square: Width
    """Squared difference of all six axes in units of its covariance."""
    largest: Width
    """Largest value that chance explains."""

    @property
    def times_the_limit(self) -> float:
        """The square beside its largest value; infinite beside none."""
        return self.chi_square / self.largest if self.largest > 0.0 else math.inf

    @property
    def is_kept(self) -> bool:
        """Whether the constraint took part."""
        return self.chi_square <= self.largest

    @property
    def sentence(self) -> str:
        """Describe the difference."""
        difference = f"{figure(self.rotation_deg)} degrees and {lengths([self.distance_m])}"
        return f"the constraint of {self.to} and {self.source} is {difference} from what the cameras say"

    @property
    def reason(self) -> str:
        """Describe a difference that chance does not explain, and what to do."""
        return (
            f"{self.sentence}, more than chance explains (chi-square {self.chi_square:.3g}, limit {self.largest:.3g}), "
            f"and was left out: check its direction and figures, the calibrations of {self.to} and {self.source}, and "
            "the other constraints"
        )


class Adjustment(StrictModel):
    """What all cameras of a rig and its constraints say together."""

    cameras: Annotated[tuple[str, ...], length(0, MAX_CAMERAS)]
    """Cameras that took part: those that are not untrusted and have an uncertainty."""
    covariance: Annotated[tuple[Annotated[tuple[Figure, ...], length(0, MAX_ROWS)], ...], length(0, MAX_ROWS)]
    """Covariance of their twists in this order, six each, in metres and radians, each in the frame of its camera. Their
    errors without constraints are taken as independent."""
    constraints: Annotated[tuple[ComparedConstraint, ...], length(0, MAX_CONSTRAINTS)]
    """All constraints between them."""
    skipped: Annotated[tuple[Annotated[tuple[str, ...], length(2, 2)], ...], length(0, MAX_CONSTRAINTS)] = ()
    """Cameras of each constraint that was not used, since one of the two took no part."""

    @model_validator(mode="after")
    def _check(self) -> Adjustment:
        if len({*self.cameras}) < len(self.cameras):
            raise mismatch(f"cameras {listed(self.cameras)}", "each camera once")
        for constraint in self.constraints:
            if not {constraint.to, constraint.source} <= {*self.cameras}:
                found = f"a constraint of {constraint.to!r} and {constraint.source!r}"
                raise mismatch(found, f"those of {listed(self.cameras)}")
        count = NUM_AXES * len(self.cameras)
        if len(self.covariance) != count or any(len(row) != count for row in self.covariance):
            raise mismatch("a covariance of another size", f"{count} rows and columns, six for each camera")
        covariance = np.array(self.covariance).reshape(count, count)
        tolerance = ROUND_OFF * np.abs(covariance).max(initial=0.0)
        is_symmetric = (np.abs(covariance - covariance.T) <= tolerance).all()
        is_bounded = tolerance <= ROUND_OFF * MAX_VARIANCE
        if not (is_symmetric and is_bounded and (np.diag(covariance) > 0.0).all()):
            raise mismatch("another matrix as covariance", "a symmetric one with a positive diagonal")
        if count and np.linalg.eigvalsh(covariance).min() < -tolerance:
            raise mismatch("a covariance with a negative eigenvalue", "a positive semidefinite matrix")
        return self

    def covariance_of(self, to: str, source: str) -> Matrix | None:
        """Return the covariance (12, 12) of the twists of two cameras; None if one did not take part."""
        if not {to, source} <= {*self.cameras}:
            return None
        rows = [NUM_AXES * self.cameras.index(name) + np.arange(NUM_AXES) for name in (to, source)]
        places = np.concatenate(rows)
        return np.asarray(np.array(self.covariance)[np.ix_(places, places)])


@dataclass(frozen=True)
class _Estimate:
    """Poses of cameras with their covariance, and where their errors come from."""

    poses: dict[str, Pose]
    covariance: Matrix
    """(6 n, 6 n), with independent errors of the cameras alone."""
    gain: Matrix
    """(6 n, 6 n) gain from the errors of the cameras alone."""
    of_constraints: Matrix
    """(6 n, 6 n) part of the covariance by errors of the constraints."""
    degrees_of_freedom: float
    """Fewest of any axis of any camera alone."""

    @classmethod
    def fit(
        cls, cameras: Mapping[str, CalibrationDocument], constraints: Iterable[Constraint] = ()
    ) -> _Estimate:
        """Adjust cameras to constraints."""
        covariance, degrees = np.zeros((NUM_AXES * len(cameras),) * 2), [MANY]
        for place, uncertainty in zip(_places(len(cameras)), _uncertainties(cameras), strict=True):
            covariance[place, place] = uncertainty.covariance
            degrees += uncertainty.degrees_of_freedom
        poses = {name: calibration.pose for name, calibration in cameras.items()}
        estimate = cls(poses, covariance, np.eye(len(covariance)), np.zeros_like(covariance), min(degrees))
        for constraint in constraints:
            estimate = estimate.with_constraint(constraint)
        return estimate

    def compare(self, constraint: Constraint) -> ComparedConstraint:
        """Compare a constraint that took no part with the poses."""
        T, residual, slope = self._linearised(constraint, self.poses)
        innovation = slope @ self.covariance @ slope.T + np.diag(constraint.variances)
        weighted = np.linalg.solve(innovation, residual)
        chi_square, error = float(residual @ weighted), compare_poses(T, constraint.pose)
        # Only what the cameras say is estimated: Satterthwaite's degrees of freedom along the residual.
        of_cameras = float(weighted @ slope @ (self.covariance - self.of_constraints) @ slope.T @ weighted)
        share = of_cameras / chi_square if chi_square > 0.0 else 1.0
        freedom = min(self.degrees_of_freedom / max(share, 1.0 / MANY) ** 2, MANY)
        # With few parts of the images, chance explains almost any distance, so the distance is limited as well.
        by_chance = joint_quantile(LIMITS["prior"]["chance"].value, freedom)
        return ComparedConstraint(
            to=constraint.to,
            source=constraint.source,
            rotation_deg=error.rotation_deg,
            distance_m=error.camera_center_m,
            chi_square=chi_square,
            largest=min(by_chance, NUM_AXES * LIMITS["prior"]["one axis"].value ** 2),
        )

    def with_constraint(self, constraint: Constraint) -> _Estimate:
        """Move the poses to what they and a constraint say together."""
        poses, twists, variances = self.poses, np.zeros(len(self.covariance)), constraint.variances
        for _ in range(NUM_ROUNDS):
            _, residual, slope = self._linearised(constraint, poses)
            innovation = slope @ self.covariance @ slope.T + np.diag(variances)
            filtering = np.linalg.solve(innovation, slope @ self.covariance).T
            twists = filtering @ (slope @ twists - residual)
            poses = {
                name: apply_twist(pose, twists[place])
                for (name, pose), place in zip(self.poses.items(), _places(len(poses)), strict=True)
            }
        left = np.eye(len(twists)) - filtering @ slope
        by_constraint = (filtering * variances) @ filtering.T
        return replace(
            self,
            poses=poses,
            # Joseph's form, which stays positive.
            covariance=_symmetric(left @ self.covariance @ left.T + by_constraint),
            gain=left @ self.gain,
            of_constraints=_symmetric(left @ self.of_constraints @ left.T + by_constraint),
        )

    def _linearised(
        self, constraint: Constraint, poses: Mapping[str, Pose]
    ) -> tuple[Pose, TwistVector, Matrix]:
        """Return the transform (4, 4) of the poses, its residual (6,) and the slopes (6, 6 n) of that."""
        names, T = list(poses), poses[constraint.to] @ inverse(poses[constraint.source])
        places, slope = _places(len(names)), np.zeros((NUM_AXES, len(self.covariance)))
        slope[:, places[names.index(constraint.to)]] = np.eye(NUM_AXES)
        slope[:, places[names.index(constraint.source)]] = -adjoint(T)
        return T, _twist_between(T, constraint.pose), slope


def adjust(
    cameras: Mapping[str, CalibrationDocument], constraints: Sequence[Constraint]
) -> tuple[Adjustment, dict[str, tuple[Pose, Uncertainty]]]:
    """Adjust the poses of a rig's cameras to the constraints between them.

    Cameras that are not trusted, or whose data determine no pose, take no part.

    Args:
        cameras: Calibration of each camera that has one.
        constraints: Known transforms between cameras.

    Returns:
        What the cameras say together, and the pose (4, 4) and uncertainty of each camera that took part.
    """
    used = {
        name: calibration
        for name, calibration in cameras.items()
        if calibration.believed_uncertainty is not None
    }
    usable = [constraint for constraint in constraints if constraint.cameras <= used.keys()]
    kept, compared = list(usable), dict[frozenset[str], ComparedConstraint]()
    while kept:
        for constraint in kept:
            others = (other for other in kept if other is not constraint)
            compared[constraint.cameras] = _Estimate.fit(used, others).compare(constraint)
        farthest = max(kept, key=lambda constraint: compared[constraint.cameras].times_the_limit)
        if compared[farthest.cameras].is_kept:
            break
        kept.remove(farthest)
    estimate = _Estimate.fit(used, kept)
    together = Adjustment(
        cameras=tuple(used),
        covariance=_rows(estimate.covariance),
        constraints=tuple(compared[constraint.cameras] for constraint in usable),
        skipped=tuple((each.to, each.source) for each in constraints if each not in usable),
    )
    return together, {name: (estimate.poses[name], _uncertainty_of(name, used, estimate)) for name in used}


def _uncertainty_of(
    name: str, cameras: Mapping[str, CalibrationDocument], estimate: _Estimate
) -> Uncertainty:
    """Compute the uncertainty of an adjusted camera."""
    places = dict(zip(cameras, _places(len(cameras)), strict=True))
    uncertainties = dict(zip(cameras, _uncertainties(cameras), strict=True))
    own, place = uncertainties[name], places[name]
    gains = {other: estimate.gain[place, places[other]] for other in cameras}
    parts = {other: _carried(gains[other], uncertainties[other].covariance) for other in cameras}
    weights = _weights(name, cameras, parts)
    covariance = estimate.of_constraints[place, place].copy()
    of_intrinsics, spread = np.zeros_like(covariance), np.zeros(NUM_AXES)
    for other, weight in weights.items():
        covariance += parts[other] / weight
        variances = gains[other] ** 2 * np.diag(uncertainties[other].covariance)
        # Satterthwaite's degrees of freedom of a sum; constraints have infinitely many.
        of_axes = np.array(uncertainties[other].degrees_of_freedom)
        degrees = variances @ of_axes / np.maximum(variances.sum(axis=1), TINY)
        spread += (np.diag(parts[other]) / weight) ** 2 / np.maximum(degrees, 1.0)
        if (by_intrinsics := uncertainties[other].covariance_of_intrinsics) is not None:
            of_intrinsics += _carried(gains[other], by_intrinsics) / weight
    freedom = np.clip(np.diag(covariance) ** 2 / np.maximum(spread, TINY), 1.0, MANY)
    changes: dict[str, object] = {
        "label_bleed": own.label_bleed,
        "intrinsics_cost": own.intrinsics_cost,
        "covariance_of_intrinsics": _rows(of_intrinsics) if of_intrinsics.any() else None,
    }
    if own.twist_by_intrinsics is not None:
        changes["twist_by_intrinsics"] = _rows(gains[name] @ np.array(own.twist_by_intrinsics))
    adjusted = Uncertainty.from_covariance(estimate.poses[name], _symmetric(covariance), freedom)
    return adjusted.model_copy(update=changes)


def _weights(
    name: str, cameras: Mapping[str, CalibrationDocument], parts: Mapping[str, Matrix]
) -> dict[str, float]:
    """Return the weight of what each camera adds to the covariance of one: 1 where errors are independent.

    Args:
        name: The camera.
        cameras: All cameras.
        parts: (6, 6) what each adds.
    """
    scale = np.maximum(np.diag(np.array(cameras[name].covariance)), TINY)
    sizes = {other: math.sqrt(float((np.diag(part) / scale).sum())) for other, part in parts.items()}
    sizes = {other: size for other, size in sizes.items() if size > ROUND_OFF}
    sharing = {other for other in sizes if "cues" in cameras[other].settings.options}
    whole = sum(sizes[other] for other in sharing)
    return {other: size / whole if other in sharing else 1.0 for other, size in sizes.items()}


def _uncertainties(cameras: Mapping[str, CalibrationDocument]) -> list[Uncertainty]:
    found = [calibration.uncertainty for calibration in cameras.values()]
    return [uncertainty for uncertainty in found if uncertainty is not None]


def adjusted_calibration(
    calibration: CalibrationDocument, observations: Observations, T: Pose, uncertainty: Uncertainty
) -> CalibrationDocument:
    """Return a calibration with the pose (4, 4) and the uncertainty of an adjustment.

    Args:
        calibration: Calibration of the camera alone.
        observations: Observations that it was made from, as the pose sees them.
        T: Adjusted pose, metres.
        uncertainty: Its uncertainty.
    """
    agreement, away = core.agreement(observations.core, T), compare_poses(T, calibration.pose)
    quality = Quality.of(
        agreement,
        turn_loss=observations.turn_loss(T),
        num_frames=calibration.quality.num_frames,
        runner_up_margin=calibration.quality.runner_up_margin,
    )
    stage = Stage(T_camera_lidar=T.tolist(), mutual_information_nats=agreement.mutual_information)
    note = (
        f"constraints of the rig moved the camera by {lengths([away.camera_center_m])} and "
        f"{figure(away.rotation_deg)} degrees"
    )
    changes = {
        "uncertainty": uncertainty.with_pixels(calibration.used_camera),
        "quality": quality,
        "stages": calibration.stages | {STAGE: stage},
        "notes": (*calibration.notes, note),
    }
    kept = {name: value for name, value in calibration if name not in POSE_FORMS}
    return CalibrationDocument.from_pose(T, **kept | changes)


def _rows(matrix: Matrix) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))


def _places(count: int) -> list[slice]:
    """Return the rows of each camera."""
    return [slice(NUM_AXES * index, NUM_AXES * (index + 1)) for index in range(count)]


def _twist_between(T: Pose, T_stated: Pose) -> TwistVector:
    """Compute the twist (6,), to first order, on the left of a stated transform that gives another one."""
    return np.concatenate([(T @ inverse(T_stated))[:3, 3], rotation_difference(T, T_stated)])


def _carried(gain: Matrix, covariance: npt.ArrayLike) -> Matrix:
    return np.asarray(gain @ np.asarray(covariance) @ gain.T)


def _symmetric(covariance: Matrix) -> Matrix:
    return np.asarray(0.5 * (covariance + covariance.T))
