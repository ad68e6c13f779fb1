"""Combination of the drives of one rig: their mean, the drives that disagree, the rig's changes, and a verdict.

Every drive is compared with the rig's pose at its time; the pose at the last drive is the current one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import Limits
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.fleet.consensus import ExtraScatter, extra_scatter, robust_mean
from semcal_cli.fleet.fleet_drives import FleetDrive
from semcal_cli.fleet.fleet_result import ComparedDrive, Fleet, Offset, RigPart
from semcal_cli.fleet.fleet_verdict import MIN_DRIVES, conclude, judge_fleet, notes
from semcal_cli.fleet.history import RigHistory, find_history
from semcal_cli.geometry.arrays import Matrices, Pose, Vectors
from semcal_cli.geometry.twists import local_coordinates, pose_at
from semcal_cli.many.chronology import Order, in_order
from semcal_cli.pipeline.verdict import together
from semcal_cli.result.uncertainty import normal_half_widths

ALPHA = 0.01
"""Probability that any drive of a consistent fleet is reported as disagreeing (Bonferroni)."""
DAY_S = 86_400.0


def combine_drives(drives: Sequence[FleetDrive], limits: Limits, T_reference: Pose | None = None) -> Fleet:
    """Combine the drives of one rig.

    Args:
        drives: The drives in any order; they are sorted by stamp, or by name if they have no stamps.
        limits: Largest allowed offsets of the drives, and changes of the rig.
        T_reference: T_camera_lidar (4, 4) that the rig should have.

    Raises:
        CalibrationError: no drive can be used.
    """
    usable, left_out = _split_usable(drives)
    usable, times, order = _sort_drives(usable)
    series = _make_series(usable, times)
    history = find_history(times, series.coordinates, series.covariances, series.degrees_of_freedom)
    T_now, covariance = pose_at(series.T_mean, history.expected[-1]), history.covariances[-1]
    compared = _compare_drives(usable, series, history, limits)
    parts = _describe_parts(usable, series, history)
    drift, from_reference = None, None
    if history.drift is not None:
        span = float(times[-1] - times[0])
        drift = series.offset(span * history.drift.per_unit, span**2 * history.drift.covariance)
    interval = Offset(np.zeros(6), series.half_widths(covariance))
    if T_reference is not None:
        (coordinates,) = local_coordinates([T_now], T_reference)
        from_reference = Offset(_along_axes(coordinates), interval.half_widths)
    checks = judge_fleet(interval, from_reference, parts, drift, limits)
    verdict, reasons = conclude(checks, compared, left_out, parts, drift)
    return Fleet(
        verdict,
        reasons,
        notes(usable),
        checks,
        T_now,
        covariance + series.covariance_of_intrinsics,
        _half_widths(np.diag(series.extra.variances), np.ones(6)),
        order,
        parts,
        drift,
        compared,
        left_out,
        limits,
    )


@dataclass(frozen=True)
class _Series:
    """Drives in chronological order, in local coordinates about their mean."""

    times: npt.NDArray[np.float64]
    T_mean: Pose
    """Mean of the drives, T_camera_lidar."""
    coordinates: Vectors
    covariances: Matrices
    """Stated covariances, with the extra scatter added."""
    extra: ExtraScatter
    factors: npt.NDArray[np.float64]
    """(6,) half widths of a 95 % interval, in standard errors, from Student's distribution."""
    covariance_of_intrinsics: npt.NDArray[np.float64]
    """(6, 6) mean covariance from errors of K, over the drives that state it. More drives do not reduce it."""

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the scatter, for the axis that has the fewest."""
        return float(self.extra.degrees_of_freedom.min())

    def offset(self, coordinates: npt.NDArray[np.float64], covariance: npt.NDArray[np.float64]) -> Offset:
        """Express local coordinates (6,) with their covariance (6, 6) as an offset of the camera."""
        return Offset(_along_axes(coordinates), _half_widths(covariance, self.factors))

    def half_widths(self, covariance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return half widths (6,) of a combined pose, from the scatter of the drives (6, 6) and from errors of K."""
        intrinsics_half_widths = normal_half_widths(self.covariance_of_intrinsics)
        return np.hypot(_half_widths(covariance, self.factors), intrinsics_half_widths)


