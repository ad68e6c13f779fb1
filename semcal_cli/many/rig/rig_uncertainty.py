"""Uncertainty of the sensors of an adjusted rig, by the errors of the ties that placed them.

By labels, errors of calibrations are taken as independent. Those of other cues are mostly of whole classes of points,
which cameras of one LiDAR share to an unknown degree. The covariance of a sum of errors e_c of unknown correlation is
at most sum C_c / w_c with any weights that sum to one (the bound of covariance intersection: Julier and Uhlmann, *A
non-divergent estimation algorithm in the presence of unknown correlations*, ACC 1997); it is smallest in proportion to
the sizes of the errors.

Calibrations of one camera with several LiDARs share its intrinsics: the twists J_t k that errors k of these cause in
each tie t, with gain G_t, add to (sum G_t J_t) (sum G_t J_t)^T. That they do not average out widens the interval of the
camera, and that they cancel for the most part narrows that of the transform between the LiDARs. The gain itself, and
the comparison of ties, take them as independent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli.geometry.arrays import Matrix, Numbers, Pose
from semcal_cli.many.rig.rig_document import FIRST_LIDAR
from semcal_cli.many.rig.rig_estimate import MANY, NUM_AXES, RigEstimate, symmetric
from semcal_cli.many.rig.ties import Tie
from semcal_cli.result.uncertainty import Uncertainty

ROUND_OFF, TINY = 1e-9, 1e-300
"""Relative round-off, and a positive number beside zero."""


class AdjustedSensor(NamedTuple):
    """A sensor of an adjusted rig."""

    pose: Pose
    """T_sensor_lidar (4, 4), metres."""
    uncertainty: Uncertainty
    """Its uncertainty, for a twist on its left in the frame of the sensor."""


def joint_covariance(estimate: RigEstimate) -> Matrix:
    """Compute the covariance (6 n, 6 n) of all sensors, with the errors of intrinsics that ties share."""
    return _with_shared(estimate.covariance, estimate, slice(None))


def _with_shared(covariance: Matrix, estimate: RigEstimate, place: slice) -> Matrix:
    """Correct a covariance, in which ties are independent, for the errors of intrinsics that they share.

    Args:
        covariance: (k, k) covariance, or its part by intrinsics.
        estimate: The estimate.
        place: Rows of the k components.
    """
    for camera in dict.fromkeys(source.to for source in estimate.sources):
        if len(twists := _by_intrinsics(camera, estimate, place)) > 1:
            together = np.sum(twists, axis=0)
            alone = np.sum([twist @ twist.T for twist in twists], axis=0)
            covariance = covariance + together @ together.T - alone
    return covariance


def _by_intrinsics(camera: str, estimate: RigEstimate, place: slice) -> list[Matrix]:
    """Return the twists (k, 4) by errors of the intrinsics of a camera, for each of its ties."""
    return [
        estimate.gain[place, estimate.source_place(source)] @ np.array(source.uncertainty.twist_by_intrinsics)
        for source in estimate.sources
        if source.to == camera
        and source.uncertainty is not None
        and source.uncertainty.twist_by_intrinsics is not None
    ]


def adjusted_sensor(name: str, estimate: RigEstimate) -> AdjustedSensor:
    """Compute the uncertainty of a sensor by all that is measured and stated.

    What was found beside the pose of a camera, such as the cost of its intrinsics, stays that of its own calibration.
    """
    place, pose = estimate.place(name), estimate.poses[name]
    gains = {source: estimate.gain[place, estimate.source_place(source)] for source in estimate.sources}
    own = next((source for source in estimate.sources if source.ends == (name, FIRST_LIDAR)), None)
    alone = estimate.covariance[place, place] if own is None else own.covariance
    parts = {source: _carried(gain, source.covariance) for source, gain in gains.items()}
    weights = _weights(parts, np.diag(alone))
    covariance = estimate.of_constraints[place, place].copy()
    of_intrinsics, spread = np.zeros_like(covariance), np.zeros(NUM_AXES)
    for source, weight in weights.items():
        assert source.uncertainty is not None
        covariance += parts[source] / weight
        variances = gains[source] ** 2 * np.diag(source.covariance)
        # Satterthwaite's degrees of freedom of a sum; constraints have infinitely many.
        of_axes = np.array(source.uncertainty.degrees_of_freedom)
        degrees = variances @ of_axes / np.maximum(variances.sum(axis=1), TINY)
        spread += (np.diag(parts[source]) / weight) ** 2 / np.maximum(degrees, 1.0)
        if (by_intrinsics := source.uncertainty.covariance_of_intrinsics) is not None:
            of_intrinsics += _carried(gains[source], by_intrinsics) / weight
    covariance = _with_shared(covariance, estimate, place)
    of_intrinsics = _with_shared(of_intrinsics, estimate, place)
    freedom = np.clip(np.diag(covariance) ** 2 / np.maximum(spread, TINY), 1.0, MANY)
    adjusted = Uncertainty.from_covariance(pose, symmetric(covariance), freedom)
    of_K = rows(of_intrinsics) if of_intrinsics.any() else None
    kept: dict[str, object] = {"covariance_of_intrinsics": of_K}
    if own is not None and own.uncertainty is not None:
        kept |= {part: getattr(own.uncertainty, part) for part in ("label_bleed", "intrinsics_cost")}
        twists = _by_intrinsics(name, estimate, place)
        kept |= {"twist_by_intrinsics": rows(np.sum(twists, axis=0))} if twists else {}
    return AdjustedSensor(pose, adjusted.model_copy(update=kept))


def _weights(parts: Mapping[Tie, Matrix], variances: Numbers) -> dict[Tie, float]:
    """Return the weight of what each tie adds to the covariance of a sensor: 1 where errors are independent.

    Args:
        parts: (6, 6) what each adds.
        variances: (6,) variances of the sensor, in units of which they are compared.
    """
    scale = np.maximum(variances, TINY)
    sizes = {source: math.sqrt(float((np.diag(part) / scale).sum())) for source, part in parts.items()}
    sizes = {source: size for source, size in sizes.items() if size > ROUND_OFF}
    whole = sum(size for source, size in sizes.items() if source.shares_errors)
    return {source: size / whole if source.shares_errors else 1.0 for source, size in sizes.items()}


def rows(matrix: Matrix) -> tuple[tuple[float, ...], ...]:
    """Return the rows of a matrix, as documents have them."""
    return tuple(map(tuple, matrix.tolist()))


def _carried(gain: Matrix, covariance: npt.ArrayLike) -> Matrix:
    return np.asarray(gain @ np.asarray(covariance) @ gain.T)
