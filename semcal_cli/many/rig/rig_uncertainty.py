"""Uncertainty of the sensors of an adjusted rig, by the errors of the ties that placed them.

By labels, errors of calibrations are taken as independent. Those of other cues are mostly of whole classes of points,
which cameras of one LiDAR share to an unknown degree. The covariance of a sum of errors e_c of unknown correlation is
at most sum C_c / w_c with any weights that sum to one (the bound of covariance intersection: Julier and Uhlmann, *A
non-divergent estimation algorithm in the presence of unknown correlations*, ACC 1997); it is smallest in proportion to
the sizes of the errors. Calibrations of one camera with several LiDARs share its intrinsics, whose errors cancel for
the most part in the transform between the LiDARs; they are taken as independent, so that its interval is too wide
rather than too narrow.
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
    freedom = np.clip(np.diag(covariance) ** 2 / np.maximum(spread, TINY), 1.0, MANY)
    adjusted = Uncertainty.from_covariance(pose, symmetric(covariance), freedom)
    of_K = rows(of_intrinsics) if of_intrinsics.any() else None
    kept = {"covariance_of_intrinsics": of_K} | ({} if own is None else _kept(own, gains[own]))
    return AdjustedSensor(pose, adjusted.model_copy(update=kept))


def _kept(own: Tie, gain: Matrix) -> dict[str, object]:
    """Return what stays of the uncertainty of a camera alone, given the gain (6, 6) from its errors."""
    uncertainty = own.uncertainty
    assert uncertainty is not None
    kept: dict[str, object] = {
        "label_bleed": uncertainty.label_bleed,
        "intrinsics_cost": uncertainty.intrinsics_cost,
    }
    if uncertainty.twist_by_intrinsics is not None:
        kept["twist_by_intrinsics"] = rows(gain @ np.array(uncertainty.twist_by_intrinsics))
    return kept


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
