"""Compensation of a rolling shutter: points where the LiDAR would have seen them when their line was exposed.

The line on which a point is seen depends on the pose. A pose that is a few pixels off tells the time of a line to some
microseconds, so points need not be moved again while a pose is optimised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Camera, Drive
from semcal_cli.drive.motion import MEAN_SINE, MIN_RANGE_M
from semcal_cli.drive.observations import FrameObservation, LabelledCloud, Observations
from semcal_cli.geometry.poses import Pose

MEAN_SHARE = 0.25
"""Mean time between a line and the middle one, as a share of the readout."""


def can_be_unrolled(observations: Observations) -> bool:
    """Whether points can be moved line by line: the shutter rolls, and the motion in each frame is known."""
    is_known = all(observed.twist_per_s is not None for observed in observations.frame_observations)
    return observations.camera.readout_s > 0.0 and is_known


def unrolled(observations: Observations, T_camera_lidar: Pose) -> Observations:
    """Move each point to where the LiDAR would have seen it when the line was exposed on which it lies at a pose.

    Points may have been moved at another pose before: they go on from there, see `LabelledCloud.exposed_s`.

    Args:
        observations: Points and pictures; they stay as they are with a global shutter, or without a motion.
        T_camera_lidar: (4, 4), metres.
    """
    if not can_be_unrolled(observations):
        return observations
    camera = observations.camera
    return observations.with_clouds(
        _unrolled_cloud(observed, camera, T_camera_lidar) for observed in observations.frame_observations
    )


def points_at(observations: Observations, frame: int, T_camera_lidar: Pose) -> npt.NDArray[np.float32]:
    """Give the points (N, 3) of a frame as `unrolled` moves them at a pose (4, 4), metres."""
    (cloud,) = unrolled(observations.of_cue(0).of_frames([frame]), T_camera_lidar).clouds
    return cloud.points


def exposed_as(observations: Observations, others: Observations) -> Observations:
    """Move each point to the moment at which it is seen in other observations of the same clouds.

    Args:
        observations: Points and pictures.
        others: The same ones with times of lines, as another camera or another offset of the clock tells them.
    """
    pairs = zip(observations.frame_observations, others.clouds, strict=True)
    return observations.with_clouds(_exposed_at(observed, other.exposed_s) for observed, other in pairs)


def shutter_error_px(drive: Drive, sweeps: Sequence[npt.NDArray[np.float32]]) -> float | None:
    """Estimate the median displacement of the points, in pixels, by a shutter that is not compensated.

    Args:
        drive: The drive.
        sweeps: Points (N, 3) of each of some frames, metres, LiDAR frame.

    Returns:
        Pixels; None unless the shutter rolls and the drive gives a speed without a direction.
    """
    motion, readout_s = drive.motion, drive.camera.readout_s
    if readout_s == 0.0 or motion is None or motion.speed_m_s is None:
        return None
    ranges_m = [np.linalg.norm(points, axis=1) for points in sweeps]
    way_m = MEAN_SHARE * readout_s * motion.speed_m_s * MEAN_SINE
    shifts = way_m / np.maximum(np.concatenate(ranges_m), MIN_RANGE_M)
    return float(np.median(shifts)) * core_camera(drive.camera).pixels_per_radian


def _unrolled_cloud(observed: FrameObservation, camera: Camera, T_camera_lidar: Pose) -> LabelledCloud:
    assert observed.twist_per_s is not None
    points, exposed_s = _core.unroll(
        core_camera(camera),
        (camera.readout_s, camera.direction),
        observed.cloud.points,
        _seen_s(observed.cloud),
        observed.twist_per_s,
        T_camera_lidar,
    )
    return replace(observed.cloud, points=points, exposed_s=exposed_s)


def _exposed_at(observed: FrameObservation, exposed_s: npt.NDArray[np.float64] | None) -> LabelledCloud:
    assert observed.twist_per_s is not None
    assert exposed_s is not None
    along = _core.Trajectory.constant(observed.twist_per_s, 0.0)
    points = along.compensate(observed.cloud.points, _seen_s(observed.cloud) - exposed_s, 0.0)
    return replace(observed.cloud, points=points, exposed_s=exposed_s)


def _seen_s(cloud: LabelledCloud) -> npt.NDArray[np.float64]:
    return np.zeros(cloud.num_points) if cloud.exposed_s is None else cloud.exposed_s
