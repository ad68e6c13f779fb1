"""Motion compensation: sweeps as the LiDAR would have seen them at the time of their image.

That is the time of the middle line, from which a rolling shutter (`unrolled`) and a late clock (`delayed`) move points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import InputError, counted
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.input_files import read_text
from semcal_cli.geometry.arrays import Array, Numbers, Pose
from semcal_cli.geometry.poses import orthonormal, pose_from_quaternion
from semcal_cli.observations.observations import LabelledCloud, Observations
from semcal_cli.observations.point_times import MAX_SWEEP_S, MIN_SWEEP_S, checked_times

MAX_POSES = 1_000_000
"""Largest number of poses in a file. Reading them takes about ten seconds."""
A_POSE = "expected seconds x y z qx qy qz qw"
MIN_DIFFERENCE = 1e-3
"""Smallest difference of two velocities that counts, m/s or rad/s: in 50 ms it amounts to 0.05 mm."""
MEAN_SHARE = 0.25
"""Mean time between a line and the middle one, as a share of the readout."""
MIN_RANGE_M = 0.1
MEAN_SINE = math.pi / 4.0
"""Mean sine of the angle between a motion of unknown direction and a line of sight."""


class Compensated(NamedTuple):
    """A sweep as the LiDAR would have seen it at one moment."""

    points: npt.NDArray[np.float32]
    """(N, 3) metres, in the LiDAR frame at `image_stamp`."""
    twist_per_s: list[float] | None
    """(6,) twist of the LiDAR at that moment, metres and radians per second in its own frame; None if unknown."""
    lag_s: float = 0.0
    """Time from the points to that moment, root mean square over the points and the lines of the image."""
    is_rigid: bool = False
    """Whether the points have no times, or are deskewed, so that the sweep was moved as a whole from `points_stamp`."""


def compensated(drive: Drive, clouds: Sequence[SweepCloud]) -> list[Compensated]:
    """Compensate the motion of the LiDAR in the sweep of each frame (see `rust/motion.rs`).

    Points stay where they are if the drive has no motion with a direction. Times that a cloud lacks follow from the
    spin of the LiDAR. Where that is not stated, a cloud is taken as compensated: all its points are where the LiDAR
    would have seen them at `points_stamp`. Times that are all alike count as none.

    Raises:
        InputError: a frame has no stamps, times do not match the stamps, or the poses are invalid or do not cover the
            frame.
    """
    motion = drive.motion
    if motion is None or motion.speed_m_s is not None:
        return [Compensated(cloud.points, None) for cloud in clouds]
    trajectory = None if motion.poses is None else read_trajectory(drive, motion.poses)
    moved = []
    for frame, cloud in zip(drive.frames, clouds, strict=True):
        times, is_rigid = _times(drive, motion, frame, cloud)
        moment = _moment(drive, frame)
        along = trajectory or _steady(motion, moment)
        try:
            points = along.compensate(cloud.points, times, moment)
            twist_per_s = along.twist_at(moment)
        except ValueError as error:
            needed = f"expected poses before and after {frame.points}"
            raise InputError(f"{drive.resolve(motion.poses or '')}: {error}, {needed}") from None
        if not np.isfinite(points).all():
            raise InputError(
                f"{drive.path}: motion: found a motion that moves points of {frame.points} to infinity"
            )
        # The camera may look in any direction, so all points count.
        lag_s = math.sqrt(np.mean((times - moment) ** 2) + drive.camera.readout_s**2 / 12.0)
        moved.append(Compensated(points, twist_per_s, lag_s, is_rigid=is_rigid))
    return moved


def displacements(drive: Drive, pairs: Sequence[tuple[Frame, Frame]]) -> list[Pose | None]:
    """Compute how the LiDAR moves from the time of one frame's image to that of another's.

    Args:
        drive: A drive with poses or a twist.
        pairs: Pairs of its frames.

    Returns:
        T_first_second (4, 4), metres, of each pair; None where the poses do not cover it.

    Raises:
        InputError: a frame has no stamps, or the file of the poses is missing or wrong.
    """
    motion = drive.motion
    assert motion is not None
    trajectory = None if motion.poses is None else read_trajectory(drive, motion.poses)
    moved: list[Pose | None] = []
    for pair in pairs:
        start_s, end_s = (_moment(drive, frame) for frame in pair)
        try:
            moved.append(displacement(trajectory or _steady(motion, start_s), start_s, end_s))
        except ValueError:
            moved.append(None)
    return moved


def displacement(trajectory: core.Trajectory, start_s: float, end_s: float) -> Pose:
    """Compute the pose (4, 4) of the LiDAR at one time in its frame at another.

    Raises:
        ValueError: the trajectory does not cover both times.
    """
    corners = np.eye(4, 3, -1, np.float32)
    moved = trajectory.compensate(corners, np.full(4, end_s), start_s).astype(np.float64)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = (moved[1:] - moved[0]).T, moved[0]
    return orthonormal(T)


def _steady(motion: Motion, moment_s: float) -> core.Trajectory:
    twist = motion.twist
    assert twist is not None
    return core.Trajectory.constant((*twist.linear_m_s, *twist.angular_rad_s), moment_s)


def motion_error_px(drive: Drive, clouds: Sequence[SweepCloud]) -> float | None:
    """Estimate the median displacement of the points, in pixels, by a motion that is not compensated.

    Without stamps that match the point times, the image is assumed to be taken in the middle of the sweep. The rotation
    of the LiDAR is unknown and not included.

    Returns:
        Pixels, 0 if the drive stands; None unless it has a speed without a direction and clouds have times.

    Raises:
        InputError: times cannot be seconds; those of a drive that stands are not used.
    """
    motion = drive.motion
    if motion is None or motion.speed_m_s is None:
        return None
    if motion.speed_m_s == 0.0:
        return 0.0 if any(drive.point_times(cloud) is not None for cloud in clouds) else None
    shifts_px = []
    for frame, cloud in zip(drive.frames, clouds, strict=True):
        told = checked_times(drive, frame, cloud, motion.point_times)
        if told is None:
            continue
        times, is_absolute = told
        middle = 0.5 * (times.min() + times.max())
        if frame.points_stamp is not None and frame.image_stamp is not None:
            zero = 0.0 if is_absolute else frame.points_stamp
            moment = _moment(drive, frame) - zero
            middle = moment if abs(moment - middle) <= MAX_SWEEP_S else middle
        ranges_m = np.maximum(np.linalg.norm(cloud.points, axis=1), MIN_RANGE_M)
        shifts_px.append(np.abs(times - middle) * motion.speed_m_s * MEAN_SINE / ranges_m)
    if not shifts_px:
        return None
    return float(np.median(np.concatenate(shifts_px))) * core_camera(drive.camera).pixels_per_radian


def have_times(clouds: Sequence[SweepCloud]) -> bool:
    """Whether files have point times that tell that a sweep took a while: a rig that moves meanwhile smears it."""
    return any(cloud.time is not None and np.ptp(cloud.time) >= MIN_SWEEP_S for cloud in clouds)


def _times(drive: Drive, motion: Motion, frame: Frame, cloud: SweepCloud) -> tuple[Numbers, bool]:
    """Return the time of each point (N,), in seconds on the clock of the stamps, and whether the sweep is rigid."""
    if frame.points_stamp is None:
        raise InputError(
            f"{drive.path}: {frame.key('points_stamp')}: found nothing, expected a time for the motion"
        )
    told = checked_times(drive, frame, cloud, motion.point_times)
    if told is None:
        return np.full(len(cloud.points), frame.points_stamp), True
    times, is_absolute = told
    return times + (0.0 if is_absolute else frame.points_stamp), False


def _moment(drive: Drive, frame: Frame) -> float:
    """Return the time of the image's middle line, in seconds; its stamp must be within `MAX_SWEEP_S` of the sweep's."""
    if frame.image_stamp is None:
        raise InputError(
            f"{drive.path}: {frame.key('image_stamp')}: found nothing, expected a time for the motion"
        )
    if frame.points_stamp is not None and abs(frame.image_stamp - frame.points_stamp) > MAX_SWEEP_S:
        found = f"found {frame.image_stamp - frame.points_stamp:g} s after points_stamp"
        raise InputError(
            f"{drive.path}: {frame.key('image_stamp')}: {found}, needed at most {MAX_SWEEP_S:g} s for motion"
        )
    return frame.image_stamp + drive.time_offset_s + 0.5 * drive.camera.readout_s


def read_trajectory(drive: Drive, name: str) -> core.Trajectory:
    """Read the LiDAR's poses from a file in the TUM format, or from the array with that name.

    Raises:
        InputError: it cannot be read or is invalid.
    """
    path = drive.resolve(name)
    rows = None if drive.arrays is None else _rows_of_array(name, drive.arrays.by_name[name])
    stamps, poses = read_poses(path, rows)
    try:
        return core.Trajectory.through(stamps, poses)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def read_poses(
    path: Path, rows: Iterator[tuple[str, list[float]]] | None = None
) -> tuple[list[float], list[Pose]]:
    """Read times in seconds, and poses (4, 4), from a file in the TUM format.

    Args:
        path: The file.
        rows: Numbers of each pose, after its name in messages; None reads them from the file.

    Raises:
        InputError: the file cannot be read or is invalid.
    """
    stamps, poses = list[float](), list[Pose]()
    for where, values in _rows_of_text(path) if rows is None else rows:
        if len(values) != 8 or not all(map(math.isfinite, values)):
            found = (
                "found a number that is not finite"
                if len(values) == 8
                else f"found {counted(len(values), 'number')}"
            )
            raise InputError(f"{where}: {found}, {A_POSE}")
        try:
            poses.append(pose_from_quaternion(values[4:], values[1:4]))
        except ValueError as error:
            raise InputError(f"{where}: {error}") from None
        stamps.append(values[0])
    return stamps, poses


def _rows_of_array(name: str, poses: Array) -> Iterator[tuple[str, list[float]]]:
    """Yield the numbers of each pose in an array (M, 8), after its name in messages."""
    return ((f"{name}[{index}]", row) for index, row in enumerate(poses.astype(np.float64).tolist()))


def _rows_of_text(path: Path) -> Iterator[tuple[str, list[float]]]:
    """Yield the numbers in each line of a file, after its name in messages."""
    numbered = enumerate(read_text(path, limit=MAX_TABLE_BYTES).splitlines(), start=1)
    lines = [(number, line) for number, line in numbered if line.strip() and line.lstrip()[0] != "#"]
    if len(lines) > MAX_POSES:
        raise InputError(f"{path}: found {len(lines):,} poses, needed at most {MAX_POSES:,}")
    for number, line in lines:
        where, words = f"{path}: line {number}", line.replace(",", " ").split()
        try:
            values = [float(word) for word in words]
        except ValueError:
            raise InputError(f"{where}: found something other than numbers, {A_POSE}") from None
        yield where, values


def can_be_unrolled(observations: Observations) -> bool:
    """Whether points can be moved line by line: the shutter rolls, and the motion in each frame is known."""
    return observations.camera.readout_s > 0.0 and twists_per_s(observations) is not None


def unrolled(observations: Observations, T_camera_lidar: Pose) -> Observations:
    """Move each point to where the LiDAR would have seen it when its image line was exposed.

    The line is that of the point at a pose. A pose that is a few pixels off gives its time to some microseconds, so
    points need not be moved again while a pose is optimised. Moved points can be moved again, see
    `LabelledCloud.exposed_s`.

    Args:
        observations: Points and images; they stay as they are with a global shutter, or without a motion.
        T_camera_lidar: (4, 4), metres.
    """
    twists, camera = twists_per_s(observations), observations.camera
    if camera.readout_s == 0.0 or twists is None:
        return observations
    lens, shutter = core_camera(camera), (camera.readout_s, camera.direction)
    clouds = []
    for cloud, twist in zip(observations.clouds, twists, strict=True):
        points, exposed_s = core.unroll(
            lens, shutter, cloud.points, _exposure_s(cloud), twist, T_camera_lidar
        )
        clouds.append(replace(cloud, points=points, exposed_s=exposed_s))
    return observations.with_clouds(clouds)


def points_at(observations: Observations, frame: int, T_camera_lidar: Pose) -> npt.NDArray[np.float32]:
    """Return the points (N, 3) of a frame as `unrolled` moves them at a pose (4, 4), metres."""
    (cloud,) = unrolled(observations.of_cue(0).of_frames([frame]), T_camera_lidar).clouds
    return cloud.points


def exposed_as(observations: Observations, others: Observations) -> Observations:
    """Move each point to the moment at which it is seen in other observations of the same clouds.

    Args:
        observations: Points and images, with a twist in each frame.
        others: The same ones with the line times of another camera or another time offset.
    """
    clouds = []
    for cloud, other, along in zip(observations.clouds, others.clouds, _at_twists(observations), strict=True):
        assert other.exposed_s is not None
        points = along.compensate(cloud.points, _exposure_s(cloud) - other.exposed_s, 0.0)
        clouds.append(replace(cloud, points=points, exposed_s=other.exposed_s))
    return observations.with_clouds(clouds)


def shutter_error_px(drive: Drive, sweeps: Sequence[npt.NDArray[np.float32]]) -> float | None:
    """Estimate the median displacement of the points, in pixels, by a rolling shutter that is not compensated.

    Args:
        drive: The drive.
        sweeps: Points (N, 3) of some frames, metres, LiDAR frame.

    Returns:
        Pixels; None unless the shutter rolls and the drive has a speed without a direction.
    """
    motion, readout_s = drive.motion, drive.camera.readout_s
    if readout_s == 0.0 or motion is None or motion.speed_m_s is None:
        return None
    ranges_m = [np.linalg.norm(points, axis=1) for points in sweeps]
    shift_m = MEAN_SHARE * readout_s * motion.speed_m_s * MEAN_SINE
    shifts = shift_m / np.maximum(np.concatenate(ranges_m), MIN_RANGE_M)
    return float(np.median(shifts)) * core_camera(drive.camera).pixels_per_radian


def twists_per_s(observations: Observations) -> list[Sequence[float]] | None:
    """List the twist (6,) of the LiDAR in each of `frame_observations`; None if a frame has none."""
    twists = [observed.twist_per_s for observed in observations.frame_observations]
    return [twist for twist in twists if twist is not None] if None not in twists else None


def differs(twists_per_s: Sequence[Sequence[float]]) -> bool:
    """Whether frames move differently: if all move alike, a delay looks like another camera position."""
    return bool(np.ptp(twists_per_s, axis=0).max() > MIN_DIFFERENCE)


def delayed(observations: Observations, delay_s: float) -> Observations:
    """Move the sweeps to where the LiDAR would have seen them after a delay, at the twist of each frame.

    Args:
        observations: Observations with a twist in each frame.
        delay_s: Time by which images are later, seconds.
    """
    pairs = zip(observations.clouds, _at_twists(observations), strict=True)
    return observations.with_clouds(
        cloud.with_points(along.compensate(cloud.points, np.zeros(cloud.num_points), delay_s))
        for cloud, along in pairs
    )


def _at_twists(observations: Observations) -> list[core.Trajectory]:
    twists = twists_per_s(observations)
    assert twists is not None
    return [core.Trajectory.constant(twist, 0.0) for twist in twists]


def _exposure_s(cloud: LabelledCloud) -> npt.NDArray[np.float64]:
    return np.zeros(cloud.num_points) if cloud.exposed_s is None else cloud.exposed_s
