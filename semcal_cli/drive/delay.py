"""Observations at another offset of the camera's clock: the sweeps where the LiDAR would have seen them later."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli import _core
from semcal_cli.drive.observations import LabelledCloud, Observations

LEAST_DIFFERENCE = 1e-3
"""Difference of two velocities that counts, m/s or rad/s: 50 ms of it are a twentieth of a millimetre."""


def twists_per_s(observations: Observations) -> list[Sequence[float]] | None:
    """List the twist of the LiDAR in each of `frame_observations`, (6,); None if a frame has none."""
    twists = [observed.twist_per_s for observed in observations.frame_observations]
    return [twist for twist in twists if twist is not None] if None not in twists else None


def differs(twists_per_s: Sequence[Sequence[float]]) -> bool:
    """Whether frames move differently: at one constant motion, a delay looks like another camera position."""
    return bool(np.ptp(twists_per_s, axis=0).max() > LEAST_DIFFERENCE)


def delayed(observations: Observations, delay_s: float) -> Observations:
    """Move the sweeps to where the LiDAR would have seen them after a delay, at the twist of each frame.

    Args:
        observations: Observations with a twist in each frame.
        delay_s: Time by which pictures are later, seconds.
    """
    twists = twists_per_s(observations)
    assert twists is not None
    clouds = zip(observations.clouds, twists, strict=True)
    return observations.with_clouds(_at_constant_twist(cloud, twist, delay_s) for cloud, twist in clouds)


def _at_constant_twist(cloud: LabelledCloud, twist_per_s: Sequence[float], delay_s: float) -> LabelledCloud:
    along = _core.Trajectory.constant(twist_per_s, 0.0)
    return cloud.with_points(along.compensate(cloud.points, np.zeros(cloud.num_points), delay_s))