def _along_axes(coordinates: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Convert local coordinates to offsets (..., 6), metres and degrees; rho moves the camera centre the other way."""
    return np.concatenate([-coordinates[..., :3], np.degrees(coordinates[..., 3:])], axis=-1)


def _half_widths(
    covariance: npt.NDArray[np.float64], factors: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Compute half widths (6,), metres and degrees: standard errors times factors (6,)."""
    sigmas = factors * np.sqrt(np.diag(covariance))
    return np.concatenate([sigmas[:3], np.degrees(sigmas[3:])])


def _split_usable(drives: Sequence[FleetDrive]) -> tuple[list[FleetDrive], tuple[FleetDrive, ...]]:
    """Separate the drives that can be used from those that are left out.

    Raises:
        CalibrationError: none can be used.
    """
    usable = [drive for drive in drives if drive.left_out is None]
    left_out = tuple(
        sorted((drive for drive in drives if drive.left_out is not None), key=lambda drive: drive.name)
    )
    if not usable:
        raise CalibrationError(
            f"found no usable drive among {len(drives):,}, needed {MIN_DRIVES}; the first, "
            f"{left_out[0].name}: {left_out[0].left_out}"
            if left_out
            else f"found no drives, needed {MIN_DRIVES}"
        )
    return usable, left_out


def _sort_drives(drives: list[FleetDrive]) -> tuple[list[FleetDrive], npt.NDArray[np.float64], Order]:
    """Sort drives by stamp, in days since the first, or by name if their stamps cannot be compared."""
    ordered, order = in_order(drives)
    if order == "name":
        return ordered, np.arange(len(drives), dtype=np.float64), order
    stamps = np.array([drive.stamp for drive in ordered])
    return ordered, (stamps - stamps[0]) / DAY_S, order


def _make_series(drives: Sequence[FleetDrive], times: npt.NDArray[np.float64]) -> _Series:
    """Compute the mean of the drives, their scatter, and the coordinates of each about the mean."""
    poses = [drive.T_camera_lidar for drive in drives if drive.T_camera_lidar is not None]
    stated_covariances = np.array([drive.covariance for drive in drives])
    T_mean = robust_mean(poses, stated_covariances).T_camera_lidar
    extra = extra_scatter(local_coordinates(poses, T_mean), stated_covariances)
    covariances = stated_covariances + np.diag(extra.variances)
    T_mean = robust_mean(poses, covariances).T_camera_lidar
    factors = np.array([core.student_quantile(0.975, dof) for dof in extra.degrees_of_freedom])
    shared_covariances = [
        drive.covariance_of_intrinsics for drive in drives if drive.covariance_of_intrinsics is not None
    ]
    covariance_of_intrinsics = np.mean(shared_covariances, axis=0) if shared_covariances else np.zeros((6, 6))
    coordinates = local_coordinates(poses, T_mean)
    return _Series(times, T_mean, coordinates, covariances, extra, factors, covariance_of_intrinsics)


def _compare_drives(
    drives: Sequence[FleetDrive], series: _Series, history: RigHistory, limits: Limits
) -> tuple[ComparedDrive, ...]:
    """Compare each drive with the rig's pose at its time."""
    deviations = series.coordinates - history.expected
    squared = np.einsum("ni,nij,nj->n", deviations, np.linalg.inv(series.covariances), deviations)
    disagrees = squared > joint_quantile(ALPHA / len(drives), series.degrees_of_freedom)
    parts = np.searchsorted(history.starts, np.arange(len(drives)), side="right") - 1
    expected = _along_axes(history.expected - history.expected[-1])
    compared = []
    for index, drive in enumerate(drives):
        offset = series.offset(deviations[index], series.covariances[index])
        checks = offset.judge(limits)
        compared.append(
            ComparedDrive(
                drive,
                float(series.times[index]),
                int(parts[index]),
                expected[index],
                offset,
                bool(disagrees[index]),
                is_far=any(abs(check.offset) > check.allowed for check in checks),
                verdict=together(check.verdict for check in checks),
            )
        )
    return tuple(compared)


def _describe_parts(
    drives: Sequence[FleetDrive], series: _Series, history: RigHistory
) -> tuple[RigPart, ...]:
    """Describe each period in which the rig did not change."""
    expected, covariances = history.expected, history.covariances

    def change(before: int, after: int) -> Offset:
        covariance = covariances[after] + covariances[before]
        return series.offset(expected[after] - expected[before], covariance)

    return tuple(
        RigPart(
            drives[begin].name,
            drives[end - 1].name,
            end - begin,
            pose_at(series.T_mean, expected[end - 1]),
            series.half_widths(covariances[end - 1]),
            change=change(begin - 1, begin) if number > 0 else None,
            overall_change=change(0, begin) if number > 1 else None,
        )
        for number, (begin, end) in enumerate(pairwise((*history.starts, len(drives))))
    )
