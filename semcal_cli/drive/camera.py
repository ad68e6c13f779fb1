"""Conversion of a drive's camera to that of the Rust core."""

from __future__ import annotations

from semcal_cli import _core
from semcal_cli.drive.document import Camera


def core_camera(camera: Camera) -> _core.Camera:
    """Make the Rust core's camera of a drive's camera."""
    K = [list(row) for row in camera.K]
    distortion = list(camera.distortion)
    return _core.Camera(camera.model, camera.width, camera.height, K, distortion, camera.parameters)
