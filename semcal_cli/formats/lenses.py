"""The lenses of a drive by the names that ROS, Kalibr and OpenCV give them, and what their files hold of one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from semcal_cli.drive.document import Camera
from semcal_cli.drive.lenses import DISTORTION_COUNTS, CameraModel
from semcal_cli.errors import InputError

ROS_MODELS = {
    "plumb_bob": "plumb_bob",
    "radtan": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
    "kannala_brandt": "fisheye",
}
"""Camera model of each distortion_model (sensor_msgs/distortion_models.h, image_geometry, names that drivers use)."""
ROS_NAMES: dict[CameraModel, str] = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "thin_prism": "rational_polynomial",
    "fisheye": "equidistant",
}
"""distortion_model of each camera model. One of 12 or 14 coefficients has the name of the rational one."""
KALIBR_LENSES = {"radtan": "plumb_bob", "equidistant": "fisheye", "fov": "fov", "none": "plumb_bob"}
"""Camera model of each distortion_model of a pinhole in a camchain."""
KALIBR_MODELS: tuple[CameraModel, ...] = ("plumb_bob", "fisheye", "omnidirectional", "double_sphere", "fov")
"""Camera models that a camchain can hold."""
OPENCV_MODELS: dict[int, CameraModel] = {
    4: "plumb_bob",
    5: "plumb_bob",
    8: "rational_polynomial",
    12: "thin_prism",
    14: "thin_prism",
}
"""Camera model of each number of coefficients, if the lens is no fisheye."""
NAMES = {
    "K": ("camera_matrix", "cameraMatrix", "CameraMatrix", "K", "k"),
    "distortion": ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "d"),
    "width": ("image_width", "width"),
    "height": ("image_height", "height"),
}
"""Names of the keys of a camera block in files of ROS and OpenCV; the first that is found counts."""
LEAST_COUNTS: dict[CameraModel, int] = {
    "plumb_bob": 5,
    "rational_polynomial": 8,
    "thin_prism": 12,
    "fisheye": 4,
}
"""Number of coefficients that are written of a lens without distortion, where a file has to have some."""


def pixels_of(camera: Camera) -> list[float]:
    """Focal lengths and principal point, fx fy cx cy, in pixels."""
    (fx, _, cx), (_, fy, cy), _ = camera.K
    return [fx, fy, cx, cy]


def numbers_of(camera: Camera) -> list[float]:
    """K, nine numbers by rows, in pixels."""
    return [number for row in camera.K for number in row]


def coefficients_of(camera: Camera) -> list[float]:
    """Distortion coefficients in OpenCV's order; zeros of a lens without distortion."""
    return list(camera.distortion) or [0.0] * LEAST_COUNTS[camera.model]


def with_count(camera: Camera, count: int) -> Camera:
    """Give a lens without distortion as many zeros as a file has coefficients, if its model can have so many."""
    if camera.distortion or count not in DISTORTION_COUNTS[camera.model]:
        return camera
    return camera.model_copy(update={"distortion": (0.0,) * count})


class UnnamedLensError(InputError):
    """A format has no name for a lens, or no place for all of its numbers."""


def check_lens(
    where: str, camera: Camera, known: Mapping[CameraModel, object] | tuple[CameraModel, ...]
) -> None:
    """Check that a format has a name for a lens.

    Raises:
        UnnamedLensError: it has none.
    """
    if camera.model not in known:
        raise UnnamedLensError(f"{where}: found the lens {camera.model}, needed one of: {', '.join(known)}")


def kalibr_entry(where: str, camera: Camera) -> dict[str, Any]:
    """Make the keys of a camera in a Kalibr camchain (github.com/ethz-asl/kalibr/wiki/yaml-formats).

    Args:
        where: The option or file that is named in errors.
        camera: The camera.

    Raises:
        UnnamedLensError: Kalibr has no name for the lens, or the lens has more coefficients than Kalibr's.
    """
    check_lens(where, camera, KALIBR_MODELS)
    model, lens, before, distortion = "pinhole", "none", list[float](), list(camera.distortion)
    match camera.model:
        case "plumb_bob":
            if distortion[4:] and distortion[4] != 0.0:
                needed = "needed 0: Kalibr's radtan has k1, k2, p1 and p2"
                raise UnnamedLensError(f"{where}: found the lens plumb_bob with k3 {distortion[4]}, {needed}")
            lens, distortion = "radtan" if distortion else "none", distortion[:4]
        case "fisheye":
            lens, distortion = "equidistant", coefficients_of(camera)
        case "fov":
            lens = "fov"
        case "omnidirectional":
            model, before = "omni", [camera.parameters["xi"]]
            lens = "radtan" if distortion else "none"
        case "double_sphere":
            model, before = "ds", [camera.parameters["xi"], camera.parameters["alpha"]]
    return {
        "camera_model": model,
        "distortion_coeffs": distortion,
        "distortion_model": lens,
        "intrinsics": [*before, *pixels_of(camera)],
        "resolution": [camera.width, camera.height],
    }
