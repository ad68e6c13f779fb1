"""The LiDAR of a drive: its scan pattern, its own points, where its rays start, and how it turns.

How it turns tells when it measured a point. A laser that points a few degrees beside the direction in which the LiDAR
faces, as some of an HDL-64E do, is off by one or two milliseconds.
"""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from semcal_cli.config.point_files import MAX_ORIGIN_M
from semcal_cli.errors import mismatch
from semcal_cli.files.validation import StrictModel, length
from semcal_cli.geometry.arrays import Numbers, Points

ElevationDeg = Annotated[float, Field(ge=-90.0, le=90.0)]
Coordinate = Annotated[float, Field(ge=-MAX_ORIGIN_M, le=MAX_ORIGIN_M)]
LARGEST_INTEGER = 2**53
"""Largest integer up to which float64, as which fields are compared, has all integers."""
MAX_FIELD_LENGTH = 100
"""Largest number of characters of the name of a field of a cloud."""
SHARES = {"start": 0.0, "middle": 0.5, "end": 1.0}
"""Share of a sweep that has passed at each moment that a stamp may state."""


class Spin(StrictModel):
    """How a LiDAR turns about its z axis: the azimuth of a point tells when it was measured."""

    rate_hz: Annotated[float, Field(ge=1.0, le=100.0)]
    """Turns per second."""
    clockwise: bool
    """Whether it turns clockwise as seen from above, where z points at the viewer."""
    seam_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    """Azimuth at which each sweep begins and ends, in degrees, counter-clockwise from the x axis."""
    stamp: Literal["start", "middle", "end"] = "middle"
    """Moment of a sweep that `points_stamp` states. In the middle, the LiDAR faces away from the seam."""

    def times(self, points: Points) -> Numbers:
        """Compute when the LiDAR faced points (N, 3), from where its rays start, in seconds (N,) after their stamp."""
        azimuths = np.arctan2(points[:, 1], points[:, 0], dtype=np.float64)
        turns = (azimuths - np.radians(self.seam_deg)) / (-2.0 * np.pi if self.clockwise else 2.0 * np.pi)
        times: Numbers = (turns % 1.0 - SHARES[self.stamp]) / self.rate_hz
        return times


class OwnPoints(StrictModel):
    """The LiDAR's own points in clouds that hold those of several LiDARs."""

    field: Annotated[str, Field(max_length=MAX_FIELD_LENGTH, json_schema_extra={"minLength": 1})]
    """Field of the files that tells the LiDARs apart: `ring`, the number of a LiDAR, or any other."""
    range: Annotated[tuple[float, ...], length(2, 2)]
    """Its smallest and its largest value at the LiDAR's own points."""

    @field_validator("field")
    @classmethod
    def _check_field(cls, value: str) -> str:
        if value in ("", "_"):
            found = "'_', a column that is not used" if value else "''"
            raise mismatch(found, "the name of a field of the files")
        return value

    @field_validator("range")
    @classmethod
    def _check_range(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value[0] > value[1]:
            raise mismatch(list(value), "the smallest and the largest value, in this order")
        if max(map(abs, value)) > LARGEST_INTEGER:
            raise mismatch(list(value), f"values up to {LARGEST_INTEGER:,}: larger integers are rounded")
        return value

    def is_apart_from(self, other: OwnPoints) -> bool:
        """Return whether no point of a cloud can be among both: ranges of one field do not overlap."""
        field, other_field = (own.field.lower().removeprefix("scalar_") for own in (self, other))
        (first, last), (other_first, other_last) = self.range, other.range
        return field == other_field and (last < other_first or other_last < first)


class ScanPattern(NamedTuple):
    """Where the beams of a spinning LiDAR point."""

    channels: int
    columns: int
    fov_up_deg: float
    fov_down_deg: float


class Lidar(StrictModel):
    """The scan pattern of a LiDAR, its own points, where its rays start, how it turns, or several of these."""

    channels: Annotated[int, Field(ge=2, le=4096)] | None = None
    """Number of beams, which is the number of rows of the range image."""
    columns: Annotated[int, Field(ge=4, le=0xFFFF)] | None = None
    """Number of firings per turn."""
    fov_up_deg: ElevationDeg | None = None
    """Elevation of the highest beam, in degrees."""
    fov_down_deg: ElevationDeg | None = None
    """Elevation of the lowest beam, in degrees, negative below the horizon."""
    origin_m: Annotated[tuple[Coordinate, ...], length(3, 3)] = (0.0, 0.0, 0.0)
    """Where the rays start, in metres, LiDAR frame. Not zero if points are in the frame of a vehicle."""
    own_points: OwnPoints | None = None
    """Which points of a cloud are its own, where clouds hold those of several LiDARs: others are not read."""
    spin: Spin | None = None
    """How the LiDAR turns, which gives the times of points whose files have none."""

    @field_validator("fov_down_deg")
    @classmethod
    def _check_order(cls, fov_down_deg: float | None, info: ValidationInfo) -> float | None:
        fov_up_deg = info.data.get("fov_up_deg")
        if fov_down_deg is not None and fov_up_deg is not None and fov_down_deg >= fov_up_deg:
            raise mismatch(fov_down_deg, f"less than fov_up_deg, {fov_up_deg}")
        return fov_down_deg

    @model_validator(mode="after")
    def _check_pattern(self) -> Lidar:
        found = [key for key in ScanPattern._fields if getattr(self, key) is not None]
        is_enough = not self.model_fields_set.isdisjoint(("origin_m", "own_points", "spin"))
        if self.pattern is None and (found or not is_enough):
            needed = f"{', '.join(ScanPattern._fields)} together"
            needed += "" if is_enough else ", origin_m, own_points, or spin"
            raise mismatch(" and ".join(found) or "nothing", needed)
        return self

    @property
    def pattern(self) -> ScanPattern | None:
        """The scan pattern; None if it is not stated."""
        values = self.channels, self.columns, self.fov_up_deg, self.fov_down_deg
        return None if None in values else ScanPattern(*values)  # type: ignore[arg-type]

    @property
    def own_values(self) -> tuple[str, tuple[float, float]] | None:
        """The field that tells its own points, and its smallest and largest value there; None if all are its own."""
        own = self.own_points
        return None if own is None else (own.field, (own.range[0], own.range[1]))

    def rays(self, points: Points) -> Points:
        """Compute the vectors (N, 3) from where the rays start to points (N, 3), metres."""
        return points if not any(self.origin_m) else points - np.asarray(self.origin_m, np.float32)
