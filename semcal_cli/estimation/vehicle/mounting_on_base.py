"""The pose of the LiDAR on its vehicle, T_base_lidar, as far as a drive determines it (`semcal base`).

The vehicle's frame, ROS's `base_link`, has x forward, y left, z up (REP 103), and its origin on the ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, counted
from semcal_cli.estimation.vehicle.ground import Ground, find_ground, level_axes
from semcal_cli.estimation.vehicle.scatter import Estimate, trimmed_mean
from semcal_cli.estimation.vehicle.travel import Travel, yaw_from_poses, yaw_from_twist
from semcal_cli.geometry.arrays import Pose, Vector
from semcal_cli.geometry.poses import rpy
from semcal_cli.observations.frame_selection import with_few_frames
from semcal_cli.observations.motion import read_poses
from semcal_cli.observations.reading import read_clouds

MAX_FRAMES = 60
"""Number of frames that are used of a longer drive."""
MIN_ABOVE_M = 0.5
"""Smallest height above the ground of what tells places apart."""
MIN_SHARE_OF_PLACE = 0.1
"""Smallest share of directions with the same range, above the ground, in two sweeps of one place. It is 0.09 to 0.5 for
sweeps of KITTI raw, jam and 360 that are up to 8 m apart, and at most 0.06 for different places."""
MIN_SHARE_OF_FRAMES = 0.5
"""Smallest share of the sweeps that show the same ground. A wall is in few of them."""
MIN_HEIGHT_M = 0.05
"""Smallest height of a LiDAR above the ground."""


@dataclass(frozen=True)
class VehicleMounting:
    """What a drive tells of the LiDAR on its vehicle."""

    up: Vector
    """(3,) direction away from the ground, LiDAR frame."""
    roll_rad: Estimate
    """Roll of the LiDAR over the ground, as in URDF: R_base_lidar = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch_rad: Estimate
    """Pitch of the LiDAR over the ground, positive where its x axis looks down."""
    height_m: Estimate
    """Height of the origin of the LiDAR frame above the ground, metres."""
    travel: Travel | None
    """Yaw by the direction of travel; None where the drive does not tell it."""
    no_yaw: str
    """Why it does not; empty where it does."""
    num_frames: int
    """Number of frames in which ground was found."""
    num_tried: int
    """Number of frames that were searched for it."""
    num_scenes: int
    """Number of different places among them."""

    def T_base_lidar(self, yaw_rad: float, x_m: float, y_m: float) -> Pose:
        """Compute T_base_lidar (4, 4), p_base = T_base_lidar @ p_lidar, metres.

        Args:
            yaw_rad: Yaw of the LiDAR's x axis, positive to the left of forward.
            x_m: How far the LiDAR is ahead of the origin of the base.
            y_m: How far it is to the left.
        """
        T: Pose = np.eye(4)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        T[:3, :3] = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ level_axes(self.up)
        T[:3, 3] = x_m, y_m, self.height_m.value
        return T


def estimate_mounting(drive: Drive) -> VehicleMounting:
    """Estimate roll, pitch and height of the LiDAR over the ground, and its yaw against the direction of travel.

    Intervals are those of the scatter between scenes: what all scenes share is not in them.

    Raises:
        InputError: a file is missing or wrong.
        CalibrationError: too little ground is seen.
    """
    few = with_few_frames(drive, MAX_FRAMES)
    sweeps = [cloud.points for cloud in read_clouds(few)]
    try:
        grounds = find_ground(sweeps)
    except CalibrationError as error:
        raise CalibrationError(f"{drive.path}: {error}") from None
    found = [index for index, ground in enumerate(grounds) if ground is not None]
    planes = [ground for ground in grounds if ground is not None]
    if 0 < len(planes) < MIN_SHARE_OF_FRAMES * len(sweeps):
        raise CalibrationError(
            f"{drive.path}: found ground in only {len(planes)} of {counted(len(sweeps), 'sweep')}, needed half of "
            "them: it may be a wall"
        )
    if not planes:
        raise CalibrationError(
            f"{drive.path}: found too little ground around the vehicle in each of {counted(len(sweeps), 'sweep')}, "
            "expected level ground on several sides"
        )
    places = _places([sweeps[index] for index in found], _mean_ground(planes))
    scene_grounds = [
        _mean_ground([ground for ground, own in zip(planes, places, strict=True) if own == place])
        for place in sorted(set(places))
    ]
    height_m = trimmed_mean(np.array([ground.height_m for ground in scene_grounds]))
    if height_m.value < MIN_HEIGHT_M:
        raise CalibrationError(
            f"{drive.path}: found the LiDAR {height_m.value:.2f} m above the ground, needed {MIN_HEIGHT_M:g} m or "
            "more: clouds must be in the LiDAR's own frame, not in one of the vehicle"
        )
    roll_rad, pitch_rad, up = _mean_tilt(scene_grounds)
    travel, no_yaw = _travel(drive, up)
    if travel is not None:
        travel = travel._replace(yaw_rad=_with_tilt(travel.yaw_rad, roll_rad, pitch_rad))
    return VehicleMounting(
        up, roll_rad, pitch_rad, height_m, travel, no_yaw, len(planes), len(sweeps), len(scene_grounds)
    )


