"""The camera of a drive: lens, intrinsics by name, and their uncertainty."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationError, ValidationInfo, field_validator

from semcal_cli import core
from semcal_cli.config import MAX_PIXELS, AdjustmentConfig
from semcal_cli.config.directions import ReadoutDirection
from semcal_cli.errors import InputError, counted, describe, mismatch
from semcal_cli.files.validation import FileName, StrictModel, input_error, length

CameraModel: TypeAlias = Literal[
    "plumb_bob",
    "rational_polynomial",
    "thin_prism",
    "fisheye",
    "omnidirectional",
    "equirectangular",
    "fov",
    "double_sphere",
]
ImageSide = Annotated[int, Field(gt=0, le=0xFFFF)]
Sigma = Annotated[float, Field(ge=0.0, le=1e6)]
Pixels = Annotated[float, Field(ge=-1e9, le=1e9)]
"""Entry of K. The limits are beyond any image."""
Intrinsics: TypeAlias = Annotated[tuple[Annotated[tuple[Pixels, ...], length(3, 3)], ...], length(3, 3)]
Coefficient = Annotated[float, Field(ge=-1e12, le=1e12)]
"""Distortion coefficient. The limits are beyond the sixth power of any telephoto lens, and nothing overflows."""
Readout = Annotated[float, Field(ge=0.0, le=1.0)]
"""Time in seconds from the first line of an image to the last. No readout takes longer than a frame."""

Polygon: TypeAlias = Annotated[tuple[Annotated[tuple[Pixels, ...], length(2, 2)], ...], length(3)]
"""Corners (u, v) of an area of the image, in pixels."""
ImageMask: TypeAlias = Annotated[
    Annotated[FileName, Tag("[file]")]
    | Annotated[Annotated[tuple[Polygon, ...], length(1)], Tag("[polygons]")],
    Discriminator(lambda value: "[polygons]" if isinstance(value, list | tuple) else "[file]"),
]
"""Name of a mask's file, or the areas that are left out."""

DEFAULT_FOCAL_SIGMA, DEFAULT_CENTER_SIGMA_PX = 0.001, 1.0
"""Default relative standard deviation of the focal lengths, and default standard deviation of the principal point.
They are a convention, for which the verdict holds; their effect on the pose is reported with it."""


class Interval(NamedTuple):
    """Interval of allowed values; an open one excludes its ends."""

    low: float
    high: float
    is_open: bool = False

    def check(self, name: str, value: float) -> None:
        """Check that a value lies inside.

        Raises:
            ValueError: the value lies outside.
        """
        inside = self.low < value < self.high or (not self.is_open and value in (self.low, self.high))
        if not inside:
            lower, upper = ("more than", "less than") if self.is_open else ("at least", "at most")
            raise mismatch(f"{name} {value}", f"{lower} {self.low:g} and {upper} {self.high:g}")


class LensModel(NamedTuple):
    """The numbers of a camera model beyond K."""

    coefficients: tuple[str, ...]
    """Names of the distortion coefficients, in order."""
    counts: tuple[int, ...]
    """Allowed numbers of coefficients; 0 means a lens without distortion."""
    parameters: Mapping[str, Interval] = {}
    """Intervals of the parameters of a model beyond K and distortion."""
    angles: Mapping[int, Interval] = {}
    """Intervals of the coefficients that are angles, by index."""


