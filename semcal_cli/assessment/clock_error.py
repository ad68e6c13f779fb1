"""What an offset of the camera's clock may cost a pose, as far as the data do not tell it.

A picture that is later than its stamp by `dt` sees what a LiDAR at velocity `v` sees from `v dt` farther on. At one
velocity all frames are off alike: the camera comes out at another place, and more frames neither show nor reduce that.
Frames at different velocities `v_i` contradict one another by `(v_i - v) dt`, which tells the offset the better, the
better each frame tells the pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from semcal_cli.assessment.sensitivity import Matrix, sensitivity
from semcal_cli.config import SensitivityConfig
from semcal_cli.drive.delay import twists_per_s
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import adjoint

KNOW_MOTION = (
    "give motion.poses of a drive at different speeds, by which the clock is checked, or time_offset_sigma_s, if the "
    "clock is known better, or record at lower speed"
)
"""What to do about an interval that the clock alone makes too wide: more frames do not narrow it."""
BLOCKS = SensitivityConfig(factor=2, max_points=150_000)
"""Settings of the sensitivity that tells how well frames tell the pose."""


class UnknownClock(NamedTuple):
    """How far the clock may be off, and how far the rig moves meanwhile."""

    sigma_s: float
    """Standard deviation by what is stated of the clock and by what frames at different velocities tell, seconds."""
    stated_sigma_s: float
    """The same by what is stated alone."""
    shifts: Matrix
    """(6, k) twists of the pose by which each second moves it, of one direction or of several possible ones."""
    speed_m_s: float
    """Speed that all frames have in common."""

    @classmethod
    def of(cls, data: LoadedDrive, T_camera_lidar: Pose) -> UnknownClock | None:
        """Compute it at a pose (4, 4); None if the rig stands, its motion is not stated, or the clock is exact.

        Of a speed the direction is not known, so it holds along each one across the LiDAR's z axis.
        """
        sigma_s, motion = data.drive.time_offset_sigma_s, data.drive.motion
        twists = twists_per_s(data.first_cue)
        if motion is None or sigma_s == 0.0:
            return None
        if motion.speed_m_s is not None:
            level = adjoint(T_camera_lidar)[:, :2] * motion.speed_m_s
            return cls(sigma_s, sigma_s, level, motion.speed_m_s) if motion.speed_m_s > 0.0 else None
        if twists is None:
            return None
        by_frame = np.array(twists) @ adjoint(T_camera_lidar).T
        is_one = (by_frame == by_frame[0]).all()
        told = 0.0 if is_one else _told(data, T_camera_lidar, by_frame - by_frame.mean(axis=0))
        speed_m_s = float(np.linalg.norm(np.mean(twists, axis=0)[:3]))
        shifts = by_frame.mean(axis=0)[:, None]
        return cls((sigma_s**-2 + told) ** -0.5, sigma_s, shifts, speed_m_s) if shifts.any() else None

    @property
    def is_checked(self) -> bool:
        """Whether the frames tell more of the clock than what is stated of it."""
        return bool(self.sigma_s < self.stated_sigma_s * 0.5**0.5)


def _told(data: LoadedDrive, T_camera_lidar: Pose, shifts: Matrix) -> float:
    """Compute what frames whose poses differ by `shifts` (frames, 6) a second tell of the clock, in 1 / s^2.

    With `C` the covariance of the pose by all n frames, that of each is `n C`: what classes share moves no two frames
    apart.
    """
    around = sensitivity(data.first_cue, T_camera_lidar, BLOCKS)
    if around is None or not around.is_determined:
        return 0.0
    of_all, _ = around.noise(around.influence)
    return float((shifts * np.linalg.solve(of_all, shifts.T).T).sum()) / len(shifts)


def covariance_of_clock(
    data: LoadedDrive, T_camera_lidar: Pose, label_gain: Matrix | None = None
) -> Matrix | None:
    """Compute the covariance (6, 6) of a pose by the clock; None if that costs nothing, or the motion is not stated.

    Args:
        data: The drive, with its motion.
        T_camera_lidar: (4, 4), metres.
        label_gain: (6, 6) gain from a twist of the labels' optimum to a twist of the pose; identity if not given.
    """
    clock = UnknownClock.of(data, T_camera_lidar)
    if clock is None:
        return None
    shifts = clock.sigma_s * clock.shifts
    if label_gain is not None:
        shifts = label_gain @ shifts
    return np.asarray(shifts @ shifts.T)


def notes_on_clock(data: LoadedDrive, T_camera_lidar: Pose) -> tuple[str, ...]:
    """Say that the clock was not checked where the frames hardly tell it, and what that may cost."""
    motion, clock = data.drive.motion, UnknownClock.of(data, T_camera_lidar)
    if clock is not None and not clock.is_checked:
        assert motion is not None
        is_speed = motion.speed_m_s is not None
        why = "the drive gives no direction of its motion" if is_speed else "its frames move much alike"
        cost_cm = 100.0 * clock.sigma_s * clock.speed_m_s
        return (
            f"the clock was not checked: {why}. Pictures may be {1e3 * clock.sigma_s:.3g} ms off: at "
            f"{clock.speed_m_s:.3g} m/s the camera may be {cost_cm:.2g} cm off, which is part of its interval",
        )
    if motion is not None:
        return ()
    note = "the clock was not checked: the drive gives no motion"
    has_stamps = all(None not in (frame.points_stamp, frame.image_stamp) for frame in data.drive.frames)
    if has_stamps and len(set(data.observations.scenes)) > 1:
        note += (
            ", state motion.poses, or motion.speed_m_s for an interval that includes what the clock may cost"
        )
    return (note,)
