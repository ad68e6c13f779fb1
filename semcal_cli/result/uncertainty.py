"""Uncertainty of a pose in six degrees of freedom; and offsets and 95 % intervals in words."""

import math
from collections.abc import Sequence
from typing import Annotated, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from semcal_cli import core
from semcal_cli.drive.camera import Camera
from semcal_cli.errors import mismatch
from semcal_cli.files.validation import Figure, StrictModel, Width, Widths, length
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import cross_matrix
from semcal_cli.readable import figure, lengths
from semcal_cli.result.pixel_errors import PixelErrors, PixelMap, half_axes_px, summarise, uncertainty_maps

WEAK_M = 0.03
"""Half width of a 95 % interval of the camera's position, in metres, beyond which a direction is weak."""
WEAK_DEG = 0.15
"""Half width of a 95 % interval of the rotation, in degrees, beyond which a direction is weak."""

MAX_VARIANCE = 1e40
"""Largest entry of a covariance, in square metres and square radians: above any result, without overflow."""
COVARIANCE_TOLERANCE = 1e-6
"""Largest deviation from a symmetric, positive semidefinite matrix, relative to its largest entry: round-off."""

NORMAL_95 = 1.959964
"""Standard errors to either side that contain 95 % of a normal distribution."""

AXES = ("sideways", "up and down", "along the optical axis")
ROTATIONS = ("in pitch", "in yaw", "in roll")
PLACES = "camera to the right (x)", "camera down (y)", "camera forward (z)"
"""Offsets of the camera's centre along its axes."""
TURNS = "pitch, looks down (about x)", "yaw, looks left (about y)", "roll, leans left (about z)"
"""Offsets of the rotation about them. A positive angle turns what the camera sees, as a twist on the left of
T_camera_lidar does; the camera itself turns the other way."""
AXIS_NAMES = *PLACES, *TURNS
CHECK_NAMES = dict(
    zip(
        [f"{part} {axis}" for part in ("camera centre", "rotation") for axis in "xyz"],
        AXIS_NAMES,
        strict=True,
    )
) | {"clock": "images later (clock)"}
"""The same by the names of checks."""

AHEAD_M = 10.0
"""Depth at which the error is stated in pixels."""


