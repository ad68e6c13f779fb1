"""Mutual information around a pose, along and about each axis of the camera while the others stay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.result.uncertainty import Uncertainty

SPAN_M, SPAN_DEG = 0.1, 0.5
"""Curves reach so far to either side ..."""
SPAN_SIGMAS = 4.0
"""... or so many standard errors, if that is farther."""
NUM_SAMPLES = 17
"""Over all of that ..."""
NUM_NEAR, NEAR_SIGMAS = 9, 2.0
"""... and between so many standard errors to either side."""
NAMES = (
    "camera centre x, to the right",
    "camera centre y, down",
    "camera centre z, forward",
    "rotation about x, pitch",
    "rotation about y, yaw",
    "rotation about z, roll",
)


@dataclass(frozen=True)
class Curve:
    """Mutual information along one axis."""

    name: str
    unit: str
    offsets: npt.NDArray[np.float64]
    """(n,) centimetres or degrees from the pose."""
    nats: npt.NDArray[np.float64]
    """(n,) there."""
    sigma: float | None
    """Standard error of the pose along the axis, if it is known."""

    @property
    def optimum(self) -> float:
        """Where the information is largest."""
        return float(self.offsets[self.nats.argmax()])

    @property
    def span(self) -> float:
        """How far the curve reaches to either side."""
        return float(self.offsets[-1])


def information_curves(
    observations: Observations, T_camera_lidar: Pose, uncertainty: Uncertainty | None
) -> list[Curve]:
    """Follow the mutual information along the six axes.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4).
        uncertainty: Of the pose, if it is known.
    """
    sigmas: list[float | None] = [None] * 6
    if uncertainty is not None:
        sigmas = [*uncertainty.sigma_camera_center_m, *uncertainty.sigma_rotation_deg]
    curves = []
    for axis, (name, sigma) in enumerate(zip(NAMES, sigmas, strict=True)):
        span = max(SPAN_M if axis < 3 else SPAN_DEG, SPAN_SIGMAS * (sigma or 0.0))
        near = NEAR_SIGMAS * (sigma or 0.02 * span)
        wide = np.linspace(-span, span, NUM_SAMPLES)
        offsets = np.concatenate([wide[np.abs(wide) > near], np.linspace(-near, near, NUM_NEAR)])
        offsets.sort()
        nats = [
            _core.agreement(observations.core, _moved(T_camera_lidar, axis, offset)).mutual_information
            for offset in offsets.tolist()
        ]
        scale, unit = (100.0, "cm") if axis < 3 else (1.0, "deg")
        curves.append(
            Curve(name, unit, scale * offsets, np.array(nats), None if sigma is None else scale * sigma)
        )
    return curves


def _moved(T_camera_lidar: Pose, axis: int, offset: float) -> Pose:
    """Move the camera's centre along, or turn the camera about, one of its axes: metres or degrees."""
    twist = np.zeros(6)
    # The centre moves against the translation of a twist.
    twist[axis] = -offset if axis < 3 else np.radians(offset)
    return apply_twist(T_camera_lidar, twist)
