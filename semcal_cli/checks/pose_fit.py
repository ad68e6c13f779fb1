"""How well observations agree at a pose, which several checks compare with the agreement at other poses."""

from __future__ import annotations

import math
from typing import NamedTuple

from semcal_cli import core
from semcal_cli.estimation.uncertainty.information import information_by_squares
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations

NO_FIT = "do not fit at all at this pose"
"""Phrase for pixels that carry no information about points."""


class PoseFit(NamedTuple):
    """How well observations agree at a pose."""

    T_camera_lidar: Pose
    information: float
    """Information of points about pixels, corrected for chance: nats, or adjusted MI."""
    agreement: core.Agreement
    """Agreement of the labels."""


def fit_at(
    observations: Observations, T_camera_lidar: Pose, agreement: core.Agreement | None = None
) -> PoseFit:
    """Measure how well observations agree at a pose (4, 4); the agreement there is reused if given."""
    agreement = agreement or core.agreement(observations.core, T_camera_lidar)
    information = agreement.mutual_information - agreement.bias
    if observations.has_partitions:
        information = information_by_squares(observations, T_camera_lidar).mean
    return PoseFit(T_camera_lidar, information, agreement)


def relative_information(other: float, own: float) -> float:
    """Compute the information of another fit relative to the own one, which may be zero."""
    if own > 0.0:
        return other / own
    return math.inf if other > own else 0.0
