"""Offsets and 95 % intervals of a pose in words: along and about the axes of its camera, and in the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.result.uncertainty import NORMAL_95, Uncertainty

PLACES = "camera to the right (x)", "camera down (y)", "camera forward (z)"
"""Offsets of the camera's centre along its axes."""
TURNS = "pitch, looks down (about x)", "yaw, looks left (about y)", "roll, leans left (about z)"
"""Offsets of the rotation about them. A positive angle turns what the camera sees, as a twist on the left of
T_camera_lidar does, so that the camera itself turns the other way."""
AXIS_NAMES = *PLACES, *TURNS
CHECK_NAMES = dict(
    zip(
        (*(f"camera centre {axis}" for axis in "xyz"), *(f"rotation {axis}" for axis in "xyz")),
        AXIS_NAMES,
        strict=True,
    )
) | {"clock": "pictures later (clock)"}
"""The same by the names of checks."""

AHEAD_M = 10.0
"""Depth at which the error is stated in pixels."""
STEP = 1e-4
ELLIPSE_95 = 2.447747
"""Standard errors that contain 95 % of a normal distribution in two dimensions: root of the chi-square quantile."""


def intervals(half_widths: Sequence[float]) -> tuple[str, str]:
    """Tell the intervals of the camera's place along x, y and z, and of pitch, yaw and roll.

    Args:
        half_widths: (6,), metres and degrees.
    """
    center, rotation = [1000.0 * half for half in half_widths[:3]], half_widths[3:]
    return (
        f"x y z +- {' '.join(f'{half:.1f}' for half in center)} mm",
        f"pitch yaw roll +- {' '.join(f'{half:.3f}' for half in rotation)} degrees",
    )


def widest(half_widths: Sequence[float]) -> str:
    """Tell the widest of the intervals (6,), metres and degrees, of the place and of the rotation."""
    center_mm, rotation_deg = 1000.0 * max(half_widths[:3]), max(half_widths[3:])
    return f"+- {center_mm:.1f} mm, +- {rotation_deg:.3f} degrees (95 %)"


def stated_error(uncertainty: Uncertainty, camera: Camera) -> str:
    """State the widest 95 % intervals of a pose, what errors of K are of them, and what they are straight ahead."""
    radius_px = image_radius_px(uncertainty, camera, AHEAD_M)
    in_image = "" if radius_px is None else f", {figure(radius_px)} px at {AHEAD_M:g} m"
    of_intrinsics, of_K = uncertainty.half_widths_of_intrinsics.tolist(), ""
    if any(of_intrinsics):
        center_mm, rotation_deg = 1000.0 * max(of_intrinsics[:3]), max(of_intrinsics[3:])
        of_K = f", of which K {center_mm:.1f} mm, {rotation_deg:.3f} degrees"
    return widest(uncertainty.half_widths) + of_K + in_image


def image_radius_px(uncertainty: Uncertainty, camera: Camera, depth_m: float) -> float | None:
    """Compute how far a point straight ahead may land from its place: longest half axis of its 95 % ellipse.

    It is of first order in the twist.

    Args:
        uncertainty: Uncertainty of the pose.
        camera: The camera.
        depth_m: Distance of the point, on the optical axis.

    Returns:
        Pixels; None for a lens that does not show its optical axis.
    """
    covariance = np.array(uncertainty.covariance)
    half_widths = np.array(
        [*uncertainty.half_width_95_camera_center_m, *np.radians(uncertainty.half_width_95_rotation_deg)]
    )
    sigmas = np.sqrt(np.diag(covariance))
    # The factor by which Student's t is wider than a normal distribution, at the axis where it is largest.
    wider = max(1.0, float((half_widths[sigmas > 0.0] / (NORMAL_95 * sigmas[sigmas > 0.0])).max(initial=1.0)))
    motions = _motions(camera, depth_m)
    if not np.isfinite(motions).all():
        return None
    scatter = motions @ covariance @ motions.T
    return ELLIPSE_95 * wider * math.sqrt(max(float(np.linalg.eigvalsh(scatter)[-1]), 0.0))


def _motions(camera: Camera, depth_m: float) -> npt.NDArray[np.float64]:
    """(2, 6) pixels by which a twist, in metres and radians, moves a point on the optical axis."""
    ahead = np.array([0.0, 0.0, depth_m])
    steps = STEP * depth_m * np.eye(3)
    ends = core_camera(camera).project(np.concatenate([ahead + steps, ahead - steps]))
    jacobian = (ends[:3] - ends[3:]).T / (2.0 * STEP * depth_m)
    # p moves by rho + phi x p.
    cross = np.array([[0.0, -depth_m, 0.0], [depth_m, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return np.asarray(np.hstack([jacobian, -jacobian @ cross]))


def figure(value: float) -> str:
    """Format a figure with two significant digits and without an exponent."""
    if value == 0.0:
        return "0"
    # The power of ten is that of the rounded figure: 0.0998 is 0.10.
    digits = max(0, 1 - math.floor(math.log10(abs(float(f"{value:.1e}")))))
    return f"{value:.{min(digits, 6)}f}"
