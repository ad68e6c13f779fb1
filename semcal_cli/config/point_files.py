"""What a user states about files of point clouds that do not say it themselves."""

from typing import Literal, NamedTuple, TypeAlias

PointColumn: TypeAlias = Literal["x", "y", "z", "intensity", "ring", "time", "label", "lidar", "_"]
"""A column of a `.bin` file; `lidar` is the number of a LiDAR among several, and `_` is not used."""
PointType: TypeAlias = Literal["f4", "f8"]
"""Type of all numbers of a `.bin` file, as NumPy names it: float32 or float64."""
NamedUnit: TypeAlias = Literal["s", "ms", "us", "ns"]
SECONDS_PER_UNIT: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Length of each named unit of times, in seconds."""
SHARES = 0.9, 1.0 + 1e-6
"""Spans of times that may be shares of a sweep, from 0 to 1: its ends may have no returns."""
MAX_UNIT_S = 100.0
"""Longest unit of point times, in seconds: no scanner takes longer for a sweep."""
MAX_ORIGIN_M = 100.0
"""Largest coordinate of where the rays of a LiDAR start, metres: no vehicle is larger."""


class PointForm(NamedTuple):
    """Columns of `.bin` files, unit of point times, and the LiDAR's own points, where the user states them."""

    point_columns: tuple[PointColumn, ...] | None = None
    """Columns of `.bin` files; None for KITTI's four, or nuScenes' five of a `.pcd.bin`."""
    point_type: PointType = "f4"
    """Type of their numbers."""
    time_unit: NamedUnit | float | None = None
    """Unit of point times, or its length in seconds; None takes whole numbers for nanoseconds, others for seconds."""
    own_points: tuple[str, tuple[float, float]] | None = None
    """Field of the files, and the smallest and largest value that it has at the LiDAR's own points; None for all."""

    @property
    def seconds_per_unit(self) -> float | None:
        """Length of the unit of point times, in seconds; None if the user states none."""
        return SECONDS_PER_UNIT[self.time_unit] if isinstance(self.time_unit, str) else self.time_unit


AS_USUAL = PointForm()
"""Nothing is stated: files have their usual columns, and times the unit that their type suggests."""


def may_be_shares(first: float, last: float) -> bool:
    """Return whether times of a sweep run from 0 to 1, so that they may be shares of it.

    No time between sweeps tells shares from seconds for sure: of keyframes, 1 s apart, it is that of a slow scanner.
    """
    return bool(SHARES[0] <= last - first <= SHARES[1] and first >= 0.0 and last <= SHARES[1])
