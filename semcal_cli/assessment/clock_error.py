"""What an offset of the camera's clock may cost a pose where nothing checks it: at one motion, or only a known speed.

A picture that is later than its stamp by `dt` sees what a LiDAR at velocity `v` sees from `v dt` farther on. At one
velocity all frames are off alike: the camera comes out at another place, and more frames neither show nor reduce that.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.assessment.sensitivity import Matrix
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import adjoint

KNOW_MOTION = (
    "give motion.poses, by which the clock is checked, or time_offset_sigma_s, if the clock is known better, or record "
    "at lower speed"
)
"""What to do about an interval that the clock alone makes too wide: more frames do not narrow it."""


def covariance_of_clock(
    drive: Drive, T_camera_lidar: Pose, label_gain: Matrix | None = None
) -> Matrix | None:
    """Compute the covariance (6, 6) of a pose by the clock; None unless the rig moves at one stated twist or speed.

    Of a speed the direction is not known, so it holds along each one across the LiDAR's z axis.

    Args:
        drive: The drive.
        T_camera_lidar: (4, 4), metres.
        label_gain: (6, 6) gain from a twist of the labels' optimum to a twist of the pose; identity if not given.
    """
    if not is_unchecked(drive):
        return None
    assert drive.motion is not None
    if drive.motion.twist is not None:
        of_motion = np.array([*drive.motion.twist.linear_m_s, *drive.motion.twist.angular_rad_s])[:, None]
    else:
        of_motion = np.eye(6)[:, :2] * _speed_m_s(drive)
    shifts = drive.time_offset_sigma_s * adjoint(T_camera_lidar) @ of_motion
    if label_gain is not None:
        shifts = label_gain @ shifts
    return np.asarray(shifts @ shifts.T)


def is_unchecked(drive: Drive) -> bool:
    """Whether a clock that may be off moves the pose by what is stated of the motion, and the data do not tell it."""
    return drive.time_offset_sigma_s > 0.0 and _speed_m_s(drive) > 0.0


def notes_on_clock(data: LoadedDrive) -> tuple[str, ...]:
    """Say that the clock was not checked where the drive gives no direction of its motion, and what that may cost."""
    motion, speed_m_s, sigma_s = data.drive.motion, _speed_m_s(data.drive), data.drive.time_offset_sigma_s
    if is_unchecked(data.drive):
        assert motion is not None
        lacks = "no direction of its motion" if motion.twist is None else "one motion for all frames"
        return (
            f"the clock was not checked: the drive gives {lacks}. Pictures may be {1e3 * sigma_s:.3g} ms off: at "
            f"{speed_m_s:.3g} m/s the camera may be {100.0 * sigma_s * speed_m_s:.2g} cm off, which is part of its "
            "interval",
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


def _speed_m_s(drive: Drive) -> float:
    """Speed that all frames have by what is stated; 0 of poses, which tell the clock where they differ."""
    if drive.motion is None:
        return 0.0
    if drive.motion.twist is not None:
        return float(np.linalg.norm(drive.motion.twist.linear_m_s))
    return drive.motion.speed_m_s or 0.0
