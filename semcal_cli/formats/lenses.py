"""The lenses of a drive by the names that other tools give them, and cameras that are set in files of the user's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from semcal_cli.drive.camera import CAMERA_MODELS, Camera, CameraModel
from semcal_cli.errors import InputError, describe
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.node import Node

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


class Intrinsics(NamedTuple):
    """What a file says of a camera."""

    block: dict[str, Any]
    """The `camera:` block of a drive, not checked yet."""
    keys: Mapping[str, str]
    """The file's own names of the keys of the block, for messages."""


def matrix_camera(document: Node, model_of: Callable[[Node, int], str]) -> Intrinsics:
    """Read K, coefficients and the size of pictures by the names that ROS and OpenCV give them.

    Args:
        document: The file.
        model_of: Tells the camera model of the coefficients, by their node and count.

    Raises:
        InputError: a key is missing or wrong, or the lens is not known.
    """
    K, distortion = (document.first(NAMES[key]) for key in ("K", "distortion"))
    numbers, coefficients = K.data(), distortion.data()
    if len(numbers) != 9:
        raise InputError(f"{K.where}: found {len(numbers)} numbers, needed 9 by rows")
    block = {
        "model": model_of(distortion, len(coefficients)),
        "width": document.first(NAMES["width"]).side(),
        "height": document.first(NAMES["height"]).side(),
        "K": [numbers[0:3], numbers[3:6], numbers[6:9]],
        "distortion": coefficients,
    }
    keys = {key: next(name for name in names if name in document.mapping) for key, names in NAMES.items()}
    return Intrinsics(block, keys)


def intrinsic_matrix(fx: float, fy: float, cx: float, cy: float) -> list[list[float]]:
    """K by rows, in pixels."""
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]


def refuse_camera(where: object, camera: str | None) -> None:
    """Refuse the name of a camera where a file has one camera without a name.

    Raises:
        InputError: a name is given.
    """
    if camera is not None:
        raise InputError(f"{where}: found one camera without a name, needed no --camera ({camera!r})")


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
    if camera.distortion or count not in CAMERA_MODELS[camera.model].counts:
        return camera
    return camera.model_copy(update={"distortion": (0.0,) * count})


class UnnamedLensError(InputError):
    """A format has no name for a lens, or no place for all of its numbers."""


def check_lens(where: str, camera: Camera, known: Mapping[CameraModel, object]) -> None:
    """Check that a format has a name for a lens.

    Raises:
        UnnamedLensError: it has none.
    """
    if camera.model not in known:
        raise UnnamedLensError(f"{where}: found the lens {camera.model}, needed one of: {', '.join(known)}")


def check_same_camera(options: FormatOptions, *stated: tuple[str, object, object]) -> None:
    """Check that a file of the user's is of the camera that is set in it.

    Args:
        options: Options with the file.
        stated: Key, value in the file and value of the camera's, of each value that has to be the same.

    Raises:
        InputError: the file is of pictures of another size, or of another lens.
    """
    for key, found, needed in stated:
        if found != needed:
            text = str(found)[:40] if isinstance(found, list) else describe(found)
            raise InputError(
                f"{options.file}: {key}: found {text}, needed {needed!r}, as the camera that was estimated with the "
                "transform has it; --to semcal writes the transform alone"
            )


def tell(options: FormatOptions, camera: Camera) -> None:
    """Say that the intrinsics were set, with focal lengths and principal point."""
    pixels = zip(("fx", "fy", "cx", "cy"), pixels_of(camera), strict=True)
    figures = ", ".join(f"{name} {value:.6g}" for name, value in pixels)
    options.note(f"set the intrinsics in {options.file}: {figures}")