MAX_SKEW = 0.01
"""Maximum skew, as a share of fx: pixel axes that are 0.6 degrees off a right angle. Calibrated cameras have 0.0002
(mlcc), and any more is a K whose numbers are in another order."""
FOCAL_PX = Interval(1e-3, 1e9)
"""Focal lengths, in pixels or in pixels per radian: beyond any lens and any image."""
_RIGHT_ANGLE = Interval(-math.pi / 2, math.pi / 2, is_open=True)
_POLYNOMIAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_THIN_PRISM = (*_POLYNOMIAL, "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_SPHERES = {"xi": Interval(-1.0, 1.0, is_open=True), "alpha": Interval(0.0, 1.0)}
CAMERA_MODELS: dict[CameraModel, LensModel] = {
    "plumb_bob": LensModel(_POLYNOMIAL[:5], (0, 4, 5)),
    "rational_polynomial": LensModel(_POLYNOMIAL, (0, 8)),
    "thin_prism": LensModel(_THIN_PRISM, (0, 12, 14), angles={12: _RIGHT_ANGLE, 13: _RIGHT_ANGLE}),
    "fisheye": LensModel(("k1", "k2", "k3", "k4"), (0, 4)),
    "omnidirectional": LensModel(("k1", "k2", "p1", "p2"), (0, 4), {"xi": Interval(0.0, 100.0)}),
    "equirectangular": LensModel((), (0,)),
    "fov": LensModel(("w",), (1,), angles={0: Interval(0.0, math.pi, is_open=True)}),
    "double_sphere": LensModel((), (0,), _SPHERES),
}
"""The lens of each camera model."""
K_ENTRIES = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}
"""Row and column of each in the matrix K."""


class IntrinsicsSigma(StrictModel):
    """Standard deviations of the intrinsics, as independent errors, from the report of a camera calibration."""

    fx: Sigma = 0.0
    """Standard deviation of fx, in pixels."""
    fy: Sigma = 0.0
    """Standard deviation of fy, in pixels."""
    cx: Sigma = 0.0
    """Standard deviation of cx, in pixels."""
    cy: Sigma = 0.0
    """Standard deviation of cy, in pixels."""


