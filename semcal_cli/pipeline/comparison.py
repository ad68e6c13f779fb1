"""Comparison of two transforms, with the 95 % intervals of each if they are known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from semcal_cli.estimation.uncertainty.quantiles import overall_width
from semcal_cli.formats import Extrinsic
from semcal_cli.geometry.poses import PoseError, compare_poses
from semcal_cli.pipeline.verdict import Verdict
from semcal_cli.result.refined_camera import camera_differences


@dataclass(frozen=True)
class Axis:
    """Difference of two transforms along or about one axis of the camera."""

    name: str
    """Name of the axis."""
    unit: str
    """Unit of all figures: "cm" or "deg"."""
    difference: float
    """Value of transform A minus that of B."""
    half_width_a: float | None
    """Half width of the 95 % interval of A; None if it is unknown."""
    half_width_b: float | None
    """Half width of the 95 % interval of B; None if it is unknown."""

    @property
    def is_explained(self) -> bool | None:
        """Whether the intervals explain the difference; None if one of them is unknown."""
        if self.half_width_a is None or self.half_width_b is None:
            return None
        return abs(self.difference) <= float(np.hypot(self.half_width_a, self.half_width_b))


@dataclass(frozen=True)
class Comparison:
    """Differences between two transforms, A minus B."""

    error: PoseError
    """Difference of the poses."""
    axes: tuple[Axis, ...]
    """Difference on each axis: x, y, z of the camera centre, then of the rotation."""

    def half_width(self, unit: str) -> float | None:
        """Compute the 95 % half width of the total difference, "cm" or "deg"; None if neither is known."""
        axes = [axis for axis in self.axes if axis.unit == unit]
        half_widths = [(axis.half_width_a, axis.half_width_b) for axis in axes]
        if (None, None) in half_widths:
            return None
        return overall_width(
            [axis.difference for axis in axes], [math.hypot(a or 0.0, b or 0.0) for a, b in half_widths]
        )

    def verdict(self, off: float, allowed: float, unit: str) -> Verdict:
        """Judge the total difference: it is undecided if it is beyond its limit by less than its half width."""
        if off <= allowed:
            return "pass"
        return "fail" if off - (self.half_width(unit) or 0.0) > allowed else "inconclusive"


def describe_cameras(a: Extrinsic, b: Extrinsic) -> str | None:
    """Describe how the cameras of two transforms differ if either was estimated; None if they do not."""
    has_estimate = any(
        extrinsic.record is not None and extrinsic.record.has_found_camera for extrinsic in (a, b)
    )
    if a.camera is None or b.camera is None or not has_estimate:
        return None
    differences = camera_differences(a.camera, b.camera, "B")
    return f"that of A has {', '.join(differences)}" if differences else None


def compare(a: Extrinsic, b: Extrinsic) -> Comparison:
    """Compare two transforms along the axes of B's camera."""
    error = compare_poses(a.T_camera_lidar, b.T_camera_lidar)
    axes = []
    for index, offset in enumerate(error.offsets.tolist()):
        name, unit, scale = ("camera centre", "cm", 100.0) if index < 3 else ("rotation", "deg", 1.0)
        half_a, half_b = (
            None if extrinsic.half_widths is None else scale * extrinsic.half_widths[index]
            for extrinsic in (a, b)
        )
        axes.append(Axis(f"{name} {'xyz'[index % 3]}", unit, scale * offset, half_a, half_b))
    return Comparison(error, tuple(axes))
