"""Calibration of a rig: the calibrations of its cameras, and the transform between each pair of cameras.

    T_a_b = T_a_lidar T_b_lidar^-1

With errors xi_a and xi_b on the left of the two transforms, to first order

    exp(xi_a) T_a_lidar (exp(xi_b) T_b_lidar)^-1 = exp(xi_a - Ad(T_a_b) xi_b) T_a_b

The covariance is the sum of that of xi_a and that of xi_b, mapped by the adjoint of T_a_b (Barfoot, *State Estimation
for Robotics*, 2017, section 7.3). The two errors are taken as independent unless constraints tie the cameras
(`adjustment`). Cameras that see the same points share errors of the point labels, which partly cancel, so that the
covariance is too large rather than too small.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import PoseError, compare_poses, inverse, quaternion_xyzw
from semcal_cli.geometry.twists import adjoint
from semcal_cli.many.rig.adjustment import Adjustment, ComparedConstraint
from semcal_cli.many.rig.rig_document import Rig
from semcal_cli.readable import figure, lengths
from semcal_cli.result.calibration_document import CalibrationDocument, Status
from semcal_cli.result.provenance import versions
from semcal_cli.result.uncertainty import Uncertainty

WORST_FIRST: tuple[Status, ...] = ("not_trusted", "not_assessed", "trusted")


@dataclass(frozen=True)
class Reference:
    """Reference transform between two cameras."""

    T_a_b: Pose
    """(4, 4), p_a = T_a_b p_b, metres."""
    source: str
    """Where it comes from."""


@dataclass(frozen=True)
class CameraPair:
    """Transform between two cameras of a rig."""

    a: str
    b: str
    T_a_b: Pose
    """(4, 4), p_a = T_a_b p_b, metres."""
    uncertainty: Uncertainty | None
    """Uncertainty of T_a_b, for a twist on its left in the frame of a; None if that of either camera is unknown."""
    reference: Reference | None
    """Reference transform, if there is one."""
    is_doubted: bool = False
    """Whether either camera is not trusted."""

    @property
    def believed_uncertainty(self) -> Uncertainty | None:
        """Uncertainty to show; None if either camera is not trusted."""
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
        distance = f"{lengths([self.error.camera_center_m])} and {figure(self.error.rotation_deg)} degrees"
        return f"{distance} from {self.reference.source}"

    @property
    def is_explained(self) -> bool | None:
        """Whether the joint 95 % region of all six axes contains the reference.

        None without a reference, if the region is unknown, or if either camera is not trusted.
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


