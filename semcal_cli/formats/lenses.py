"""The names that other tools give to lenses, and the intrinsics in their files."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from semcal_cli.drive.camera import Camera, CameraModel
from semcal_cli.errors import InputError, counted
from semcal_cli.formats.format import CameraBlock
from semcal_cli.formats.node import Node

NAMES = {
    "K": ("camera_matrix", "cameraMatrix", "CameraMatrix", "K", "k"),
    "distortion": ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "d"),
    "width": ("image_width", "width"),
    "height": ("image_height", "height"),
}
"""Names of the keys of a camera block in files of ROS and OpenCV; the first one found counts."""
MODELS: dict[int, CameraModel] = {
    4: "plumb_bob",
    5: "plumb_bob",
    8: "rational_polynomial",
    12: "thin_prism",
    14: "thin_prism",
}
"""Camera model of each number of coefficients in OpenCV's order, if the lens is not a fisheye."""
MIN_COUNTS: dict[CameraModel, int] = {
    "plumb_bob": 5,
    "rational_polynomial": 8,
    "thin_prism": 12,
    "fisheye": 4,
}
"""Number of zeros written for a lens without distortion, where a file must have coefficients."""


def matrix_camera(document: Node, model_of: Callable[[Node, int], str]) -> CameraBlock:
    """Read K, the coefficients and the image size by the names that ROS and OpenCV give them.

    Args:
        document: The file.
        model_of: Determines the camera model from the node and the number of the coefficients.

    Raises:
        InputError: a key is missing or wrong, or the lens is unknown.
    """
    K, distortion = (document.first(NAMES[key]) for key in ("K", "distortion"))
    numbers, coefficients = K.data(), distortion.data()
    if len(numbers) != 9:
        raise InputError(f"{K.where}: found {counted(len(numbers), 'number')}, needed 9 by rows")
    block = {
        "model": model_of(distortion, len(coefficients)),
        "width": document.first(NAMES["width"]).side(),
        "height": document.first(NAMES["height"]).side(),
        "K": [numbers[0:3], numbers[3:6], numbers[6:9]],
        "distortion": coefficients,
    }
    keys = {key: next(name for name in names if name in document.mapping) for key, names in NAMES.items()}
    return CameraBlock(block, keys)


def model_by_count(distortion: Node, count: int, *, because: str = "no name of the lens") -> CameraModel:
    """Derive the camera model from the number of its coefficients.

    Raises:
        InputError: four coefficients may also be those of cv2.fisheye, or no lens has so many.
    """
    if count == 4:
        problem = f"found 4 coefficients and {because}"
        raise InputError(f"{distortion.where}: {problem}; add --model, such as plumb_bob or fisheye")
    if count not in MODELS:
        counts = ", ".join(map(str, MODELS))
        raise InputError(f"{distortion.where}: found {counted(count, 'number')}, expected one of: {counts}")
    return MODELS[count]


def intrinsic_matrix(fx: float, fy: float, cx: float, cy: float) -> list[list[float]]:
    """Make K by rows, in pixels."""
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]


def refuse_camera(where: object, camera: str | None) -> None:
    """Refuse a camera name for a file with one unnamed camera.

    Raises:
        InputError: a name is given.
    """
    if camera is not None:
        raise InputError(f"{where}: found one camera without a name, expected no --camera ({camera!r})")


class UnnamedLensError(InputError):
    """A format has no name for a lens, or cannot hold all of its numbers."""


def pixels_of(where: str, camera: Camera) -> list[float]:
    """List the focal lengths and the principal point, fx fy cx cy, in pixels.

    Raises:
        UnnamedLensError: K has a skew, too; the message begins with `where`.
    """
    (fx, skew, cx), (_, fy, cy), _ = camera.K
    if skew != 0.0:
        raise UnnamedLensError(
            f"{where}: found a K with skew {skew:g}, needed 0: the format has fx, fy, cx and cy"
        )
    return [fx, fy, cx, cy]


def pixels_from_corner(where: str, camera: Camera) -> list[float]:
    """List fx fy cx cy for tools in whose images the centre of the first pixel is (0.5, 0.5), and not (0, 0).

    Raises:
        UnnamedLensError: K has a skew, too; the message begins with `where`.
    """
    fx, fy, cx, cy = pixels_of(where, camera)
    return [fx, fy, cx + 0.5, cy + 0.5]


def coefficients_of(camera: Camera) -> list[float]:
    """List the distortion coefficients in OpenCV's order; zeros for a lens without distortion."""
    return list(camera.distortion) or [0.0] * MIN_COUNTS[camera.model]


def check_lens(where: str, camera: Camera, models: Mapping[CameraModel, object]) -> None:
    """Check that a format has a name for a lens.

    Raises:
        UnnamedLensError: it has none.
    """
    if camera.model not in models:
        raise UnnamedLensError(
            f"{where}: found the lens {camera.model}, expected one of: {', '.join(models)}"
        )
