"""How sure a pose is, in six degrees of freedom."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from semcal_cli import _core
from semcal_cli.files.validation import StrictModel, Vector6, Width, Widths, length
from semcal_cli.geometry.poses import Pose, cross_matrix

WEAK_M = 0.03
"""Half a 95 % interval of the camera's place beyond which a direction is called weak."""
WEAK_DEG = 0.15
"""Half a 95 % interval of the camera's rotation beyond which a direction is called weak."""

AXES = ("sideways", "up and down", "along the optical axis")
ROTATIONS = ("in pitch", "in yaw", "in roll")


class LabelBleed(StrictModel):
    """How far the pose would move if the labels of all pictures bled by a pixel: more frames do not cure that."""

    camera_center_m: Widths
    """Movement of the camera's place, along its axes."""
    rotation_deg: Widths
    """Rotation about the camera's axes."""


class Uncertainty(StrictModel):
    """How sure the pose is: of a twist xi = (rho, phi) in the camera frame, exp(xi) T_camera_lidar."""

    covariance: Annotated[tuple[Vector6, ...], length(6, 6)]
    """Covariance of xi, metres and radians."""
    degrees_of_freedom: Annotated[tuple[Width, ...], length(6, 6)]
    """Degrees of freedom of Student's t, for each of xi: how many independent parts of the pictures tell of it."""
    sigma_camera_center_m: Widths
    """Standard errors of the camera's place, along its axes."""
    sigma_translation_m: Widths
    """Standard errors of translation_m, which a rotation about the camera changes as well."""
    sigma_rotation_deg: Widths
    """Standard errors of the rotation, about the camera's axes."""
    half_width_95_camera_center_m: Widths
    """Half widths of the 95 % intervals of the camera's place, along its axes, by Student's t."""
    half_width_95_rotation_deg: Widths
    """Half widths of the 95 % intervals of the rotation, about the camera's axes, by Student's t."""
    weak_directions: Annotated[tuple[str, ...], length(0)] = ()
    """Sentences about directions that the data hardly determine."""
    label_bleed: LabelBleed | None = None
    """What bleeding labels would do; null where it cannot be told."""

    @classmethod
    def from_covariance(
        cls, T_camera_lidar: Pose, covariance: NDArray[np.float64], degrees_of_freedom: NDArray[np.float64]
    ) -> "Uncertainty":
        """Derive standard errors and intervals.

        Args:
            T_camera_lidar: (4, 4), the pose that xi is on the left of.
            covariance: (6, 6) of xi, metres and radians, along the camera's axes.
            degrees_of_freedom: (6,) of Student's t for each of xi.
        """
        sigmas = np.sqrt(np.diag(covariance))
        sigma_rotation_deg = np.degrees(sigmas[3:])
        # The translation of exp(xi) T is t + rho + phi x t, to first order.
        jacobian = np.hstack([np.eye(3), -cross_matrix(T_camera_lidar[:3, 3])])
        quantiles = [_core.student_quantile(0.975, dof) for dof in degrees_of_freedom]
        half_widths = (np.concatenate([sigmas[:3], sigma_rotation_deg]) * quantiles).tolist()
        return cls(
            covariance=covariance.tolist(),
            degrees_of_freedom=degrees_of_freedom.tolist(),
            sigma_camera_center_m=sigmas[:3].tolist(),
            sigma_translation_m=np.sqrt(np.diag(jacobian @ covariance @ jacobian.T)).tolist(),
            sigma_rotation_deg=sigma_rotation_deg.tolist(),
            half_width_95_camera_center_m=half_widths[:3],
            half_width_95_rotation_deg=half_widths[3:],
            weak_directions=_weak_directions(half_widths),
        )

    @property
    def half_widths(self) -> tuple[float, ...]:
        """Half widths (6,) of the 95 % intervals: metres of the camera's place, degrees of its rotation."""
        return (*self.half_width_95_camera_center_m, *self.half_width_95_rotation_deg)


def wide_directions(
    half_widths: Sequence[float], center_m: float, rotation_deg: float
) -> tuple[list[tuple[str, float]], list[tuple[str, float]]]:
    """Name the directions of place and of rotation whose half intervals (6,) are longer than a limit, with these."""
    center = zip(AXES, half_widths[:3], strict=True)
    rotation = zip(ROTATIONS, half_widths[3:], strict=True)
    return [pair for pair in center if pair[1] > center_m], [p for p in rotation if p[1] > rotation_deg]


def _weak_directions(half_widths: Sequence[float]) -> tuple[str, ...]:
    center, rotation = wide_directions(half_widths, WEAK_M, WEAK_DEG)
    return (
        *(f"{name}: +- {100.0 * half:.1f} cm; add frames with near objects" for name, half in center),
        *(f"{name}: +- {half:.2f} degrees; add frames" for name, half in rotation),
    )
