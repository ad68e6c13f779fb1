"""Motion of the LiDAR in KITTI raw and KITTI-360, whose sweeps are skewed and whose points have no times.

An oxts packet of KITTI raw is the state of the inertial unit that is nearest in time to the frame (dataformat.txt):
velocities `vf vl vu` forward, left and up along a level road, and rates `wx wy wz` about the unit's own axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from semcal_cli import core
from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError, counted
from semcal_cli.files.input_files import read_text
from semcal_cli.formats.kitti_files import raw_pose, read_keyed
from semcal_cli.formats.node import number, parse_number
from semcal_cli.geometry.arrays import Pose, TwistVector
from semcal_cli.geometry.twists import rotation_matrix
from semcal_cli.importing.dataset_tree import KITTI_PERIOD_S
from semcal_cli.importing.recording import Recording, is_covered, with_poses
from semcal_cli.importing.stamps import MAX_GAP_NS
from semcal_cli.importing.sweep_odometry import SIGMA
from semcal_cli.observations.motion import displacement

SPIN = {"rate_hz": 1.0 / KITTI_PERIOD_S, "clockwise": True, "seam_deg": 180.0}
"""Spin of the HDL-64E of KITTI and KITTI-360. The stamp is the time at which it faces forward, as KITTI's readme says:
the middle of a sweep whose seam is behind."""
MOMENT_S = 0.0037
"""How long after it faces forward the LiDAR's trigger makes the cameras expose: 3.7 +- 1.5 ms on KITTI raw, by the pose
that KITTI publishes (`tests/benchmarks/spin.py`)."""
MOMENT_SIGMA_S = 0.0015
MOMENT_360_SIGMA_S = 0.003
"""Standard deviation on KITTI-360, another car with the same sensors, where 5 ms fit best."""
T_LIDAR_IMU: Pose = np.array(
    [
        [0.9999976, 7.553071e-4, -2.035826e-3, -0.8086759],
        [-7.854027e-4, 0.9998898, -1.482298e-2, 0.3195559],
        [2.024406e-3, 1.482454e-2, 0.9998881, -0.7997231],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""calib_imu_to_velo.txt of 2011-09-26. KITTI's car is the same on all days."""
USED = (3, 4, 8, 9, 10, 17, 18, 19)
"""Places of `roll`, `pitch`, `vf`, `vl`, `vu`, `wx`, `wy` and `wz` among the 30 values of a packet."""
NUM_VALUES = USED[-1] + 1
MAX_RATE = 1e3
"""Largest velocity and rate, as in a drive."""
HALF_SWEEP_S = 0.55 * KITTI_PERIOD_S
"""Time around a stamp in which poses are needed: half a turn, and some more for the image."""


def read_packet(packet: Path) -> TwistVector:
    """Read the motion of the inertial unit from a packet: its twist (6,) in its own frame, m/s and rad/s.

    Raises:
        InputError: a value is missing or is no number.
    """
    words = read_text(packet).split()
    if len(words) < NUM_VALUES:
        raise InputError(f"{packet}: found {counted(len(words), 'value')}, needed at least {NUM_VALUES}")
    value = np.zeros(NUM_VALUES)
    for index in USED:
        where = f"{packet}: value {index + 1}"
        value[index] = number(where, parse_number(where, words[index]), -MAX_RATE, MAX_RATE)
    roll, pitch = value[3:5]
    R_level_imu = rotation_matrix(np.array([0.0, pitch, 0.0])) @ rotation_matrix(np.array([roll, 0.0, 0.0]))
    return np.concatenate([R_level_imu.T @ value[8:11], value[17:20]])


def imu_in_lidar(day: Path) -> tuple[Pose, tuple[str, ...]]:
    """Read T_lidar_imu (4, 4) from the calibration of a day, with a remark if it is another day's."""
    file = day / "calib_imu_to_velo.txt"
    if file.exists():
        return raw_pose(read_keyed(file), None, None), ()
    return T_LIDAR_IMU, (f"found no {file.name} in {day}: KITTI's of 2011-09-26 is used for the motion",)


def poses_along(stamps_s: Sequence[float], twists_per_s: Sequence[TwistVector]) -> dict[int, Pose]:
    """Follow a motion that is known at some times; it goes on for a period before and after each stretch.

    Args:
        stamps_s: Times, ascending. After more than half a second without one, a new stretch begins.
        twists_per_s: The twist (6,) at each of them, metres and radians per second in the LiDAR frame.

    Returns:
        Poses (4, 4) of the LiDAR by their times in nanoseconds, ascending. Those of two stretches have nothing to do
        with one another.
    """
    stamps_ns = [round(stamp_s * NS) for stamp_s in stamps_s]
    period_ns = round(KITTI_PERIOD_S * NS)
    poses: dict[int, Pose] = {}
    for index, (stamp_ns, twist) in enumerate(zip(stamps_ns, twists_per_s, strict=True)):
        gap_ns = stamp_ns - stamps_ns[index - 1] if index else MAX_GAP_NS + 1
        if gap_ns > MAX_GAP_NS:
            poses[stamp_ns - period_ns] = _moved(np.eye(4), twist, -period_ns)
            poses[stamp_ns] = np.eye(4)
        else:
            mean = 0.5 * (twists_per_s[index - 1] + twist)
            poses[stamp_ns] = _moved(poses[stamps_ns[index - 1]], mean, gap_ns)
        if index + 1 == len(stamps_ns) or stamps_ns[index + 1] - stamp_ns > MAX_GAP_NS:
            poses[stamp_ns + period_ns] = _moved(poses[stamp_ns], twist, period_ns)
    return poses


def _moved(T: Pose, twist_per_s: TwistVector, step_ns: int) -> Pose:
    motion = core.Trajectory.constant(twist_per_s.tolist(), 0.0)
    moved: Pose = T @ displacement(motion, 0.0, step_ns / NS)
    return moved


def triggered(recording: Recording, moment_sigma_s: float) -> Recording:
    """State when the LiDAR triggers the cameras. The images' own stamps are those of the computer that received them.

    Args:
        recording: Frames with the stamps of their sweeps.
        moment_sigma_s: Standard deviation of the moment of the images, seconds.
    """
    frames = [replace(frame, image_stamp=frame.points_stamp) for frame in recording.frames]
    return replace(recording, frames=frames, time_offset_s=MOMENT_S, time_offset_sigma_s=moment_sigma_s)


def with_motion(recording: Recording, poses: Mapping[int, Pose], source: str) -> Recording:
    """Add poses to a recording, and leave out the frames that they do not cover.

    Args:
        recording: Frames with the stamps of their sweeps and images.
        poses: Poses (4, 4) of the LiDAR, by their times in nanoseconds.
        source: Where they come from.

    Returns:
        The recording; as it was, with a remark, if most frames have no poses around them.
    """
    stamps = sorted(poses)
    frames = [frame for frame in recording.frames if is_covered(frame, stamps, HALF_SWEEP_S)]
    if 2 * len(frames) < len(recording.frames):
        remark = f"{source} gives no poses around most frames: no motion is written, and sweeps stay skewed"
        return replace(recording, remarks=(*recording.remarks, remark))
    remark = f"sweeps are deskewed by the spin of the LiDAR and the motion in {source}"
    ascending = {stamp: poses[stamp] for stamp in stamps}
    return with_poses(recording, frames, ascending, {"sigma": SIGMA}, remark)
