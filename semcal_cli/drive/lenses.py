"""The lenses of a camera: their names, and which numbers each has in which intervals."""

import math
from typing import Literal, NamedTuple, TypeAlias

from semcal_cli.errors import mismatch

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

DISTORTION_COUNTS: dict[CameraModel, tuple[int, ...]] = {
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (0, 8),
    "thin_prism": (0, 12, 14),
    "fisheye": (0, 4),
    "omnidirectional": (0, 4),
    "equirectangular": (0,),
    "fov": (1,),
    "double_sphere": (0,),
}
"""Allowed numbers of distortion coefficients of each camera model; 0 means a lens without distortion."""


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
            least, most = ("more than", "less than") if self.is_open else ("at least", "at most")
            raise mismatch(f"{name} {value}", f"{least} {self.low:g} and {most} {self.high:g}")


FOCAL_PX = Interval(1e-3, 1e9)
"""Focal lengths, in pixels or in pixels per radian: beyond any lens and any image."""
RIGHT_ANGLE = Interval(-math.pi / 2, math.pi / 2, is_open=True)

COEFFICIENTS: dict[CameraModel, dict[int, Interval]] = {
    "fov": {0: Interval(0.0, math.pi, is_open=True)},
    "thin_prism": {12: RIGHT_ANGLE, 13: RIGHT_ANGLE},
}
"""Intervals of the coefficients that are angles, by their index."""

PARAMETERS: dict[CameraModel, dict[str, Interval]] = {
    "omnidirectional": {"xi": Interval(0.0, 100.0)},
    "double_sphere": {"xi": Interval(-1.0, 1.0, is_open=True), "alpha": Interval(0.0, 1.0)},
}
"""Intervals of the parameters that a model needs beyond K and distortion."""
