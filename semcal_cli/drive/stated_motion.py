"""The `motion:` block of a drive: what its user states about how the LiDAR moves."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from semcal_cli.errors import mismatch
from semcal_cli.files.validation import FileName, StrictModel, length

Speed = Annotated[float, Field(ge=-1e3, le=1e3)]
Rate = Annotated[float, Field(ge=-1e3, le=1e3)]


class Twist(StrictModel):
    """Constant motion of the LiDAR, in its own frame."""

    linear_m_s: Annotated[tuple[Speed, ...], length(3, 3)]
    """Velocity, in metres per second."""
    angular_rad_s: Annotated[tuple[Rate, ...], length(3, 3)]
    """Angular velocity, in radians per second."""


class MotionSigma(StrictModel):
    """Standard deviations of a roughly known motion, for each axis. All frames may have the same error."""

    linear_m_s: Annotated[float, Field(ge=0.0, le=1e3)] = 0.0
    """Standard deviation of the velocity along each axis, in metres per second."""
    angular_rad_s: Annotated[float, Field(ge=0.0, le=1e2)] = 0.0
    """Standard deviation of the angular velocity about each axis, in radians per second."""


class Motion(StrictModel):
    """Motion of the LiDAR, which moves points from their times, or from `points_stamp`, to the time of the image."""

    twist: Twist | None = None
    """Constant motion in all frames."""
    poses: FileName | None = None
    """File of the LiDAR's poses in a fixed frame, one per line: seconds x y z qx qy qz qw (the TUM format)."""
    speed_m_s: Annotated[float, Field(ge=0.0, le=1e3)] | None = None
    """Speed of the LiDAR, in metres per second. Without a direction it corrects nothing; it only shows how many
    pixels the motion may cost, and how far an unchecked clock may move the camera."""
    point_times: Literal["relative", "absolute", "deskewed"] = "relative"
    """Whether point times are relative to `points_stamp`, or absolute on the clock of the stamps, or play no part
    because the sweeps were deskewed to `points_stamp`."""
    sigma: MotionSigma | None = None
    """Standard deviations of the velocities from the poses or the twist, which are part of the interval of the pose.
    Without them, the velocities are assumed to be exact."""

    @model_validator(mode="after")
    def _check_one(self) -> Motion:
        sources = {"twist": self.twist, "poses": self.poses, "speed_m_s": self.speed_m_s}
        names = [name for name, value in sources.items() if value is not None]
        if len(names) != 1:
            raise mismatch(" and ".join(names) or "none", f"one of {', '.join(sources)}")
        if self.sigma is not None and self.speed_m_s is not None:
            raise mismatch("sigma beside speed_m_s", "poses or a twist, whose errors it states")
        return self
