"""Transform between two cameras of a rig, from the transforms between each camera and the LiDAR.

    T_a_b = T_a_lidar T_b_lidar^-1

With errors xi_a and xi_b on the left of the two transforms, to first order

    exp(xi_a) T_a_lidar (exp(xi_b) T_b_lidar)^-1 = exp(xi_a - Ad(T_a_b) xi_b) T_a_b

The covariance is the sum of that of xi_a and that of xi_b, mapped by the adjoint of T_a_b (Barfoot, *State Estimation
for Robotics*, 2017, section 7.3). The two errors are taken as independent. Cameras that look at the same points share
errors of the point labels, which partly cancel, so the covariance is rather too large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semcal_cli.assessment.limits import joint_quantile
from semcal_cli.geometry.pose_error import PoseError, compare_poses
from semcal_cli.geometry.poses import Pose, inverse
from semcal_cli.geometry.twists import adjoint
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.uncertainty import Uncertainty


@dataclass(frozen=True)
class Reference:
    """Reference transform between two cameras."""

    T_a_b: Pose
    """(4, 4), p_a = T_a_b p_b, metres."""
    source: str
    """Name of its source."""


@dataclass(frozen=True)
class Pair:
    """Transform between two cameras of a rig."""

    a: str
    b: str
    T_a_b: Pose
    """(4, 4), p_a = T_a_b p_b, metres."""
    uncertainty: Uncertainty | None
    """Uncertainty of T_a_b, for a twist on its left in the frame of a; None if that of a camera is unknown."""
    reference: Reference | None
    """Reference transform, if there is one."""
    is_doubted: bool = False
    """Whether a camera is not trusted."""

    @property
    def believed_uncertainty(self) -> Uncertainty | None:
        """Uncertainty as people are shown it: none if a camera is not trusted."""
        return None if self.is_doubted else self.uncertainty

    @property
    def error(self) -> PoseError | None:
        """Error against the reference: the position of camera a in the frame of b, and its rotation."""
        return None if self.reference is None else compare_poses(self.T_a_b, self.reference.T_a_b)

    @property
    def distance(self) -> str:
        """Distance from the reference in words; empty without one."""
        if self.error is None or self.reference is None:
            return ""
        off = f"{10.0 * self.error.camera_center_cm:.1f} mm and {self.error.rotation_deg:.3f} degrees"
        return f"{off} from {self.reference.source}"

    @property
    def is_explained(self) -> bool | None:
        """Whether the 95 % region of all six axes together contains the reference.

        None without a reference, and if the region is not known or a camera is not trusted.
        """
        if self.error is None or self.believed_uncertainty is None:
            return None
        # A translation rho moves the camera's centre in the opposite direction.
        off = np.array([-0.01 * x for x in self.error.camera_center_xyz_cm] + [*self.error.rotation_xyz_deg])
        off[3:] = np.radians(off[3:])
        known = self.believed_uncertainty
        squared = float(off @ np.linalg.solve(np.array(known.covariance), off))
        return squared <= joint_quantile(0.05, min(known.degrees_of_freedom))


def make_pair(
    a: str, of_a: Calibration, b: str, of_b: Calibration, reference: Reference | None = None
) -> Pair:
    """Compute the transform between two cameras and its uncertainty.

    Args:
        a: Name of the first camera.
        of_a: Calibration of the first camera.
        b: Name of the second camera.
        of_b: Calibration of the second camera.
        reference: Reference transform to compare with.
    """
    T_a_b = of_a.pose @ inverse(of_b.pose)
    uncertainty = None
    if of_a.uncertainty is not None and of_b.uncertainty is not None:
        covariance_a, covariance_b = (
            np.array(of_a.uncertainty.covariance),
            np.array(of_b.uncertainty.covariance),
        )
        Ad = adjoint(T_a_b)
        # Satterthwaite's degrees of freedom of the sum of the variances that both cameras contribute to an axis.
        parts = np.hstack([np.diag(np.diag(covariance_a)), Ad**2 * np.diag(covariance_b)])
        known = np.array([*of_a.uncertainty.degrees_of_freedom, *of_b.uncertainty.degrees_of_freedom])
        degrees_of_freedom = parts.sum(axis=1) ** 2 / (parts**2 / known).sum(axis=1)
        covariance = covariance_a + Ad @ covariance_b @ Ad.T
        uncertainty = Uncertainty.from_covariance(T_a_b, covariance, degrees_of_freedom)
    is_doubted = "not_trusted" in (of_a.status, of_b.status)
    return Pair(a, b, T_a_b, uncertainty, reference, is_doubted)
