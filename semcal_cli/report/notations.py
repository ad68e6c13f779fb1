"""One transform in all common notations."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError
from semcal_cli.formats import FORMATS
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.arrays import Pose, Vector
from semcal_cli.geometry.poses import (
    camera_center,
    inverse,
    mounting_rpy_deg,
    quaternion_xyzw,
    rotation_vector_deg,
)

DIGITS = 9
"""Digits after the decimal point: nanometres."""


@dataclass(frozen=True)
class TransformText:
    """A transform as text to copy, under its name."""

    name: str
    meaning: str
    text: str


MOUNTING = (
    "degrees, of the camera's body frame (x forward, y left, z up) in the LiDAR frame, "
    "R = Rz(yaw) Ry(pitch) Rx(roll), as for --init-rpy-xyz"
)


def notations(T_camera_lidar: Pose) -> list[TransformText]:
    """Write a transform as matrices, vectors and angles."""
    T, turn_deg = T_camera_lidar, rotation_vector_deg(T_camera_lidar)
    rows = [
        ("camera centre x y z", "metres, in the LiDAR frame", camera_center(T)),
        ("roll pitch yaw", MOUNTING, mounting_rpy_deg(T)),
        ("translation x y z", "metres, of T_camera_lidar", T[:3, 3]),
        ("quaternion x y z w", "of T_camera_lidar", quaternion_xyzw(T)),
        ("quaternion w x y z", "of T_camera_lidar", np.roll(quaternion_xyzw(T), 1)),
        ("rotation vector", "degrees, of T_camera_lidar", turn_deg),
        ("rotation vector", "radians, of T_camera_lidar (OpenCV's rvec)", np.radians(turn_deg)),
    ]
    inverse_meaning = "its inverse, p_lidar = T_lidar_camera p_camera"
    return [
        T_notation(T),
        TransformText("T_lidar_camera", inverse_meaning, _matrix_text(inverse(T))),
        *(TransformText(name, meaning, _aligned(values).strip()) for name, meaning, values in rows),
    ]


def T_notation(T_camera_lidar: Pose) -> TransformText:
    """Write a transform as a matrix."""
    return TransformText(
        "T_camera_lidar", "p_camera = T_camera_lidar p_lidar, metres", _matrix_text(T_camera_lidar)
    )


def pair_notation(a: str, b: str, T_a_b: Pose) -> TransformText:
    """Write the transform (4, 4) between two cameras as a matrix."""
    return TransformText(
        f"T_{a}_{b}", f"p_{a} = T_{a}_{b} p_{b}: from {b} to {a}, metres", _matrix_text(T_a_b)
    )


def files(
    T_camera_lidar: Pose, intrinsics: Camera | None = None, frame_ids: FrameIds | None = None
) -> list[TransformText]:
    """Write a transform in each text format that needs no other information.

    Matrices in formats without a direction are T_camera_lidar. Intrinsics are included where a format can hold them and
    has a name for the lens. Formats of KITTI are left out: they hold the transform of camera 0, which this need not be.
    """
    texts = []
    for format in FORMATS:
        for camera in (intrinsics, None):
            # Formats that edit an existing file are left out, and so is NumPy's, which is not text.
            with suppress(InputError, UnicodeDecodeError):
                reservations: list[str] = []
                options = FormatOptions(
                    direction="lidar-to-camera",
                    frame_ids=frame_ids,
                    intrinsics=camera,
                    on_note=reservations.append,
                )
                text = format.write(T_camera_lidar, options).decode()
                if reservations:
                    break
                direction = "; here lidar-to-camera" if "direction" in format.asks else ""
                texts.append(TransformText(format.name, format.equation + direction, text.rstrip("\n")))
                break
    return texts


def _matrix_text(T: Pose) -> str:
    """Write a transform, one row on each line."""
    return "\n".join(_aligned(row) for row in T)


def _aligned(values: Vector) -> str:
    return " ".join(f"{value: .{DIGITS}f}" for value in np.round(values, DIGITS) + 0.0)
