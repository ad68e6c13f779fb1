"""Mutual information around a pose, along and about each axis of the camera while the other axes stay."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.priors import EXACT
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.intervals import AXIS_NAMES
from semcal_cli.result.uncertainty import Uncertainty

SPAN_M, SPAN_DEG = 0.1, 0.5
"""Least distance that a curve reaches to either side of the pose."""
SPAN_SIGMAS = 4.0
"""Standard errors that a curve reaches at least to either side of the pose."""
NUM_SAMPLES = 13
"""Number of samples over the whole curve."""
NUM_NEAR, NEAR_SIGMAS = 5, 2.0
"""Number of samples near the pose, and the standard errors that they span to either side of it."""


@dataclass(frozen=True)
class Curve:
    """Mutual information along one axis."""

    name: str
    unit: str
    offsets: npt.NDArray[np.float64]
    """(n,) offsets from the pose, in centimetres or degrees."""
    nats: npt.NDArray[np.float64]
    """(n,) mutual information at the offsets, in nats."""
    sigma: float | None
    """Standard error of the pose along the axis, in the unit of the offsets; None if it is not known."""

    @property
    def optimum(self) -> float:
        """Offset at which the mutual information is largest."""
        return float(self.offsets[self.nats.argmax()])

    @property
    def span(self) -> float:
        """Largest offset of the curve to either side."""
        return float(self.offsets[-1])


def information_curves(
    observations: Observations, T_camera_lidar: Pose, uncertainty: Uncertainty | None
) -> list[Curve]:
    """Compute the mutual information of the points visible at a pose along the six axes of the camera.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4), the pose in the middle of the curves.
        uncertainty: Uncertainty of the pose, if it is known.
    """
    sigmas: list[float | None] = [None] * 6
    if uncertainty is not None:
        sigmas = [*uncertainty.sigma_camera_center_m, *uncertainty.sigma_rotation_deg]
    offsets = [_offsets(axis, sigma) for axis, sigma in enumerate(sigmas)]
    ways = [(_twist(axis), of_axis.tolist()) for axis, of_axis in enumerate(offsets)]
    nats = _core.information_along(observations.of_classes.core, T_camera_lidar, ways)
    curves = []
    for axis, (name, sigma) in enumerate(zip(AXIS_NAMES, sigmas, strict=True)):
        scale, unit = (100.0, "cm") if axis < 3 else (1.0, "deg")
        of_unit = None if sigma is None else scale * sigma
        curves.append(Curve(name, unit, scale * offsets[axis], np.array(nats[axis]), of_unit))
    return curves


def _offsets(axis: int, sigma: float | None) -> npt.NDArray[np.float64]:
    """Offsets (n,) of the samples along an axis, in metres or degrees: evenly spaced, and denser near the pose."""
    span = max(SPAN_M if axis < 3 else SPAN_DEG, SPAN_SIGMAS * (sigma or 0.0))
    # An axis that is as good as exactly known has no scale of its own.
    near = NEAR_SIGMAS * (sigma if sigma is not None and sigma > EXACT else 0.02 * span)
    wide = np.linspace(-span, span, NUM_SAMPLES)
    return np.sort(np.concatenate([wide[np.abs(wide) > near], np.linspace(-near, near, NUM_NEAR)]))


def _twist(axis: int) -> list[float]:
    """Twist that moves the camera's centre by a metre along one of its axes, or turns the camera by a degree."""
    twist = [0.0] * 6
    # The centre moves against the translation of a twist.
    twist[axis] = -1.0 if axis < 3 else math.radians(1.0)
    return twist