def check_covariance(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """Check that a square matrix is symmetric and positive semidefinite, up to round-off.

    Raises:
        ValueError: it is not.
    """
    covariance = np.array(rows)
    tolerance = COVARIANCE_TOLERANCE * np.abs(covariance).max()
    if (skew := np.abs(covariance - covariance.T).max()) > tolerance:
        raise mismatch(f"entries that differ by {skew:.3g} across the diagonal", "a symmetric matrix")
    if (variance := np.diag(covariance).min()) < 0.0:
        raise mismatch(f"a variance of {variance:.3g}", "at least 0")
    if (smallest := np.linalg.eigvalsh(0.5 * (covariance + covariance.T)).min()) < -tolerance:
        raise mismatch(f"an eigenvalue of {smallest:.3g}", "a positive semidefinite matrix")
    return rows


Variance = Annotated[float, Field(ge=-MAX_VARIANCE, le=MAX_VARIANCE)]
CovarianceEntries: TypeAlias = Annotated[
    tuple[Annotated[tuple[Variance, ...], length(6, 6)], ...], length(6, 6)
]
Covariance: TypeAlias = Annotated[CovarianceEntries, AfterValidator(check_covariance)]


TwistRows: TypeAlias = tuple[Annotated[tuple[Figure, ...], length(4, 4)], ...]


class HasCovariances(Protocol):
    """A model with a covariance (6, 6) and its part by errors of the intrinsics."""

    @property
    def covariance(self) -> CovarianceEntries | None:
        """The whole."""

    @property
    def covariance_of_intrinsics(self) -> CovarianceEntries | None:
        """The part."""


Covariances = TypeVar("Covariances", bound=HasCovariances)


def check_part(covariances: Covariances) -> Covariances:
    """Check that the part of a covariance by errors of the intrinsics is no larger than the whole.

    Raises:
        ValueError: it is, or there is no whole.
    """
    whole, part = covariances.covariance, covariances.covariance_of_intrinsics
    if part is None:
        return covariances
    variances = np.zeros(6) if whole is None else np.diag(whole)
    if (np.diag(part) > variances + COVARIANCE_TOLERANCE * variances.max()).any():
        raise mismatch("a covariance_of_intrinsics that exceeds the covariance", "a part of it")
    return covariances


class PoseChange(StrictModel):
    """Absolute change of the pose."""

    camera_center_m: Widths
    """Absolute change of the camera's position along its axes, in metres."""
    rotation_deg: Widths
    """Absolute change of the rotation about the camera's axes, in degrees."""


class LabelBleed(PoseChange):
    """Change of the pose if labels bled by one pixel in all images. More frames do not reduce it."""


class IntrinsicsCost(StrictModel):
    """Changes of the pose by small errors of the intrinsics. More frames do not reduce them, because all share K."""

    fx: PoseChange
    """Change of the pose if fx were off by 0.1 %."""
    fy: PoseChange
    """Change of the pose if fy were off by 0.1 %."""
    cx: PoseChange
    """Change of the pose if cx were off by 1 pixel."""
    cy: PoseChange
    """Change of the pose if cy were off by 1 pixel."""

    @property
    def together(self) -> tuple[float, float]:
        """Change of the camera's position, in metres, and rotation, in degrees, by all four errors if independent."""
        changes = self.fx, self.fy, self.cx, self.cy
        center = np.linalg.norm([change.camera_center_m for change in changes])
        return float(center), float(np.linalg.norm([change.rotation_deg for change in changes]))


class Uncertainty(StrictModel):
    """Uncertainty of the pose, as that of a twist xi = (rho, phi) in the camera frame, exp(xi) T_camera_lidar."""

    covariance: Covariance
    """Covariance of xi, in metres and radians."""
    degrees_of_freedom: Annotated[tuple[Width, ...], length(6, 6)]
    """Degrees of freedom of Student's t for each component of xi: about the number of independent parts of the images
    that determine it."""
    sigma_camera_center_m: Widths
    """Standard errors of the camera's position along its axes, in metres."""
    sigma_translation_m: Widths
    """Standard errors of translation_m, in metres. A rotation about the camera changes translation_m as well."""
    sigma_rotation_deg: Widths
    """Standard errors of the rotation about the camera's axes, in degrees."""
    half_width_95_camera_center_m: Widths
    """Half widths of the 95 % intervals of the camera's position along its axes, in metres, by Student's t."""
    half_width_95_rotation_deg: Widths
    """Half widths of the 95 % intervals of the rotation about the camera's axes, in degrees, by Student's t."""
    weak_directions: Annotated[tuple[str, ...], length(0)] = ()
    """Sentences about directions that the data barely determine."""
    label_bleed: LabelBleed | None = None
    """Change of the pose by bleeding labels; null if it was not or could not be computed."""
    intrinsics_cost: IntrinsicsCost | None = None
    """Changes of the pose by small errors of the intrinsics; null if they were not or could not be computed."""
    covariance_of_intrinsics: Covariance | None = None
    """Part of the covariance that is due to errors of the intrinsics, which more frames do not reduce; null if they are
    exact, were estimated, or their effect could not be computed."""
    twist_by_intrinsics: Annotated[TwistRows, length(6, 6)] | None = None
    """Twist xi by an error of one standard deviation of fx, fy, cx and cy, in four columns; null like
    covariance_of_intrinsics. Absent in older files."""
    in_image: Annotated[tuple[PixelErrors, ...], length(0)] = ()
    """The same in the image, by the range of points. Absent in older files, and in the uncertainty of other transforms
    than that of a camera."""

    _check_part = model_validator(mode="after")(check_part)

    @model_validator(mode="after")
    def _check_twist(self) -> "Uncertainty":
        """Check that the twist by errors of the intrinsics explains no more than their part of the covariance."""
        part, twist = self.covariance_of_intrinsics, self._by_intrinsics
        if twist is None:
            return self
        if part is None:
            raise mismatch("a twist_by_intrinsics alone", "a covariance_of_intrinsics beside it")
        variances = np.diag(part)
        if ((twist**2).sum(axis=1) > variances + COVARIANCE_TOLERANCE * variances.max()).any():
            raise mismatch("a twist_by_intrinsics that exceeds the covariance_of_intrinsics", "a part of it")
        return self

    @classmethod
    def from_covariance(
        cls, T_camera_lidar: Pose, covariance: NDArray[np.float64], degrees_of_freedom: NDArray[np.float64]
    ) -> "Uncertainty":
        """Derive standard errors and intervals.

        Args:
            T_camera_lidar: (4, 4), metres; xi acts on its left.
            covariance: (6, 6) covariance of xi, metres and radians, along the camera's axes.
            degrees_of_freedom: (6,) degrees of freedom of Student's t for each component of xi.
        """
        sigmas = np.sqrt(np.diag(covariance))
        sigma_rotation_deg = np.degrees(sigmas[3:])
        # The translation of exp(xi) T is t + rho + phi x t, to first order.
        jacobian = np.hstack([np.eye(3), -cross_matrix(T_camera_lidar[:3, 3])])
        quantiles = [core.student_quantile(0.975, dof) for dof in degrees_of_freedom]
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
        """Half widths (6,) of the 95 % intervals: the camera's position in metres, then its rotation in degrees."""
        return (*self.half_width_95_camera_center_m, *self.half_width_95_rotation_deg)

    @property
    def widened_covariance(self) -> NDArray[np.float64]:
        """Covariance (6, 6) of a normal distribution whose intervals are at least as wide as those by Student's t.

        Errors of the intrinsics are normal already. What is estimated has fewer degrees of freedom without them
        (Satterthwaite).
        """
        whole, of_K = np.array(self.covariance), np.zeros((6, 6))
        if (twist := self._by_intrinsics) is not None:
            of_K = twist @ twist.T
        variances, estimated = np.diag(whole), np.diag(whole - of_K)
        is_known = (variances > 0.0) & (estimated > 0.0)
        share = estimated[is_known] / variances[is_known]
        freedom = np.maximum(np.array(self.degrees_of_freedom)[is_known] * share**2, 1.0)
        quantile = max((core.student_quantile(0.975, dof) for dof in freedom), default=NORMAL_95)
        return np.asarray((quantile / NORMAL_95) ** 2 * (whole - of_K) + of_K)

    def pixel_maps(self, camera: Camera) -> list[PixelMap]:
        """Map the half widths of the 95 % intervals over the image of the camera, in the worst direction."""
        return uncertainty_maps(camera, self.widened_covariance, self._by_intrinsics)

    def with_pixels(self, camera: Camera) -> "Uncertainty":
        """Add what it means in the image of the camera."""
        return self.model_copy(update={"in_image": summarise(self.pixel_maps(camera))})

    @property
    def _by_intrinsics(self) -> NDArray[np.float64] | None:
        return None if self.twist_by_intrinsics is None else np.array(self.twist_by_intrinsics)

    def half_width_ahead_px(self, camera: Camera) -> float:
        """Compute the half width of the 95 % interval, in pixels, of a point straight ahead at `AHEAD_M`.

        It is NaN for a lens that does not show its optical axis.
        """
        ahead = np.array([[0.0, 0.0, AHEAD_M]])
        (half_width_px,) = half_axes_px(camera, self.widened_covariance, ahead, self._by_intrinsics).tolist()
        return float(half_width_px)

    @property
    def half_widths_of_intrinsics(self) -> NDArray[np.float64]:
        """Half widths (6,) of the 95 % intervals by errors of the intrinsics alone, metres and degrees."""
        if self.covariance_of_intrinsics is None:
            return np.zeros(6)
        return normal_half_widths(np.array(self.covariance_of_intrinsics))


def normal_half_widths(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the half widths (6,) of the 95 % intervals of a known covariance (6, 6), metres and degrees."""
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return np.concatenate([NORMAL_95 * sigmas[:3], NORMAL_95 * np.degrees(sigmas[3:])])


def wide_directions(
    half_widths: Sequence[float], center_m: float, rotation_deg: float
) -> tuple[list[tuple[str, float]], list[tuple[str, float]]]:
    """Find the directions whose 95 % intervals are wider than a limit.

    Args:
        half_widths: (6,) half widths, metres and degrees.
        center_m: Limit for the camera's position.
        rotation_deg: Limit for the rotation.

    Returns:
        Names and half widths of the directions of position, and of those of rotation.
    """
    center = zip(AXES, half_widths[:3], strict=True)
    rotation = zip(ROTATIONS, half_widths[3:], strict=True)
    return [pair for pair in center if pair[1] > center_m], [p for p in rotation if p[1] > rotation_deg]


def _weak_directions(half_widths: Sequence[float]) -> tuple[str, ...]:
    center, rotation = wide_directions(half_widths, WEAK_M, WEAK_DEG)
    # Without figures: the widths also have parts that more frames do not reduce.
    shifts, turns = (" and ".join(name for name, _ in wide) for wide in (center, rotation))
    return (
        *([f"{shifts} (frames with nearby objects would help)"] if shifts else []),
        *([f"{turns} (more frames would help)"] if turns else []),
    )


def intervals(half_widths: Sequence[float]) -> tuple[str, str]:
    """Format the intervals of the camera's position along x, y and z, and of pitch, yaw and roll.

    Args:
        half_widths: (6,), metres and degrees.
    """
    return (
        f"x y z +- {lengths(half_widths[:3])}",
        f"pitch yaw roll +- {' '.join(map(figure, half_widths[3:]))} degrees",
    )


def widest(half_widths: Sequence[float]) -> str:
    """Format the widest of the intervals (6,), metres and degrees, of the position and of the rotation."""
    center_m, rotation_deg = max(half_widths[:3]), max(half_widths[3:])
    return f"+- {lengths([center_m])}, +- {figure(rotation_deg)} degrees (95 %)"


def stated_error(uncertainty: Uncertainty, camera: Camera) -> str:
    """Format the widest 95 % intervals of a pose, the part of them by errors of K, and the error straight ahead."""
    radius_px = uncertainty.half_width_ahead_px(camera)
    # A lens may not show its optical axis.
    in_image = f", or {figure(radius_px)} px at {AHEAD_M:g} m" if math.isfinite(radius_px) else ""
    half_widths, of_K = uncertainty.half_widths_of_intrinsics.tolist(), ""
    if any(half_widths):
        center_m, rotation_deg = max(half_widths[:3]), max(half_widths[3:])
        of_K = f"; errors of K account for {lengths([center_m])} and {figure(rotation_deg)} degrees"
    return widest(uncertainty.half_widths) + in_image + of_K
