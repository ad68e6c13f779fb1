"""The camera of a drive, for the Rust core and for OpenCV."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive import Camera


def core_camera(camera: Camera) -> _core.Camera:
    """Build the Rust core's camera."""
    K = [list(row) for row in camera.K]
    return _core.Camera(camera.model, camera.width, camera.height, K, list(camera.distortion))


def intrinsic_matrix(camera: Camera) -> npt.NDArray[np.float64]:
    """K (3, 3) in pixels."""
    return np.array(camera.K, dtype=np.float64)