class Camera(StrictModel):
    """Image size, intrinsics and lens of a camera."""

    model: CameraModel
    """Camera model. plumb_bob, rational_polynomial, thin_prism and fisheye (Kannala-Brandt) are those of OpenCV;
    omnidirectional is OpenCV's omnidir (Mei and Rives), fov is by Devernay and Faugeras, double_sphere by Usenko,
    Demmel and Cremers."""
    width: ImageSide
    """Columns of the image."""
    height: ImageSide
    """Rows of the image."""
    K: Intrinsics
    """Intrinsic matrix in pixels; an integer pixel is a pixel centre. Its skew, `K[0][1]`, is usually 0. The focal
    lengths of an equirectangular image are pixels per radian, width / (2 pi) for a full turn; its principal point is
    the direction of the z axis, and it has no skew."""
    distortion: Annotated[tuple[Coefficient, ...], length(0), Field(validate_default=True)] = ()
    """Distortion coefficients in OpenCV's order; absent means none. The coefficient of fov is w, in radians."""
    parameters: Annotated[dict[str, float], Field(validate_default=True)] = {}
    """Parameters of a model beyond K and distortion: xi for omnidirectional, xi and alpha for double_sphere."""
    intrinsics_sigma: IntrinsicsSigma | None = None
    """Standard deviations of the intrinsics, which become part of the intervals of the pose. If absent, they are 0.1 %
    and one pixel (`semcal_cli.drive.camera.sigma_of`); zeros mean that the intrinsics are exact."""
    readout_s: Readout = 0.0
    """Time that a rolling shutter takes from the first row of an image to the last, in seconds; 0 is a global shutter.
    `image_stamp` is the time of the first row. The shutter is compensated if the drive has a motion."""
    direction: ReadoutDirection = "down"
    """Direction in which a rolling shutter reads the rows; down starts with the top row."""
    mask: ImageMask | None = None
    """Pixels of all images that do not show the scene, such as the car's own bonnet; no cue uses them. Either a file,
    relative to the drive, of an image that is black there and white elsewhere, or polygons around them, each a list of
    corners [u, v]."""

    if not TYPE_CHECKING:  # Type checkers see the fields.

        def __init__(self, **values: object) -> None:
            """Make a camera of its fields, whose numbers can be NumPy's.

            Raises:
                InputError: a field is missing, unknown or wrong.
            """
            try:
                super().__init__(**{name: _plain(value) for name, value in values.items()})
            except ValidationError as error:
                raise input_error(error, "Camera") from None

        # Without this mark, pydantic would call it for the camera of a file, too, whose errors name the file.
        __init__.__pydantic_base_init__ = True

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of the image."""
        return self.width, self.height

    @property
    def is_exact(self) -> bool:
        """Whether K follows from the size of the image."""
        return self.model == "equirectangular"

    def zoomed(self, scale: float) -> "Camera":
        """Make the same camera with its focal lengths multiplied by a factor."""
        (fx, skew, cx), (_, fy, cy), last_row = self.K
        return self.model_copy(
            update={"K": ((scale * fx, scale * skew, cx), (0.0, scale * fy, cy), last_row)}
        )

    @field_validator("height")
    @classmethod
    def _check_pixels(cls, height: int, info: ValidationInfo) -> int:
        width: int = info.data.get("width", 0)
        if width * height > MAX_PIXELS:
            raise mismatch(f"{width:,} x {height:,} pixels", f"at most {MAX_PIXELS:,}")
        return height

    @field_validator("K")
    @classmethod
    def _check_intrinsics(cls, K: Intrinsics, info: ValidationInfo) -> Intrinsics:
        (fx, skew, _), (below, fy, _), last_row = K
        if last_row != (0.0, 0.0, 1.0):
            raise mismatch(f"last row {list(last_row)}", "[0, 0, 1]")
        if below != 0.0:
            raise mismatch(f"[1][0] {below}", "0")
        if fx <= 0.0 or fy <= 0.0:
            raise mismatch(f"focal lengths {fx} and {fy}", "both above 0")
        if skew != 0.0 and info.data.get("model") == "equirectangular":
            raise mismatch(f"skew {skew}", "0 for equirectangular")
        if abs(skew) > MAX_SKEW * fx:
            raise mismatch(f"skew {skew}", f"at most {MAX_SKEW * fx:g} to either side, {MAX_SKEW:.0%} of fx")
        FOCAL_PX.check("fx", fx)
        FOCAL_PX.check("fy", fy)
        return K

    @field_validator("distortion")
    @classmethod
    def _check_distortion(cls, distortion: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        if (model := info.data.get("model")) is None:
            return distortion
        lens = CAMERA_MODELS[model]
        if len(distortion) not in lens.counts:
            needed = " or ".join(map(str, lens.counts))
            raise mismatch(counted(len(distortion), "coefficient"), f"{needed} for {model}")
        for index, interval in lens.angles.items():
            if index < len(distortion):
                interval.check(f"[{index}]", distortion[index])
        return distortion

    @field_validator("parameters")
    @classmethod
    def _check_parameters(cls, parameters: dict[str, float], info: ValidationInfo) -> dict[str, float]:
        if (model := info.data.get("model")) is None:
            return parameters
        intervals = CAMERA_MODELS[model].parameters
        if parameters.keys() != intervals.keys():
            keys, needed = (", ".join(map(describe, names)) or "none" for names in (parameters, intervals))
            raise mismatch(keys, f"{needed} for {model}")
        for name, interval in intervals.items():
            interval.check(name, parameters[name])
        return parameters


def _plain(value: object) -> object:
    """Replace NumPy's arrays and numbers, at any depth, by those of Python."""
    match value:
        case np.ndarray() | np.generic():
            return value.tolist()
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
    return value


def core_camera(camera: Camera) -> core.Camera:
    """Make the Rust core's camera of a drive's camera."""
    K = [list(row) for row in camera.K]
    distortion = list(camera.distortion)
    return core.Camera(camera.model, camera.width, camera.height, K, distortion, camera.parameters)


# Intrinsics by name: fx, fy, cx, cy, and the numbers of each lens.


def intrinsic_names(model: CameraModel) -> tuple[str, ...]:
    """List the names of all intrinsics of a model: those of K, distortion coefficients, and parameters."""
    return (*K_ENTRIES, *CAMERA_MODELS[model].coefficients, *CAMERA_MODELS[model].parameters)


def check_intrinsic_names(names: tuple[str, ...], camera: Camera, where: str) -> None:
    """Check that a camera has intrinsics with these names.

    Raises:
        InputError: it lacks one; the message begins with `where`.
    """
    intrinsics = intrinsic_names(camera.model)
    for name in names:
        if name not in intrinsics:
            raise InputError(
                f"{where}: found {name!r}, expected names of {camera.model}: {', '.join(intrinsics)}"
            )


