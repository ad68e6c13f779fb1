"""What an offset of the camera's clock may cost a pose where nothing checks it, since only the speed is known.

A picture that is later than its stamp by `dt` sees what a LiDAR at velocity `v` sees from `v dt` farther on. At one
velocity all frames are off alike: the camera comes out at another place, and more frames neither show nor reduce that.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.assessment.sensitivity import Matrix
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.geometry.poses import Pose

CLOCK_SIGMA_S = 0.02
"""Standard deviation of the offset of a clock that was not checked, in seconds."""
KNOW_MOTION = "give motion.poses, by which the clock is checked, or record at lower speed"
"""What to do about an interval that the clock alone makes too wide: more frames do not narrow it."""


def covariance_of_clock(
    drive: Drive, T_camera_lidar: Pose, label_gain: Matrix | None = None
) -> Matrix | None:
    """Compute the covariance (6, 6) of a pose by the clock; None unless the rig moves and only its speed is stated.

    The direction of travel is not known, so each one across the LiDAR's z axis is as likely as any other.

    Args:
        drive: The drive.
        T_camera_lidar: (4, 4), metres.
        label_gain: (6, 6) gain from a twist of the labels' optimum to a twist of the pose; identity if not given.
    """
    speed_m_s = _speed_m_s(drive)
    if speed_m_s == 0.0:
        return None
    R = T_camera_lidar[:3, :3]
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = 0.5 * (CLOCK_SIGMA_S * speed_m_s) ** 2 * R @ np.diag([1.0, 1.0, 0.0]) @ R.T
    return covariance if label_gain is None else np.asarray(label_gain @ covariance @ label_gain.T)


def notes_on_clock(data: LoadedDrive) -> tuple[str, ...]:
    """Say that the clock was not checked where the drive gives no direction of its motion, and what that may cost."""
    motion, speed_m_s = data.drive.motion, _speed_m_s(data.drive)
    if speed_m_s > 0.0:
        off_cm = 100.0 * CLOCK_SIGMA_S * speed_m_s
        return (
            "the clock was not checked: the drive gives no direction of its motion. Pictures may be "
            f"{1e3 * CLOCK_SIGMA_S:.0f} ms off: at {speed_m_s:.3g} m/s the camera may be {off_cm:.2g} cm off, which is "
            "part of its interval",
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
    """Speed that is stated without a direction; 0 of any other motion."""
    return 0.0 if drive.motion is None else drive.motion.speed_m_s or 0.0
