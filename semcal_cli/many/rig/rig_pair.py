"""The transform between two sensors of a rig, its uncertainty, and its difference from a reference.

    T_a_b = T_a_lidar T_b_lidar^-1

With errors xi_a and xi_b on the left of the two transforms, to first order

    exp(xi_a) T_a_lidar (exp(xi_b) T_b_lidar)^-1 = exp(xi_a - Ad(T_a_b) xi_b) T_a_b

The covariance is the sum of that of xi_a and that of xi_b, mapped by the adjoint of T_a_b (Barfoot, *State Estimation
for Robotics*, 2017, section 7.3). The two errors are taken as independent unless ties join the sensors (`adjustment`).
Cameras that see the same points share errors of the point labels, which partly cancel, so that the covariance is too
large rather than too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.geometry.arrays import Matrix, Numbers, Pose
from semcal_cli.geometry.poses import PoseError, compare_poses, inverse, quaternion_xyzw
from semcal_cli.geometry.twists import adjoint
from semcal_cli.many.rig.rig_document import FIRST_LIDAR
from semcal_cli.many.rig.rig_uncertainty import AdjustedSensor
from semcal_cli.readable import figure, lengths
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.uncertainty import Uncertainty, intervals


@dataclass(frozen=True)
class Reference:
    """Reference transform between two sensors."""

    T_a_b: Pose
    """(4, 4), p_a = T_a_b p_b, metres."""
    source: str
    """Where it comes from."""


@dataclass(frozen=True)
class RigPair:
    """Transform between two sensors of a rig."""

    a: str
    b: str
    T_a_b: Pose
    """(4, 4), p_a = T_a_b p_b, metres."""
    uncertainty: Uncertainty | None
    """Uncertainty of T_a_b, for a twist on its left in the frame of a; None if that of either sensor is unknown."""
    reference: Reference | None
    """Reference transform, if there is one."""
    is_doubted: bool = False
    """Whether either sensor is not trusted."""

    @property
    def believed_uncertainty(self) -> Uncertainty | None:
        """Uncertainty to show; None if either sensor is not trusted."""
        return None if self.is_doubted else self.uncertainty

    @property
    def error(self) -> PoseError | None:
        """Error against the reference: the position of a in the frame of b, and its rotation."""
        return None if self.reference is None else compare_poses(self.T_a_b, self.reference.T_a_b)

    @property
    def distance(self) -> str:
        """Distance from the reference in words; empty without one."""
        if self.error is None or self.reference is None:
            return ""
        distance = f"{lengths([self.error.camera_center_m])} and {figure(self.error.rotation_deg)} degrees"
        return f"{distance} from {self.reference.source}"

    @property
    def intervals(self) -> tuple[str, str]:
        """Intervals of the position and of the rotation in words; empty without a believed uncertainty."""
        if self.believed_uncertainty is None:
            return "", ""
        position, rotation = intervals(self.believed_uncertainty.half_widths)
        # Only the axes of a camera are those of its pitch, yaw and roll.
        return position, rotation if self.a != FIRST_LIDAR else rotation.replace(
            "pitch yaw roll", "about x y z"
        )

    @property
    def is_explained(self) -> bool | None:
        """Whether the joint 95 % region of all six axes contains the reference.

        None without a reference, if the region is unknown, or if either sensor is not trusted.
        """
        uncertainty = self.believed_uncertainty
        if self.error is None or uncertainty is None:
            return None
        # A translation rho moves the camera centre in the opposite direction.
        center_m = [-x for x in self.error.camera_center_xyz_m]
        offset = np.array([*center_m, *self.error.rotation_xyz_rad])
        squared = float(offset @ np.linalg.solve(np.array(uncertainty.covariance), offset))
        return squared <= joint_quantile(0.05, min(uncertainty.degrees_of_freedom))

    def describe(self) -> dict[str, Any]:
        """Make the entry of the pair in the document of a rig; the camera centre is that of a in the frame of b."""
        reference, excluded = None, {"weak_directions", "label_bleed", "intrinsics_cost"}
        if self.reference is not None and self.error is not None:
            reference = {
                "source": self.reference.source,
                "T_a_b": self.reference.T_a_b.tolist(),
                **self.error.describe(),
                "is_explained": self.is_explained,
            }
        return {
            "a": self.a,
            "b": self.b,
            "T_a_b": self.T_a_b.tolist(),
            "translation_m": self.T_a_b[:3, 3].tolist(),
            "quaternion_xyzw": quaternion_xyzw(self.T_a_b).tolist(),
            "uncertainty": None
            if self.uncertainty is None
            else self.uncertainty.model_dump(exclude=excluded),
            "reference": reference,
        }


def make_pair(
    a: str,
    calibration_a: CalibrationDocument,
    b: str,
    calibration_b: CalibrationDocument,
    reference: Reference | None = None,
    covariance_of_both: Matrix | None = None,
) -> RigPair:
    """Compute the transform between two cameras and its uncertainty.

    Args:
        a: Name of the first camera.
        calibration_a: CalibrationDocument of the first camera.
        b: Name of the second camera.
        calibration_b: CalibrationDocument of the second camera.
        reference: Reference transform to compare with.
        covariance_of_both: (12, 12) covariance of the twists of a and b; None if they are independent.
    """
    T_a_b = calibration_a.pose @ inverse(calibration_b.pose)
    uncertainty, uncertainty_a, uncertainty_b = None, calibration_a.uncertainty, calibration_b.uncertainty
    if uncertainty_a is not None and uncertainty_b is not None:
        covariance_a, covariance_b = np.array(uncertainty_a.covariance), np.array(uncertainty_b.covariance)
        Ad = adjoint(T_a_b)
        degrees_of_freedom = _degrees_of_freedom(
            np.hstack([np.diag(np.diag(covariance_a)), Ad**2 * np.diag(covariance_b)]),
            np.array([*uncertainty_a.degrees_of_freedom, *uncertainty_b.degrees_of_freedom]),
        )
        covariance = covariance_a + Ad @ covariance_b @ Ad.T
        if covariance_of_both is not None:
            slope = np.hstack([np.eye(6), -Ad])
            covariance = slope @ covariance_of_both @ slope.T
        uncertainty = Uncertainty.from_covariance(T_a_b, covariance, degrees_of_freedom)
    is_doubted = "not_trusted" in (calibration_a.status, calibration_b.status)
    return RigPair(a, b, T_a_b, uncertainty, reference, is_doubted)


def from_first_lidar(name: str, sensor: AdjustedSensor, reference: Reference | None) -> RigPair:
    """Compute the transform T_lidar_sensor from a sensor to the first LiDAR, whose own pose is exact.

    Args:
        name: Name of the sensor.
        sensor: Its pose and uncertainty.
        reference: Reference transform to compare with.
    """
    T_lidar_sensor, covariance = inverse(sensor.pose), np.array(sensor.uncertainty.covariance)
    Ad = adjoint(T_lidar_sensor)
    degrees = _degrees_of_freedom(
        Ad**2 * np.diag(covariance), np.array(sensor.uncertainty.degrees_of_freedom)
    )
    uncertainty = Uncertainty.from_covariance(T_lidar_sensor, Ad @ covariance @ Ad.T, degrees)
    return RigPair(FIRST_LIDAR, name, T_lidar_sensor, uncertainty, reference)


def _degrees_of_freedom(variances: Matrix, degrees: Numbers) -> Numbers:
    """Compute Satterthwaite's degrees of freedom (6,) of sums of variances.

    Args:
        variances: (6, n) what each of n estimates adds to the variance of each axis.
        degrees: (n,) their degrees of freedom.
    """
    return np.asarray(variances.sum(axis=1) ** 2 / (variances**2 / degrees).sum(axis=1))