def _places(sweeps: Sequence[npt.NDArray[np.float32]], ground: Ground) -> list[int]:
    """Group sweeps of one place, whose ground is the same: for each the index of the first sweep from there.

    Level ground is at the same ranges everywhere, so that only what stands on it tells places apart.
    """
    above = [points[points @ np.float32(ground.up) > MIN_ABOVE_M - ground.height_m] for points in sweeps]
    shares, first = core.shares_alike(core.nearest_ranges(above)), list[int]()
    for index, row in enumerate(shares):
        known = [other for other in sorted(set(first)) if row[other] >= MIN_SHARE_OF_PLACE]
        first.append(known[0] if known else index)
    return first


def _mean_ground(grounds: list[Ground]) -> Ground:
    up = np.mean([ground.up for ground in grounds], axis=0)
    return Ground(up / np.linalg.norm(up), float(np.mean([ground.height_m for ground in grounds])))


def _mean_tilt(grounds: list[Ground]) -> tuple[Estimate, Estimate, Vector]:
    """Average roll and pitch around those of the mean direction, so that a LiDAR may be upside down."""
    R_level_lidar = level_axes(_mean_ground(grounds).up)
    first_roll, first_pitch, _ = rpy(R_level_lidar)
    tilts = np.array([rpy(level_axes(ground.up))[:2] for ground in grounds])
    off = np.remainder(tilts - (first_roll, first_pitch) + math.pi, 2.0 * math.pi) - math.pi
    roll, pitch = (trimmed_mean(values) for values in off.T)
    roll = Estimate(math.remainder(first_roll + roll.value, 2.0 * math.pi), roll.half_width_95)
    pitch = Estimate(first_pitch + pitch.value, pitch.half_width_95)
    return roll, pitch, _up(roll.value, pitch.value)


def _up(roll_rad: float, pitch_rad: float) -> Vector:
    """Compute the third row (3,) of Ry(pitch) Rx(roll)."""
    cos_pitch = math.cos(pitch_rad)
    return np.array([-math.sin(pitch_rad), cos_pitch * math.sin(roll_rad), cos_pitch * math.cos(roll_rad)])


def _with_tilt(yaw: Estimate, roll: Estimate, pitch: Estimate) -> Estimate:
    """Add what roll and pitch leave open to the interval of yaw: the direction of travel in the LiDAR frame stays."""
    if yaw.half_width_95 is None:
        return yaw
    level = np.array([math.cos(yaw.value), -math.sin(yaw.value), 0.0])
    forward = level_axes(_up(roll.value, pitch.value)).T @ level
    square = yaw.half_width_95**2
    for off_roll, off_pitch in ((roll.half_width_95 or 0.0, 0.0), (0.0, pitch.half_width_95 or 0.0)):
        x, y, _ = level_axes(_up(roll.value + off_roll, pitch.value + off_pitch)) @ forward
        square += math.remainder(-math.atan2(y, x) - yaw.value, 2.0 * math.pi) ** 2
    return Estimate(yaw.value, math.sqrt(square))


def _travel(drive: Drive, up: Vector) -> tuple[Travel | None, str]:
    """Estimate yaw from the motion of a drive, or tell why it has none."""
    motion, R_level_lidar = drive.motion, level_axes(up)
    if motion is None or (motion.poses is None and motion.twist is None):
        return None, "the drive states no motion"
    try:
        if motion.twist is not None:
            sigma = None if motion.sigma is None else motion.sigma.linear_m_s
            twist = motion.twist
            return yaw_from_twist(twist.linear_m_s, twist.angular_rad_s, R_level_lidar, sigma), ""
        assert motion.poses is not None
        return yaw_from_poses(*read_poses(drive.resolve(motion.poses)), R_level_lidar), ""
    except CalibrationError as error:
        return None, str(error)
