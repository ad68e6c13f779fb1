"""One estimate of all cameras of a rig, from what each says alone and from known transforms between them.

Each calibration measures T_camera_lidar, with the covariance of a twist on its left. A constraint measures
T_a_b = T_a_lidar T_b_lidar^-1. Twists xi_a and xi_b of the cameras change its residual, to first order, by

    xi_a - Ad(T_a_b) xi_b

A Kalman filter takes in one constraint after the other (Barfoot, *State Estimation for Robotics*, 2017, section 3.3),
linearised anew until it settles. Each is first compared with what the cameras and the constraints before it say: its
squared innovation in units of its covariance is chi-square's if both are right. One that is not is left out.

By labels, errors of cameras are independent. Those of other cues are mostly of whole classes of points, which cameras
of one LiDAR share to an unknown degree. Such cameras are combined by covariance intersection with equal weights, which
holds for any correlation (Julier and Uhlmann, *A non-divergent estimation algorithm in the presence of unknown
correlations*, ACC 1997).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import model_validator

from semcal_cli import core
from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.errors import mismatch
from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.files.validation import Figure, StrictModel, length
from semcal_cli.findings.check import LIMITS
from semcal_cli.geometry.arrays import Matrix, Numbers, Pose, TwistVector
from semcal_cli.geometry.poses import compare_poses, inverse, rotation_difference
from semcal_cli.geometry.twists import adjoint, apply_twist
from semcal_cli.many.rig.rig_document import Constraint, merge_overlapping
from semcal_cli.observations.observations import Observations
from semcal_cli.readable import figure, lengths
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.sections import Stage
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
NUM_ROUNDS = 4
"""Number of linearisations. Errors of a linearisation are a hundredth of a step of a degree, and shrink as it does."""


class ComparedConstraint(StrictModel):
    """A constraint beside what the cameras and the constraints before it say."""

    to: str
    """Camera to whose frame the constraint leads."""
    source: str
    """Camera from whose frame it leads."""
    rotation_deg: Figure
    """Angle between the two, in degrees."""
    distance_m: Figure
    """Distance between the positions of the first camera in the frame of the second, in metres."""
    chi_square: Figure
    """Squared difference of all six axes in units of its covariance."""
    largest: Figure
    """Largest value that chance explains."""

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
            "and was left out: check its direction and its figures, or give larger sigma_m and sigma_deg"
        )


class Adjustment(StrictModel):
    """What all cameras of a rig and its constraints say together."""

    cameras: Annotated[tuple[str, ...], length(0, MAX_CAMERAS)]
    """Cameras that took part: those that are not untrusted and have an uncertainty."""
    covariance: Annotated[tuple[Annotated[tuple[Figure, ...], length(0, MAX_ROWS)], ...], length(0, MAX_ROWS)]
    """Covariance of their twists in this order, six each, in metres and radians, each in the frame of its camera."""
    constraints: Annotated[tuple[ComparedConstraint, ...], length(0, MAX_CAMERAS)]
    """All constraints between them."""

    @model_validator(mode="after")
    def _check_size(self) -> Adjustment:
        count = NUM_AXES * len(self.cameras)
        if len(self.covariance) != count or any(len(row) != count for row in self.covariance):
            raise mismatch("a covariance of another size", f"{count} rows and columns, six for each camera")
        return self

    def covariance_of(self, to: str, source: str) -> Matrix | None:
        """Return the covariance (12, 12) of the twists of two cameras; None if one did not take part."""
        if not {to, source} <= {*self.cameras}:
            return None
        rows = [NUM_AXES * self.cameras.index(name) + np.arange(NUM_AXES) for name in (to, source)]
        places = np.concatenate(rows)
        return np.asarray(np.array(self.covariance)[np.ix_(places, places)])


@dataclass
class _State:
    """Poses with their covariance, and where their errors come from."""

    poses: dict[str, Pose]
    covariance: Matrix
    """(6 n, 6 n)."""
    gain: Matrix
    """(6 n, 6 n) gain from the errors of the cameras alone."""
    of_constraints: Matrix
    """(6 n, 6 n) part of the covariance by errors of the constraints."""

    @classmethod
    def of(cls, cameras: Mapping[str, CalibrationDocument], num_alike: Mapping[str, int]) -> _State:
        """Start from cameras alone, given how many share the errors of each."""
        covariance = np.zeros((NUM_AXES * len(cameras),) * 2)
        for place, (name, calibration) in zip(_places(len(cameras)), cameras.items(), strict=True):
            covariance[place, place] = num_alike[name] * np.array(calibration.covariance)
        poses = {name: calibration.pose for name, calibration in cameras.items()}
        return cls(poses, covariance, np.eye(len(covariance)), np.zeros_like(covariance))

    def take_in(self, constraint: Constraint, degrees_of_freedom: float) -> ComparedConstraint:
        """Compare a constraint, and move the poses if chance explains the difference."""
        names, poses = list(self.poses), dict(self.poses)
        to, source = names.index(constraint.to), names.index(constraint.source)
        twists, variances = np.zeros(len(self.covariance)), constraint.variances
        compared: ComparedConstraint | None = None
        for _ in range(NUM_ROUNDS):
            T = poses[constraint.to] @ inverse(poses[constraint.source])
            slope = np.zeros((NUM_AXES, len(twists)))
            slope[:, _places(len(names))[to]] = np.eye(NUM_AXES)
            slope[:, _places(len(names))[source]] = -adjoint(T)
            residual = _twist_between(T, constraint.pose)
            innovation = slope @ self.covariance @ slope.T + np.diag(variances)
            if compared is None:
                compared = _compared(constraint, T, residual, innovation, degrees_of_freedom)
                if not compared.is_kept:
                    return compared
            filtering = np.linalg.solve(innovation, slope @ self.covariance).T
            twists = filtering @ (slope @ twists - residual)
            poses = {
                name: apply_twist(self.poses[name], twists[place])
                for name, place in zip(names, _places(len(names)), strict=True)
            }
        assert compared is not None
        left = np.eye(len(twists)) - filtering @ slope
        self.poses, self.gain = poses, left @ self.gain
        self.of_constraints = left @ self.of_constraints @ left.T + (filtering * variances) @ filtering.T
        # Joseph's form, which stays positive.
        self.covariance = left @ self.covariance @ left.T + (filtering * variances) @ filtering.T
        return compared


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
    uncertainties = [
        calibration.uncertainty for calibration in used.values() if calibration.uncertainty is not None
    ]
    degrees = np.array([dof for uncertainty in uncertainties for dof in uncertainty.degrees_of_freedom])
    num_alike = _num_alike(used, constraints)
    state, compared = _State.of(used, num_alike), []
    for constraint in constraints:
        if {constraint.to, constraint.source} <= used.keys():
            of_both = [used[name].uncertainty for name in (constraint.to, constraint.source)]
            fewest = min(min(each.degrees_of_freedom) for each in of_both if each is not None)
            compared.append(state.take_in(constraint, fewest))
    of_cameras, of_intrinsics = np.zeros(len(degrees)), np.zeros_like(state.covariance)
    for name, place, uncertainty in zip(used, _places(len(used)), uncertainties, strict=True):
        of_cameras[place] = num_alike[name] * np.diag(uncertainty.covariance)
        if uncertainty.covariance_of_intrinsics is not None:
            of_intrinsics[place, place] = uncertainty.covariance_of_intrinsics
    of_intrinsics = state.gain @ of_intrinsics @ state.gain.T
    # Satterthwaite's degrees of freedom of the sum of what cameras add to an axis; constraints have infinitely many.
    parts = state.gain**2 * of_cameras
    whole = parts.sum(axis=1) + np.diag(state.of_constraints)
    freedom = whole**2 / (parts**2 / degrees).sum(axis=1)
    found = {}
    for name, place, own in zip(used, _places(len(used)), uncertainties, strict=True):
        T, covariance, part = state.poses[name], state.covariance[place, place], of_intrinsics[place, place]
        changes = {"covariance_of_intrinsics": _rows(0.5 * (part + part.T)) if part.any() else None}
        if own.twist_by_intrinsics is not None:
            changes["twist_by_intrinsics"] = _rows(
                state.gain[place, place] @ np.array(own.twist_by_intrinsics)
            )
        uncertainty = Uncertainty.from_covariance(T, 0.5 * (covariance + covariance.T), freedom[place])
        found[name] = T, uncertainty.model_copy(update=changes)
    together = Adjustment(
        cameras=tuple(used), covariance=_rows(state.covariance), constraints=tuple(compared)
    )
    return together, found


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
    quality = calibration.quality.model_copy(
        update={
            "mutual_information_nats": agreement.mutual_information,
            "bias_nats": agreement.bias,
            "label_agreement": agreement.label_agreement,
            "overlap": agreement.overlap,
            "num_points": agreement.num_inside - agreement.num_hidden,
            "turn_loss": observations.turn_loss(T),
        }
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


def _num_alike(
    cameras: Mapping[str, CalibrationDocument], constraints: Sequence[Constraint]
) -> dict[str, int]:
    """Count the cameras that constraints connect with each and that may share its errors, itself included."""
    pairs = [[constraint.to, constraint.source] for constraint in constraints]
    groups = merge_overlapping(
        (names, set[Hashable](names))
        for names in [*([name] for name in cameras), *pairs]
        if {*names} <= cameras.keys()
    )
    counts = dict.fromkeys(cameras, 1)
    for names, _ in groups:
        sharing = {name for name in names if "cues" in cameras[name].settings.options}
        counts |= dict.fromkeys(sharing, len(sharing))
    return counts


def _rows(matrix: Matrix) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))


def _places(count: int) -> list[slice]:
    """Return the rows of each camera."""
    return [slice(NUM_AXES * index, NUM_AXES * (index + 1)) for index in range(count)]


def _twist_between(T: Pose, T_stated: Pose) -> TwistVector:
    """Compute the twist (6,), to first order, on the left of a stated transform that gives another one."""
    return np.concatenate([(T @ inverse(T_stated))[:3, 3], rotation_difference(T, T_stated)])


def _compared(
    constraint: Constraint, T: Pose, residual: Numbers, innovation: Matrix, degrees_of_freedom: float
) -> ComparedConstraint:
    """Compare a constraint with the transform (4, 4) of the cameras, and the residual with its covariance (6, 6)."""
    error = compare_poses(T, constraint.pose)
    # With few parts of the images, chance explains almost any distance, so the distance is limited as well.
    by_chance = joint_quantile(LIMITS["prior"]["chance"].value, degrees_of_freedom)
    return ComparedConstraint(
        to=constraint.to,
        source=constraint.source,
        rotation_deg=error.rotation_deg,
        distance_m=error.camera_center_m,
        chi_square=float(residual @ np.linalg.solve(innovation, residual)),
        largest=min(by_chance, NUM_AXES * LIMITS["prior"]["one axis"].value ** 2),
    )
