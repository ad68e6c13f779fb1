"""Motion of a synthetic rig: the true motion in each frame, and what drive.yaml states about it.

The rig moves with a constant twist in the second around each frame's sweep. Each frame has its own street, so the
trajectory only connects the frames. Images are stamped with the middle of the sweep.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.config.setting import check_settings
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import quaternion_xyzw

MOUNTING, ONTOLOGY, POINT_LABELS, IMAGE_LABELS, MOTION, LIDAR_MOUNTING = range(6)
"""Independent streams of random numbers of a drive."""
POSES_FILE = "poses.txt"
FIRST_STAMP_S = 1.0
FRAME_S = 1.0
"""Time from one sweep to the next, longer than the measurements of a frame can span."""
STEADY_M_S = 12.0
MAX_SPEED_M_S, MAX_YAW_RATE_RAD_S = 20.0, 0.4
"""Maximum forward speed of mixed motion, and maximum turn rate to either side."""


def generator(config: SynthConfig, stream: int, frame: int = 0, *more: int) -> np.random.Generator:
    """Make the generator of a stream, for a frame and any further numbers that distinguish it."""
    return np.random.default_rng((config.seed, stream, frame, *more))


class VehicleMotion(NamedTuple):
    """Motion of the vehicle: x forward, y left, z up, with the origin at the LiDAR."""

    speed_m_s: float
    """Speed along x."""
    yaw_rate_rad_s: float
    """Turn rate about z, positive to the left."""

    def displacement(self, seconds: float) -> Pose:
        """Compute the pose (4, 4) of the vehicle after some time, in its frame at the start: an arc of a circle."""
        angle, arc_m = self.yaw_rate_rad_s * seconds, self.speed_m_s * seconds
        # np.sinc(x) is sin(pi x) / (pi x): an arc's chord over its length is sin(turn / 2) / (turn / 2).
        chord_m = arc_m * float(np.sinc(0.5 * angle / math.pi))
        T: Pose = np.eye(4)
        T[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        T[:2, 3] = chord_m * math.cos(0.5 * angle), chord_m * math.sin(0.5 * angle)
        return T


def check_motion(config: SynthConfig) -> None:
    """Check the settings of a drive, and that the time offset and the shutter have an effect.

    Raises:
        InputError: a setting is out of range, or has no effect because nothing moves.
    """
    check_settings(config)
    for option, value in {"--delay-ms": config.delay_ms, "--readout-ms": config.readout_ms}.items():
        if value != 0.0 and config.motion == "none":
            raise InputError(
                f"{option}: found {value:g}; add --motion steady or mixed, without which it has no effect"
            )
    if config.readout_direction != SynthConfig.readout_direction and config.readout_ms == 0.0:
        problem = f"--readout-direction: found {config.readout_direction}"
        raise InputError(f"{problem}; add --readout-ms, without which it has no effect")


def vehicle_motion(config: SynthConfig, number: int) -> VehicleMotion | None:
    """Compute the motion of the vehicle in a frame; None if it stands still."""
    if config.motion == "none":
        return None
    if config.motion == "steady":
        return VehicleMotion(STEADY_M_S, 0.0)
    rng = generator(config, MOTION, number)
    speed_m_s = rng.uniform(0.0, MAX_SPEED_M_S)
    return VehicleMotion(speed_m_s, rng.uniform(-MAX_YAW_RATE_RAD_S, MAX_YAW_RATE_RAD_S))


def lidar_twist(config: SynthConfig, number: int) -> list[float] | None:
    """Compute the twist (6,) of the LiDAR in its own frame, metres and radians per second; None if it stands still."""
    motion = vehicle_motion(config, number)
    if motion is None:
        return None
    R_lidar_vehicle = _T_vehicle_lidar(config)[:3, :3].T
    linear = R_lidar_vehicle @ (motion.speed_m_s, 0.0, 0.0)
    angular = R_lidar_vehicle @ (0.0, 0.0, motion.yaw_rate_rad_s)
    return [*linear.tolist(), *angular.tolist()]


def poses_text(config: SynthConfig) -> str:
    """Write the trajectory of the LiDAR in the frame of its first pose, in the TUM format.

    Poses are half-way between the frames, so that each frame's twist holds during its whole second.
    """
    T_vehicle_lidar = _T_vehicle_lidar(config)
    T_world_vehicle: Pose = T_vehicle_lidar.T  # a rotation: the fixed frame is the LiDAR's at the start
    middle_s = 0.5 * config.sweep_s
    lines = ["# seconds x y z qx qy qz qw: the LiDAR in the frame of its first pose"]
    for number in range(config.num_frames + 1):
        pose = T_world_vehicle @ T_vehicle_lidar
        values = [*pose[:3, 3].tolist(), *quaternion_xyzw(pose).tolist()]
        stamp_s = FIRST_STAMP_S + FRAME_S * (number - 0.5) + middle_s
        lines.append(" ".join(map(repr, [stamp_s, *values])))
        motion = vehicle_motion(config, number) if number < config.num_frames else None
        if motion is not None:
            T_world_vehicle = T_world_vehicle @ motion.displacement(FRAME_S)
    return "\n".join(lines) + "\n"


def stamps(config: SynthConfig, number: int) -> dict[str, float]:
    """Return the stamps of a frame's sweep and image, in seconds; none for a rig that stands still."""
    if config.motion == "none":
        return {}
    points_stamp = FIRST_STAMP_S + FRAME_S * number
    return {"points_stamp": points_stamp, "image_stamp": points_stamp + 0.5 * config.sweep_s}


def shutter(config: SynthConfig) -> dict[str, Any]:
    """Make the keys of a rolling shutter in drive.yaml; none for a global shutter."""
    if config.readout_ms == 0.0:
        return {}
    return {"readout_s": 1e-3 * config.readout_ms, "direction": config.readout_direction}


def _T_vehicle_lidar(config: SynthConfig) -> Pose:
    """Compute the pose (4, 4) of the LiDAR in the vehicle; its x axis is tilted down from the vehicle's."""
    tilt = math.radians(config.lidar_tilt_deg)
    T: Pose = np.eye(4)
    T[0, 0], T[0, 2], T[2, 0], T[2, 2] = math.cos(tilt), math.sin(tilt), -math.sin(tilt), math.cos(tilt)
    return T
