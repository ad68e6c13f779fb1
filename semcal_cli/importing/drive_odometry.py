"""Odometry of a drive: the motion of the LiDAR, estimated from the consecutive sweeps of the frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, counted
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.importing.stamps import MAX_GAP_NS, are_covered, tum_text
from semcal_cli.importing.sweep_odometry import Odometry, odometry_remark
from semcal_cli.observations.point_times import checked_times


class DriveMotion(NamedTuple):
    """The motion of a drive, estimated from its sweeps."""

    poses: dict[int, Pose]
    """Poses (4, 4) of the LiDAR, by their times in nanoseconds."""
    doubtful_ns: list[int]
    """Times at which the motion is doubtful; poses near them are left out."""
    uncovered: list[str]
    """Sweeps of frames without poses close before and after them."""
    point_times: str
    """`relative`, `absolute` or `deskewed`, for `point_times` of the `motion:` block."""
    assumption: tuple[str, ...] = ()
    """A sentence about sweeps that are taken as deskewed though the drive does not state it; none if there are none."""

    def tum(self) -> str:
        """Format the poses, one per line (see `tum_text`), after a comment that says what estimated them."""
        return f"# {odometry_remark()}\n{tum_text(self.poses)}"


def drive_motion(drive: Drive, on_event: Listener = ignore) -> DriveMotion:
    """Estimate the motion of the LiDAR in a drive of consecutive sweeps. One sweep is in memory at a time.

    Sweeps whose points have no times, neither their own nor by the LiDAR's spin, are assumed to be deskewed to their
    stamp, as are those of a drive whose `motion` says so.

    Raises:
        InputError: a frame has no stamp, a file cannot be read, point times cannot be seconds or do not belong to the
            stamps, or the sweeps are not consecutive.
    """
    odometry, is_absolute, num_untimed = Odometry(), False, 0
    frames = {frame.points: frame for frame in drive.frames}
    moments_s = _moments(drive)
    stamps_s = sorted(((name, moments[0]) for name, moments in moments_s.items()), key=lambda item: item[1])
    for index, (name, stamp_s) in enumerate(stamps_s):
        on_event(Progress("estimating the motion from the sweeps", index, len(stamps_s)))
        (cloud,) = read_point_clouds([(drive.resolve(name), None)], drive.max_points, drive.point_form)
        times_s, is_on_clock = checked_times(drive, frames[name], cloud, None) or (None, False)
        if times_s is not None and is_on_clock:
            is_absolute, times_s = True, times_s - stamp_s
        num_untimed += times_s is None
        odometry.add(cloud.points, times_s, round(stamp_s * NS))
        moments_s[name] += [stamp_s + end for end in _ends(times_s)]
    poses = odometry.poses()
    _check_consecutive(drive, poses, [stamp_s for _, stamp_s in stamps_s])
    stamps_ns = list(poses)
    uncovered = [
        name
        for name, _ in stamps_s
        if not are_covered(stamps_ns, [round(moment_s * NS) for moment_s in moments_s[name]])
    ]
    reference = "absolute" if is_absolute else "relative"
    if drive.motion is not None and drive.motion.point_times == "deskewed":
        reference, num_untimed = "deskewed", 0
    assumption = (
        f"{num_untimed:,} of {counted(len(stamps_s), 'sweep')} have no point times, and are taken as deskewed to "
        "points_stamp: if the LiDAR turns and nothing deskewed them, the motion is distorted, and lidar.spin in "
        "drive.yaml gives the times",
    )
    return DriveMotion(poses, odometry.doubtful_ns, uncovered, reference, assumption if num_untimed else ())


def _moments(drive: Drive) -> dict[str, list[float]]:
    """List the stamp of each sweep and the times of its images, in seconds, by the name of its file."""
    moments_s = dict[str, list[float]]()
    for frame in drive.frames:
        if frame.points_stamp is None:
            problem = f"{drive.path}: {frame.key('points_stamp')}: found nothing"
            raise InputError(f"{problem}, expected the time of the sweep for odometry")
        moments = moments_s.setdefault(frame.points, [frame.points_stamp])
        moments.append(frame.image_stamp or frame.points_stamp)
    return moments_s


def _check_consecutive(drive: Drive, poses: Mapping[int, Pose], stamps_s: Sequence[float]) -> None:
    gaps_s = np.diff(stamps_s)
    if not poses or np.median(gaps_s) > MAX_GAP_NS / NS:
        problem = f"found {counted(len(stamps_s), 'sweep')}" + (
            f", {np.median(gaps_s):.3g} s apart" if len(gaps_s) else ""
        )
        needed = f"expected consecutive ones, at most {MAX_GAP_NS / NS:g} s apart"
        raise InputError(
            f"{drive.path}: {problem}, {needed}; `import bag --odometry` reads all sweeps of a recording"
        )


def _ends(times_s: Numbers | None) -> list[float]:
    return [] if times_s is None else [float(np.nanmin(times_s)), float(np.nanmax(times_s))]
