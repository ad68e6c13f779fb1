"""Parts of a drive whose frames fit different poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from semcal_cli.files.validation import FileName, StrictModel, Transform, Vector3, Widths

AXES = ("x", "y", "z")


class Movement(StrictModel):
    """Movement of the camera itself, along and about its own axes before it.

    The intervals hold for all six axes together.
    """

    camera_center_m: Vector3
    """Movement of the camera's position, in metres."""
    rotation_deg: Vector3
    """Turn of the camera, in degrees."""
    half_width_95_camera_center_m: Widths
    """Half widths of the joint 95 % intervals of the position, in metres."""
    half_width_95_rotation_deg: Widths
    """Half widths of the joint 95 % intervals of the turn, in degrees."""

    @property
    def words(self) -> str:
        """Say how far the camera turned and moved, as far as either is more than chance."""
        turned = _words(self.rotation_deg, self.half_width_95_rotation_deg)
        moved = _words(self.camera_center_m, self.half_width_95_camera_center_m)
        found = [f"turned by {turned[0]:.2f} +- {turned[1]:.2f} degrees about {turned[2]}"] if turned else []
        if moved:
            found.append(f"moved by {100 * moved[0]:.1f} +- {100 * moved[1]:.1f} cm along {moved[2]}")
        return " and ".join(found) or "turned or moved"


class DrivePart(StrictModel):
    """Frames that fit one pose."""

    first_frame: FileName
    """Point cloud of the first frame."""
    last_frame: FileName
    """Point cloud of the last frame."""
    num_frames: Annotated[int, Field(ge=1)]
    """Number of frames."""
    T_camera_lidar: Transform
    """Transform that these frames fit, p_camera = T_camera_lidar * p_lidar, in metres."""
    moved: Movement | None = None
    """Movement of the camera since the part before; null in the first part."""


def _words(offset: Sequence[float], half_widths: Sequence[float]) -> tuple[float, float, str] | None:
    """Length, half width and axis of an offset (3,); None if no axis is off by more than its interval."""
    if not any(abs(by) > half for by, half in zip(offset, half_widths, strict=True)):
        return None
    vector = np.array(offset)
    length = float(np.linalg.norm(vector))
    along = vector / length
    axis = int(np.argmax(np.abs(along)))
    is_along_axis = abs(along[axis]) > 0.95
    sign = "-" if along[axis] < 0.0 else ""
    name = f"{sign}{AXES[axis]}" if is_along_axis else "(" + " ".join(f"{x:.2f}" for x in along) + ")"
    return length, float(np.linalg.norm(along * half_widths)), name
