"""Agreement of two motions of one LiDAR: the one that a recording states, and the one estimated from its sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.document import Drive
from semcal_cli.geometry.arrays import Pose, Vectors
from semcal_cli.importing.stamps import are_covered
from semcal_cli.importing.sweep_odometry import SIGMA, twist_from
from semcal_cli.observations.motion import displacement, read_poses

HALF_NS = NS // 5
"""Motions are compared from this long before a moment to this long after it, the interval that `SIGMA` holds for."""
MAX_SIGMAS = 5.0
"""Largest difference that still counts as agreement, in standard deviations of an axis. By chance, one length in a
thousand exceeds 4 (Maxwell distribution), and the other source has errors, too."""


class MotionDifference(NamedTuple):
    """Median length of the difference between two motions, over some moments."""

    linear_m_s: float
    """Difference of the velocities, metres per second."""
    angular_rad_s: float
    """Difference of the angular velocities, radians per second."""
    num_moments: int
    """Number of moments that both motions cover."""

    @property
    def agrees(self) -> bool:
        """Whether the errors of odometry can explain the difference."""
        shares = self.linear_m_s / SIGMA["linear_m_s"], self.angular_rad_s / SIGMA["angular_rad_s"]
        return max(shares) <= MAX_SIGMAS

    def describe(self, name: str) -> str:
        """Describe in a sentence whether the motion called `name` agrees with that of the sweeps."""
        by = f"by {self.linear_m_s:.2g} m/s and {np.degrees(self.angular_rad_s):.2g} degrees per second"
        where = f"the median over {self.num_moments:,} frames"
        if self.agrees:
            return f"{name} agrees with the motion estimated from the sweeps: they differ {by}, {where}"
        return (
            f"{name} disagrees with the motion estimated from the sweeps: they differ {by}, {where}; check the "
            "transform from its frame to the LiDAR, and its clock"
        )


def compare_motions(
    one: Mapping[int, Pose], other: Mapping[int, Pose], moments_ns: Iterable[int]
) -> MotionDifference | None:
    """Compare the motions of the LiDAR in two fixed frames.

    Args:
        one: Poses (4, 4) by their times in nanoseconds, ascending.
        other: Likewise.
        moments_ns: Moments around which the motions are compared.

    Returns:
        The difference; None if no moment has poses of both close before and after it.
    """
    both = [
        moment_ns
        for moment_ns in moments_ns
        if all(are_covered(list(poses), (moment_ns - HALF_NS, moment_ns + HALF_NS)) for poses in (one, other))
    ]
    if not both:
        return None
    differences = _mean_twists(one, both) - _mean_twists(other, both)
    linear, angular = np.median(np.linalg.norm(differences.reshape(-1, 2, 3), axis=2), axis=0)
    return MotionDifference(float(linear), float(angular), len(both))


def compare_with_drive(drive: Drive, poses: Mapping[int, Pose]) -> MotionDifference | None:
    """Compare poses (4, 4), by their times in nanoseconds, with the poses of a drive, around its images.

    Returns:
        The difference; None if the drive has no poses, or no image has poses of both around it.

    Raises:
        InputError: the drive's poses cannot be read.
    """
    if drive.motion is None or drive.motion.poses is None:
        return None
    drive_poses = zip(*read_poses(drive.resolve(drive.motion.poses)), strict=True)
    moments_s = [frame.image_stamp for frame in drive.frames if frame.image_stamp is not None]
    return compare_motions(
        {round(stamp_s * NS): T for stamp_s, T in drive_poses},
        poses,
        [round(moment_s * NS) for moment_s in moments_s],
    )


def _mean_twists(poses: Mapping[int, Pose], moments_ns: Sequence[int]) -> Vectors:
    """Compute the mean twist (N, 6) per second around each moment."""
    trajectory = core.Trajectory.through([stamp / NS for stamp in poses], list(poses.values()))
    ends_s = [((moment - HALF_NS) / NS, (moment + HALF_NS) / NS) for moment in moments_ns]
    displacements = [(displacement(trajectory, start_s, end_s), end_s - start_s) for start_s, end_s in ends_s]
    return np.array([twist_from(np.eye(4), T, seconds) for T, seconds in displacements])