@dataclass(frozen=True)
class RigCalibration:
    """Calibrations of the cameras of a rig, and of its pairs of cameras."""

    cameras: Mapping[str, CalibrationDocument]
    """Calibration of each camera that has one."""
    failures: Mapping[str, str]
    """Error of each camera that has no calibration."""
    pairs: tuple[CameraPair, ...]
    """Transform between each two cameras."""
    num_sweeps: int
    """Number of different clouds that were read."""
    adjustment: Adjustment | None = None
    """What all cameras and the constraints between them say together; None without constraints."""

    @property
    def contradictions(self) -> tuple[ComparedConstraint, ...]:
        """Constraints that the cameras contradict."""
        compared = () if self.adjustment is None else self.adjustment.constraints
        return tuple(constraint for constraint in compared if not constraint.is_kept)

    @property
    def status(self) -> str:
        """The worst status of all cameras: `failed`, or that of a calibration; `not_trusted` by a wrong constraint."""
        if self.failures:
            return "failed"
        statuses = [calibration.status for calibration in self.cameras.values()]
        return min([*statuses, *(["not_trusted"] if self.contradictions else [])], key=WORST_FIRST.index)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Findings and errors of all cameras, each preceded by the camera's name, and constraints that are wrong."""
        return (
            *(constraint.reason for constraint in self.contradictions),
            *(f"{name}: {reason}" for name, reason in self.failures.items()),
            *(
                f"{name}: {reason}"
                for name, calibration in self.cameras.items()
                for reason in calibration.reasons
            ),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that the user should read and that do not affect the verdict."""
        notes = []
        for pair in self.pairs:
            if pair.is_explained is False and pair.error is not None and pair.reference is not None:
                distance = f"{pair.error.camera_center_cm:.2f} cm and {pair.error.rotation_deg:.3f} deg"
                notes.append(
                    f"T_{pair.a}_{pair.b} is {distance} from {pair.reference.source}, more than chance explains"
                )
        skipped = () if self.adjustment is None else self.adjustment.skipped
        notes += [
            f"the constraint of {to} and {source} was not used: one has no trusted pose"
            for to, source in skipped
        ]
        return tuple(notes)


def combine(
    rig: Rig,
    drives: Mapping[str, Drive],
    cameras: Mapping[str, CalibrationDocument],
    failures: Mapping[str, str],
    num_sweeps: int,
    adjustment: Adjustment | None = None,
) -> RigCalibration:
    """Combine the calibrations of a rig's cameras, and compare each pair with the reference of the rig or the drives.

    Args:
        rig: The rig.
        drives: Drive of each camera.
        cameras: Calibration of each camera that has one.
        failures: Error of each camera that has no calibration.
        num_sweeps: Number of different clouds that were read.
        adjustment: What all cameras and constraints say together, which the calibrations follow already.
    """
    pairs = []
    for a, b in combinations(cameras, 2):
        reference, T_a, T_b = None, drives[a].T_camera_lidar, drives[b].T_camera_lidar
        if (T_a_b := rig.reference(a, b)) is not None:
            reference = Reference(T_a_b, rig.path.name)
        elif T_a is not None and T_b is not None:
            reference = Reference(np.array(T_a) @ inverse(np.array(T_b)), "T_camera_lidar of both drives")
        of_both = None if adjustment is None else adjustment.covariance_of(a, b)
        pairs.append(make_pair(a, cameras[a], b, cameras[b], reference, of_both))
    return RigCalibration(cameras, failures, tuple(pairs), num_sweeps, adjustment)


def make_pair(
    a: str,
    calibration_a: CalibrationDocument,
    b: str,
    calibration_b: CalibrationDocument,
    reference: Reference | None = None,
    covariance_of_both: Matrix | None = None,
) -> CameraPair:
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
        # Satterthwaite's degrees of freedom of the sum of the variances that both cameras contribute to an axis.
        variances = np.hstack([np.diag(np.diag(covariance_a)), Ad**2 * np.diag(covariance_b)])
        degrees = np.array([*uncertainty_a.degrees_of_freedom, *uncertainty_b.degrees_of_freedom])
        degrees_of_freedom = variances.sum(axis=1) ** 2 / (variances**2 / degrees).sum(axis=1)
        covariance = covariance_a + Ad @ covariance_b @ Ad.T
        if covariance_of_both is not None:
            slope = np.hstack([np.eye(6), -Ad])
            covariance = slope @ covariance_of_both @ slope.T
        uncertainty = Uncertainty.from_covariance(T_a_b, covariance, degrees_of_freedom)
    is_doubted = "not_trusted" in (calibration_a.status, calibration_b.status)
    return CameraPair(a, b, T_a_b, uncertainty, reference, is_doubted)


def describe_rig(
    rig: RigCalibration, files: Mapping[str, str], source: str, hashes: Mapping[str, str]
) -> dict[str, Any]:
    """Make the document of a rig's calibration.

    Args:
        rig: Calibrations of the rig.
        files: File of each camera's calibration, relative to this document.
        source: The rig.yaml, relative to this document.
        hashes: SHA-256 of the rig.yaml and of the drive.yaml of each camera.
    """
    cameras: dict[str, Any] = {
        name: {"status": "failed", "reasons": [reason]} for name, reason in rig.failures.items()
    }
    for name, calibration in rig.cameras.items():
        cameras[name] = {
            "status": calibration.status,
            "reasons": list(calibration.reasons),
            "calibration": files[name],
            "T_camera_lidar": calibration.rows_camera_lidar,
        }
    return {
        "semcal_rig_calibration": 1,
        "status": rig.status,
        "reasons": list(rig.reasons),
        "notes": list(rig.notes),
        "cameras": cameras,
        "pairs": [pair.describe() for pair in rig.pairs],
        **({} if rig.adjustment is None else {"adjustment": rig.adjustment.model_dump()}),
        "num_sweeps": rig.num_sweeps,
        "input": {"rig": source, "sha256": dict(hashes)},
        "versions": versions(),
    }
