"""Intrinsics by name: fx, fy, cx, cy, and the numbers of each lens."""

from __future__ import annotations

from collections.abc import Mapping

from semcal_cli.config import JointlyConfig
from semcal_cli.drive.document import Camera, IntrinsicsSigma
from semcal_cli.drive.lenses import DISTORTION_COUNTS, PARAMETERS, CameraModel
from semcal_cli.errors import InputError

OF_K = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}
"""Row and column of each in the matrix K."""
POLYNOMIAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
COEFFICIENTS: dict[CameraModel, tuple[str, ...]] = {
    "plumb_bob": POLYNOMIAL[:5],
    "rational_polynomial": POLYNOMIAL,
    "thin_prism": (*POLYNOMIAL, "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
    "fisheye": ("k1", "k2", "k3", "k4"),
    "omnidirectional": ("k1", "k2", "p1", "p2"),
    "equirectangular": (),
    "fov": ("w",),
    "double_sphere": (),
}
"""Names of the distortion coefficients of each model, in their order."""

DEFAULT_FOCAL_SIGMA, DEFAULT_CENTER_SIGMA_PX = 0.001, 1.0
"""Standard deviations of the focal lengths, as a share of them, and of the principal point where a drive states none.
They are a convention, and what the verdict is said to hold for; what they cost the pose stands beside it."""


def intrinsic_names(model: CameraModel) -> tuple[str, ...]:
    """List the names of all intrinsics of a model: those of K, distortion coefficients, and parameters."""
    return (*OF_K, *COEFFICIENTS[model], *PARAMETERS.get(model, {}))


def check_intrinsics(names: tuple[str, ...], camera: Camera, where: str) -> None:
    """Check that a camera has intrinsics of these names.

    Raises:
        InputError: it has not; the message begins with `where`.
    """
    known = intrinsic_names(camera.model)
    for name in names:
        if name not in known:
            raise InputError(f"{where}: found {name!r}, needed names of {camera.model}: {', '.join(known)}")


def with_all_coefficients(camera: Camera, names: tuple[str, ...]) -> Camera:
    """Write out the zeros of a lens that leaves out coefficients of these names."""
    of_lens = COEFFICIENTS[camera.model]
    needed = max((of_lens.index(name) + 1 for name in names if name in of_lens), default=0)
    if needed <= len(camera.distortion):
        return camera
    count = min(count for count in DISTORTION_COUNTS[camera.model] if count >= needed)
    missing = (0.0,) * (count - len(camera.distortion))
    return camera.model_copy(update={"distortion": (*camera.distortion, *missing)})


def without_last_zeros(camera: Camera) -> Camera:
    """Leave out the zeros that a lens ends with, so that equal lenses have equal coefficients."""
    count = max((place for place, value in enumerate(camera.distortion, 1) if value), default=0)
    return camera.model_copy(update={"distortion": camera.distortion[:count]})


def intrinsic_value(camera: Camera, name: str) -> float:
    """Give the value of an intrinsic; 0 for a coefficient that the lens leaves out."""
    if name in OF_K:
        row, column = OF_K[name]
        return camera.K[row][column]
    if name in camera.parameters:
        return camera.parameters[name]
    index = COEFFICIENTS[camera.model].index(name)
    return camera.distortion[index] if index < len(camera.distortion) else 0.0


def sigma_of(camera: Camera) -> IntrinsicsSigma:
    """Give the standard deviations of the intrinsics: those that the drive states, or else what a good lens has.

    The K of an equirectangular picture is its size, and exact.
    """
    if camera.intrinsics_sigma is not None:
        return camera.intrinsics_sigma
    if camera.model == "equirectangular":
        return IntrinsicsSigma()
    return default_sigma(camera)


def default_sigma(camera: Camera) -> IntrinsicsSigma:
    """Give the standard deviations that are taken where a drive states none."""
    return _of_shares(camera, DEFAULT_FOCAL_SIGMA, DEFAULT_CENTER_SIGMA_PX)


def stating(camera: Camera, jointly: JointlyConfig) -> Camera:
    """Let a camera state the errors of its intrinsics that settings give; the K of an equirectangular one is exact."""
    share, center_px = jointly.focal_sigma, jointly.center_sigma_px
    if (share is None and center_px is None) or camera.model == "equirectangular":
        return camera
    known, given = sigma_of(camera), _of_shares(camera, share or 0.0, center_px or 0.0)
    focal, center = known if share is None else given, known if center_px is None else given
    stated = IntrinsicsSigma(fx=focal.fx, fy=focal.fy, cx=center.cx, cy=center.cy)
    return camera.model_copy(update={"intrinsics_sigma": stated})


def _of_shares(camera: Camera, focal_share: float, center_px: float) -> IntrinsicsSigma:
    (fx, _, _), (_, fy, _), _ = camera.K
    return IntrinsicsSigma(fx=focal_share * fx, fy=focal_share * fy, cx=center_px, cy=center_px)


def with_intrinsics(camera: Camera, values: Mapping[str, float]) -> Camera:
    """Copy a camera with other values of some intrinsics.

    Raises:
        ValueError: the values are impossible.
    """
    of_lens = COEFFICIENTS[camera.model]
    camera = with_all_coefficients(camera, tuple(values))
    K, distortion = [list(row) for row in camera.K], list(camera.distortion)
    parameters = dict(camera.parameters)
    for name, value in values.items():
        if name in OF_K:
            row, column = OF_K[name]
            K[row][column] = value
        elif name in parameters:
            parameters[name] = value
        else:
            distortion[of_lens.index(name)] = value
    changes = {"K": tuple(map(tuple, K)), "distortion": tuple(distortion), "parameters": parameters}
    stated = camera.intrinsics_sigma
    # What is stated of values that are replaced is not true of the others.
    if stated is not None:
        changed = {name: 0.0 for name in OF_K if name in values}
        changes["intrinsics_sigma"] = stated.model_copy(update=changed).model_dump()
    return Camera.model_validate({**camera.model_dump(), **changes})


def variable(camera: Camera, name: str) -> str:
    """Name an intrinsic as the core does: those of the lens by their index among its numbers."""
    if name in OF_K:
        return name
    numbers = (*COEFFICIENTS[camera.model][: len(camera.distortion)], *sorted(camera.parameters))
    return str(numbers.index(name))
