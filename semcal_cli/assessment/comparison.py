"""Two transforms side by side, each with what is known of its error."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from semcal_cli.formats import read_transform
from semcal_cli.formats.semcal import read_half_widths
from semcal_cli.geometry.pose_error import PoseError, compare_poses
from semcal_cli.geometry.poses import Pose


@dataclass(frozen=True)
class Known:
    """A transform from a file."""

    T_camera_lidar: Pose
    half_widths: tuple[float, ...] | None
    """Of the 95 % intervals along the camera's axes: its place in centimetres, its rotation in degrees; None if the
    file has none."""


@dataclass(frozen=True)
class Axis:
    """What differs along or about one axis of the camera."""

    name: str
    unit: Literal["cm", "deg"]
    difference: float
    half_width_a: float | None
    half_width_b: float | None

    @property
    def is_explained(self) -> bool | None:
        """Whether the intervals explain the difference; None where one is not known."""
        if self.half_width_a is None or self.half_width_b is None:
            return None
        return abs(self.difference) <= float(np.hypot(self.half_width_a, self.half_width_b))


@dataclass(frozen=True)
class Comparison:
    """What differs between two transforms, A less B."""

    error: PoseError
    axes: tuple[Axis, ...]


def read_known(path: Path) -> Known:
    """Read a transform of any known format, and its intervals if it is a calibration or a fleet with some.

    Raises:
        InputError: the file is of no known format, or wrong.
    """
    T_camera_lidar = read_transform(path)
    half_widths = read_half_widths(path)
    if half_widths is not None:
        half_widths = (*(100.0 * half for half in half_widths[:3]), *half_widths[3:])
    return Known(T_camera_lidar, half_widths)


def compare(a: Known, b: Known) -> Comparison:
    """Compare two transforms, along the axes of B's camera."""
    error = compare_poses(a.T_camera_lidar, b.T_camera_lidar)
    differences = [*error.camera_center_xyz_cm, *error.rotation_xyz_deg]
    axes = []
    for index, difference in enumerate(differences):
        half_a, half_b = (None if each.half_widths is None else each.half_widths[index] for each in (a, b))
        name = f"{'camera centre' if index < 3 else 'rotation'} {'xyz'[index % 3]}"
        axes.append(Axis(name, "cm" if index < 3 else "deg", difference, half_a, half_b))
    return Comparison(error, tuple(axes))
