"""Comparison of two transforms, with the 95 % intervals of each if they are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.formats import read_extrinsic
from semcal_cli.geometry.pose_error import PoseError, compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.camera import camera_differences


@dataclass(frozen=True)
class Known:
    """A transform from a file, with its 95 % intervals."""

    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres."""
    half_widths: tuple[float, ...] | None
    """(6,) half widths of the 95 % intervals along the camera's axes: its position in centimetres, its rotation in
    degrees; None if the file has none."""
    camera: Camera | None = None
    """Camera that the transform belongs to; None if the file has none."""
    is_camera_found: bool = False
    """Whether that camera was estimated together with the transform."""


@dataclass(frozen=True)
class Axis:
    """Difference of two transforms along or about one axis of the camera."""

    name: str
    """Name of the axis."""
    unit: Literal["cm", "deg"]
    """Unit of all figures."""
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
    """Difference of each axis: x, y, z of the camera's position, then of its rotation."""


def read_known(path: Path) -> Known:
    """Read a transform of any known format, and its intervals from a calibration or the result of a fleet.

    Raises:
        InputError: the file has no known format, or is wrong.
    """
    found = read_extrinsic(path)
    record = found.record
    half_widths = found.half_widths
    if half_widths is not None:
        half_widths = (*(100.0 * half for half in half_widths[:3]), *half_widths[3:])
    is_camera_found = record is not None and record.camera is not None and record.camera.is_kept
    return Known(found.T_camera_lidar, half_widths, found.camera, is_camera_found)


def describe_cameras(a: Known, b: Known) -> str | None:
    """Say how the cameras of two transforms differ, of which one was estimated; None if nothing is to be said."""
    if a.camera is None or b.camera is None or not (a.is_camera_found or b.is_camera_found):
        return None
    differences = camera_differences(a.camera, b.camera, "B")
    return f"that of A has {', '.join(differences)}" if differences else None


def compare(a: Known, b: Known) -> Comparison:
    """Compare two transforms along the axes of B's camera."""
    error = compare_poses(a.T_camera_lidar, b.T_camera_lidar)
    differences = [*error.camera_center_xyz_cm, *error.rotation_xyz_deg]
    axes = []
    for index, difference in enumerate(differences):
        half_a, half_b = (None if each.half_widths is None else each.half_widths[index] for each in (a, b))
        name = f"{'camera centre' if index < 3 else 'rotation'} {'xyz'[index % 3]}"
        axes.append(Axis(name, "cm" if index < 3 else "deg", difference, half_a, half_b))
    return Comparison(error, tuple(axes))
