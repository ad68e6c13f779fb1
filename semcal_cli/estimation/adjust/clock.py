"""What a time offset may cost a pose that trusts the clock as the drive states it.

An image that is later than its stamp by `dt` is taken from `v dt` farther on, where `v` is the velocity of the LiDAR.
At constant velocity all frames are off by the same amount: the camera comes out displaced, and more frames neither
reveal nor reduce that. Frames at different velocities contradict one another, and determine `dt` together with the
pose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from semcal_cli.config import AdjustmentConfig, PolishConfig
from semcal_cli.drive.document import DEFAULT_CLOCK_SIGMA_S
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.estimation.adjust.joint_fit import Problem, Variables
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.twists import adjoint
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.motion import differs, twists_per_s

KNOW_MOTION = (
    "give motion.poses of a drive at different speeds, set time_offset_sigma_s if the clock is known better, or "
    "record at lower speed"
)
"""Advice where the clock alone makes an interval too wide, which more frames do not narrow."""
SWEEP_S = 0.1
"""Duration of a sweep whose points have no times: most LiDARs turn ten times a second."""
NUM_FRAMES = 20
"""Number of evenly spaced frames from which the offset is estimated, so that long drives cost no more."""


class ClockUncertainty(NamedTuple):
    """How far the clock may be off, and how far the rig moves in that time."""

    offset_s: float
    """Offset that frames at different velocities determine; 0 where they do not."""
    sigma_s: float
    """Standard error of that offset, or the stated standard deviation of the clock, seconds."""
    is_checked: bool
    """Whether the frames determine the offset."""
    is_exact: bool
    """Whether the drive states that the clock is exact."""
    shifts: Matrix
    """(6, k) twists of the pose per second of offset, for the direction of motion or for several possible ones."""
    speed_m_s: float
    """Speed that all frames have in common."""

    @classmethod
    def of(cls, data: LoadedDrive, T_camera_lidar: Pose, polish: PolishConfig) -> ClockUncertainty | None:
        """Compute this at a pose (4, 4); None if the rig stands or its motion is not stated.

        The direction of a speed is unknown, so it counts along both axes across the LiDAR's z axis.
        """
        motion = data.drive.motion
        if motion is None:
            return None
        stated_s = math.hypot(data.drive.time_offset_sigma_s, _skew_s(data, motion))
        if motion.speed_m_s is not None:
            level = adjoint(T_camera_lidar)[:, :2] * motion.speed_m_s
            clock = cls(0.0, stated_s, False, stated_s == 0.0, level, motion.speed_m_s)
            return clock if motion.speed_m_s > 0.0 else None
        twists = twists_per_s(data.first_cue)
        if twists is None or not np.any(twists):
            return None
        mean = np.mean(twists, axis=0)
        estimate = _estimate_offset(data, stated_s, T_camera_lidar, polish) if differs(twists) else None
        offset_s, sigma_s = estimate or (0.0, stated_s)
        shifts, speed_m_s = adjoint(T_camera_lidar) @ mean[:, None], float(np.linalg.norm(mean[:3]))
        return cls(offset_s, sigma_s, estimate is not None, stated_s == 0.0, shifts, speed_m_s)

    def covariance(self, label_gain: Matrix | None = None) -> Matrix | None:
        """Compute the covariance (6, 6) of a pose from errors of the clock; None if the clock is exact.

        It is the second moment about the drive's own offset, which the pose is based on.

        Args:
            label_gain: (6, 6) gain from a twist of the labels' optimum to a twist of the pose; identity if not given.
        """
        if self.is_exact:
            return None
        shifts = self.shifts if label_gain is None else label_gain @ self.shifts
        return np.asarray((self.offset_s**2 + self.sigma_s**2) * shifts @ shifts.T)


def _skew_s(data: LoadedDrive, motion: Motion) -> float:
    """Compute the standard deviation of the time at which sweeps see what the camera sees, seconds.

    Without point times, and unless sweeps are deskewed or triggered, the moment is uniform over the sweep. It displaces
    the camera as an error of the clock does. Where the direction of the motion is unknown, `motion_error_px` tells how
    far sweeps with times are smeared.
    """
    if data.drive.synchronization == "hardware" or motion.point_times == "deskewed":
        return 0.0
    observed = data.first_cue.frame_observations
    are_rigid = [frame.is_rigid for frame in observed]
    if motion.speed_m_s is not None:
        are_rigid = [data.observations.motion_error_px is None]
    return float(np.mean(are_rigid)) * SWEEP_S / math.sqrt(12.0)


def _estimate_offset(
    data: LoadedDrive, sigma_s: float, T_camera_lidar: Pose, polish: PolishConfig
) -> tuple[float, float] | None:
    """Estimate the offset and its standard error from the frames; None if they do not determine it."""
    few = few_frames(data.observations, NUM_FRAMES)
    adjustment = AdjustmentConfig(with_delay=True, delay_sigma_s=sigma_s or DEFAULT_CLOCK_SIGMA_S)
    fit = Problem(few, Variables((), True), adjustment, polish).fit_determined(T_camera_lidar)
    if not fit.variables.with_delay or fit.covariance is None:
        return None
    return float(fit.changes[0]), float(fit.sigmas[0])


def notes_on_clock(data: LoadedDrive, clock: ClockUncertainty | None) -> tuple[str, ...]:
    """Describe what the frames show of the clock, or that it was not checked, and what that may cost."""
    motion = data.drive.motion
    if motion is None:
        note = "the clock was not checked: the drive gives no motion"
        has_stamps = all(None not in (frame.points_stamp, frame.image_stamp) for frame in data.drive.frames)
        if has_stamps and len(set(data.observations.scenes)) > 1:
            note += "; in drive.yaml, give motion.poses, or motion.speed_m_s for an interval that includes clock errors"
        return (note,)
    if clock is None or clock.is_exact or (clock.is_checked and abs(clock.offset_s) <= 2.0 * clock.sigma_s):
        return ()
    sigma_ms = 1e3 * clock.sigma_s
    if clock.is_checked:
        late = "late" if clock.offset_s > 0.0 else "early"
        return (
            f"images are {1e3 * abs(clock.offset_s):.1f} +- {sigma_ms:.1f} ms {late}; the interval allows for it, and "
            "--estimate-delay corrects the pose",
        )
    why = "all frames have the same motion"
    if motion.speed_m_s is not None:
        why = "the drive gives no direction of motion"
    elif (twists := twists_per_s(data.first_cue)) is not None and differs(twists):
        why = "the frames do not determine it"
    cost_m = clock.sigma_s * clock.speed_m_s
    return (
        f"the clock was not checked: {why}. If images are {sigma_ms:.3g} ms off, the camera is "
        f"{100.0 * cost_m:.2g} cm off at {clock.speed_m_s:.3g} m/s, which the interval includes",
    )
