"""Effect of errors of the motion on the pose, if the drive states how far its velocities may be off.

A sweep is moved from the times of its points to the moment of the image. If the velocity is off by `dv`, points that
are moved over a time `dt` end up `dv dt` away from their true place, and so does the camera. The root mean square of
`dt` over all points is used in place of that over the points that the camera sees.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.twists import adjoint
from semcal_cli.observations.loading import LoadedDrive

KNOW_POSES = "give more accurate motion.poses with their motion.sigma, or record at lower speed"
"""Advice if errors of the motion alone make an interval too wide, which more frames do not narrow."""


def covariance_of_motion(
    data: LoadedDrive, T_camera_lidar: Pose, label_gain: Matrix | None = None, later_s: float = 0.0
) -> Matrix | None:
    """Compute the covariance (6, 6) of a pose due to errors of the motion, as if all frames shared them.

    Args:
        data: The drive.
        T_camera_lidar: (4, 4), metres.
        label_gain: (6, 6) gain from a twist of the labels' optimum to a twist of the pose; identity if not given.
        later_s: Time by which images were found to be later than the drive says, seconds.

    Returns:
        The covariance; None if the drive has no motion, or states no errors of it.
    """
    motion = data.drive.motion
    if motion is None or motion.sigma is None:
        return None
    lags_s = [observed.lag_s for observed in data.first_cue.frame_observations]
    lag_s = np.hypot(np.sqrt(np.mean(np.square(lags_s))), later_s)
    sigmas = np.repeat([motion.sigma.linear_m_s, motion.sigma.angular_rad_s], 3)
    shifts = adjoint(T_camera_lidar) * (lag_s * sigmas)
    shifts = shifts if label_gain is None else label_gain @ shifts
    return np.asarray(shifts @ shifts.T)
