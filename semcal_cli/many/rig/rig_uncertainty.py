"""Uncertainty of the sensors of an adjusted rig, by the errors of the ties that placed them.

By labels, errors of calibrations are taken as independent. Those of other cues are mostly of whole classes of points,
which cameras of one LiDAR share to an unknown degree. The covariance of a sum of errors e_c of unknown correlation is
at most sum C_c / w_c with any weights that sum to one (the bound of covariance intersection: Julier and Uhlmann, *A
non-divergent estimation algorithm in the presence of unknown correlations*, ACC 1997); it is smallest in proportion to
the sizes of the errors.
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
    """Return the covariance (6 n, 6 n) of all sensors."""
    return estimate.covariance[estimate.place_of_poses, estimate.place_of_poses]


def adjusted_sensor(name: str, estimate: RigEstimate) -> AdjustedSensor:
    """Compute the uncertainty of a sensor by all that is measured and stated.

    What was found beside the pose of a camera, such as the cost of its intrinsics, stays that of its own calibration.
    """
    place, pose = estimate.place(name), estimate.poses[name]
    gains = {source: estimate.gain[place, estimate.source_place(source)] for source in estimate.sources}
    own = next((source for source in estimate.sources if source.ends == (name, FIRST_LIDAR)), None)
    alone = estimate.covariance[place, place] if own is None else own.covariance
    parts = {source: _carried(gain, estimate.own_covariance(source)) for source, gain in gains.items()}
    weights = _weights(parts, np.diag(alone))
    of_K = estimate.gain[place, estimate.place_of_intrinsics]
    intrinsics_covariance, spread = of_K @ of_K.T, np.zeros(NUM_AXES)
    covariance = estimate.of_constraints[place, place] + intrinsics_covariance
    for source, weight in weights.items():
        covariance += parts[source] / weight
        variances = gains[source] ** 2 * np.diag(estimate.own_covariance(source))
        # Satterthwaite's degrees of freedom of a sum; constraints and errors of intrinsics have infinitely many.
        degrees = variances @ estimate.own_degrees(source) / np.maximum(variances.sum(axis=1), TINY)
        spread += (np.diag(parts[source]) / weight) ** 2 / np.maximum(degrees, 1.0)
        intrinsics_covariance += _carried(gains[source], _own_of_intrinsics(source, estimate)) / weight
    freedom = np.clip(np.diag(covariance) ** 2 / np.maximum(spread, TINY), 1.0, MANY)
    adjusted = Uncertainty.from_covariance(pose, symmetric(covariance), freedom)
    kept: dict[str, object] = {
        "covariance_of_intrinsics": rows(intrinsics_covariance) if intrinsics_covariance.any() else None
    }
    if own is not None and own.uncertainty is not None:
        kept |= {part: getattr(own.uncertainty, part) for part in ("label_bleed", "intrinsics_cost")}
        twist = _twist_by_intrinsics(name, own, estimate)
        kept |= {} if twist is None else {"twist_by_intrinsics": rows(twist)}
    return AdjustedSensor(pose, adjusted.model_copy(update=kept))


def _own_of_intrinsics(source: Tie, estimate: RigEstimate) -> Matrix:
    """Return the part (6, 6) of the own covariance of a tie by errors of intrinsics."""
    part = None if source.uncertainty is None else source.uncertainty.covariance_of_intrinsics
    if part is None or estimate.slope_of_intrinsics(source) is not None:
        return np.zeros((NUM_AXES, NUM_AXES))
    return np.array(part)


def _twist_by_intrinsics(camera: str, own: Tie, estimate: RigEstimate) -> Matrix | None:
    """Return the twist (6, 4) of a camera by errors of its intrinsics, given its calibration with the first LiDAR."""
    place = estimate.place(camera)
    if estimate.slope_of_intrinsics(own) is not None:
        return estimate.gain[place, estimate.intrinsics_place(camera)]
    twist = None if own.uncertainty is None else own.uncertainty.twist_by_intrinsics
    return None if twist is None else estimate.gain[place, estimate.source_place(own)] @ np.array(twist)


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