def with_all_coefficients(camera: Camera, names: tuple[str, ...]) -> Camera:
    """Add zeros for coefficients with these names that a lens leaves out."""
    lens = CAMERA_MODELS[camera.model]
    needed = max(
        (lens.coefficients.index(name) + 1 for name in names if name in lens.coefficients), default=0
    )
    if needed <= len(camera.distortion):
        return camera
    count = min(count for count in lens.counts if count >= needed)
    missing = (0.0,) * (count - len(camera.distortion))
    return camera.model_copy(update={"distortion": (*camera.distortion, *missing)})


def without_last_zeros(camera: Camera) -> Camera:
    """Remove the trailing zeros of a lens, so that equal lenses have equal coefficients."""
    count = max((number for number, value in enumerate(camera.distortion, 1) if value), default=0)
    return camera.model_copy(update={"distortion": camera.distortion[:count]})


def intrinsic_value(camera: Camera, name: str) -> float:
    """Return the value of an intrinsic; 0 for a coefficient that the lens leaves out."""
    if name in K_ENTRIES:
        row, column = K_ENTRIES[name]
        return camera.K[row][column]
    if name in camera.parameters:
        return camera.parameters[name]
    index = CAMERA_MODELS[camera.model].coefficients.index(name)
    return camera.distortion[index] if index < len(camera.distortion) else 0.0


def with_intrinsics(camera: Camera, values: Mapping[str, float]) -> Camera:
    """Copy a camera with other values of some intrinsics.

    Raises:
        ValueError: the values are impossible.
    """
    camera = with_all_coefficients(camera, tuple(values))
    document = camera.model_dump()
    K, distortion = [list(row) for row in camera.K], list(camera.distortion)
    for name, value in values.items():
        if name in K_ENTRIES:
            row, column = K_ENTRIES[name]
            K[row][column] = value
        elif name in camera.parameters:
            document["parameters"][name] = value
        else:
            distortion[CAMERA_MODELS[camera.model].coefficients.index(name)] = value
    document |= {"K": tuple(map(tuple, K)), "distortion": tuple(distortion)}
    if camera.intrinsics_sigma is not None:
        # The stated uncertainty of a replaced value does not hold for the new one.
        document["intrinsics_sigma"] |= {name: 0.0 for name in K_ENTRIES if name in values}
    return Camera.model_validate(document)


def core_name(camera: Camera, name: str) -> str:
    """Name an intrinsic as the core does: lens parameters by their index."""
    if name in K_ENTRIES:
        return name
    coefficients = CAMERA_MODELS[camera.model].coefficients[: len(camera.distortion)]
    return str((*coefficients, *sorted(camera.parameters)).index(name))


# Uncertainty of the intrinsics.


def sigma_of(camera: Camera) -> IntrinsicsSigma:
    """Return the standard deviations of the intrinsics: those that the drive states, or the default.

    The K of an equirectangular image follows from its size, and is exact.
    """
    if camera.intrinsics_sigma is not None:
        return camera.intrinsics_sigma
    return IntrinsicsSigma() if camera.is_exact else default_sigma(camera)


def default_sigma(camera: Camera) -> IntrinsicsSigma:
    """Return the standard deviations for a drive that states none."""
    return _relative_sigma(camera, DEFAULT_FOCAL_SIGMA, DEFAULT_CENTER_SIGMA_PX)


def with_sigma(camera: Camera, jointly: AdjustmentConfig) -> Camera:
    """Set the standard deviations of a camera from settings; the K of an equirectangular one stays exact."""
    share, center_px = jointly.focal_sigma, jointly.center_sigma_px
    if (share is None and center_px is None) or camera.is_exact:
        return camera
    current, override = sigma_of(camera), _relative_sigma(camera, share or 0.0, center_px or 0.0)
    focal, center = current if share is None else override, current if center_px is None else override
    sigma = IntrinsicsSigma(fx=focal.fx, fy=focal.fy, cx=center.cx, cy=center.cy)
    return camera.model_copy(update={"intrinsics_sigma": sigma})


def _relative_sigma(camera: Camera, focal_share: float, center_px: float) -> IntrinsicsSigma:
    (fx, _, _), (_, fy, _), _ = camera.K
    return IntrinsicsSigma(fx=focal_share * fx, fy=focal_share * fy, cx=center_px, cy=center_px)
