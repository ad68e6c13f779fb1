"""LiDAR odometry: the motion of a LiDAR from its own consecutive sweeps, by KISS-ICP.

Source: Vizzo et al., *KISS-ICP* (RA-L 2023), from the extra `odometry`. As there, a sweep is deskewed with the motion
up to the sweep before. Unlike there, the times of its points are used as they are: these need not fill the time from
one sweep to the next, and recordings lose sweeps.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config.nanoseconds import NS
from semcal_cli.geometry.arrays import Numbers, Points, Pose
from semcal_cli.geometry.poses import orthonormal
from semcal_cli.importing.cell_shapes import MIN_SHARE, constraint_shares, voxel_keys
from semcal_cli.importing.stamps import MAX_GAP_NS
from semcal_cli.observations.motion import displacement

RANGES_M = 1.5, 100.0
"""Ranges of the points that are used. Nearer ones may lie on the vehicle itself and would suggest a standstill."""
VOXEL_M = 1.0
MAX_ITERATIONS = 50
"""Maximum number of iterations of one registration, a tenth of KISS-ICP's own: sweeps that do not fit would take all.
Twelve sweeps each of KITTI-360 and of two drives of KITTI raw get the same poses with 500, to the last bit."""
NUM_WARM_UPS = 4
"""How many times the first two sweeps are registered, each time deskewed with the motion found before."""
SPEEDS_M_S = np.linspace(-40.0, 40.0, 81)
OVERLAP_M, CLEAR_OVERLAP = 0.5, 0.003
"""Speeds that are tried for the first two sweeps, side of the voxels in which they overlap, and how much larger the
overlap of one of two motions must be, as a share of the points."""
MAX_CHANGE_M_S, MAX_CHANGE_RAD_S = 3.0, 1.0
"""Largest change of the motion from one sweep to the next; a car that brakes hard loses 1 m/s in 0.1 s."""
SIGMA = {"linear_m_s": 0.1, "angular_rad_s": 0.01}
"""Standard deviations of the velocities between poses, for `motion: sigma:`. They are 0.09 m/s and 0.008 rad/s over
0.4 s on three drives of KITTI raw, and less on synthetic streets (`tests/benchmarks/odometry.py`)."""
MAX_RESTARTS, SWEEPS_A_RESTART = 2, 10
"""Maximum number of times that the odometry starts anew after a jump, and number of sweeps after which once more: a
start registers two sweeps eight times. Where it may not start anew, sweeps are doubtful."""
MAX_SWEEP_POINTS, MAX_SWEEP_CELLS = 500_000, 10_000
"""Maximum number of points that are registered, and of the voxels that they fill: more are thinned. KISS-ICP registers
one point a voxel; sweeps of 64 channels of KITTI, KITTI-360 and RELLIS-3D fill 2,800 to 3,000."""
DOUBTFUL_NS = NS // 2
"""Time before and after a doubtful sweep in which no pose is trusted."""


class _Sweep(NamedTuple):
    points: Points
    times_s: Numbers
    """(N,) seconds after `moment_ns`."""
    moment_ns: int
    """Middle of the times of its points, for which its pose is estimated."""


def odometry_remark() -> str:
    """Return the sentence that names the software which estimates the poses, with its version."""
    return f"KISS-ICP {version('kiss-icp')} estimates the motion of the LiDAR from the sweeps"


class Odometry:
    """Poses of a LiDAR, estimated sweep by sweep. Memory grows by one pose per sweep.

    The same sweeps give the same poses, to the last bit: KISS-ICP runs on one thread here.
    """

    def __init__(self) -> None:
        """Start without sweeps."""
        self.doubtful_ns: list[int] = []
        """Times at which the motion jumped or was unobservable in one direction, such as between a tunnel's walls."""
        self._stretches: list[dict[int, Pose]] = []
        self._num_sweeps, self._num_restarts, self._is_lost = 0, 0, False
        self._first: _Sweep | None = None
        self._kiss: Any = None
        self._last_ns = 0
        self._last_pose: Pose = np.eye(4)
        self._twist_per_s = [0.0] * 6

    def add(self, points: Points, times_s: Numbers | None, stamp_ns: int) -> None:
        """Estimate the pose of the next sweep. A sweep that is not later than the one before is left out.

        Args:
            points: (N, 3) metres, each in the LiDAR frame of its own time. Points without a range are ignored.
            times_s: (N,) seconds after the stamp; None for a sweep that was deskewed to it.
            stamp_ns: Time of the sweep.
        """
        sweep = _sweep(points, times_s, stamp_ns)
        gap_ns = sweep.moment_ns - self._last_ns
        if self._stretches and gap_ns <= 0:
            return
        self._num_sweeps += 1
        if self._is_lost:
            self._restart(sweep)
        elif not self._stretches or gap_ns > MAX_GAP_NS:
            self._begin(sweep)
        elif self._first is not None:
            self._begin_motion(self._first, sweep)
        else:
            self._go_on(sweep)

    def poses(self) -> dict[int, Pose]:
        """Return poses (4, 4) of the LiDAR in a fixed frame, by their times in nanoseconds, none near doubtful ones.

        Each stretch without gaps gets one more pose before its first sweep and after its last, as if the motion went
        on: the points of these sweeps reach beyond the moments of their poses.
        """
        all_poses: dict[int, Pose] = {}
        for stretch in self._stretches:
            if len(stretch) > 1:
                poses = list(stretch.items())
                all_poses |= dict([_extrapolate(poses[2::-1]), *poses, _extrapolate(poses[-3:])])
        doubtful_ns = sorted(self.doubtful_ns)

        def is_trusted(stamp: int) -> bool:
            after = bisect_left(doubtful_ns, stamp - DOUBTFUL_NS)
            return after == len(doubtful_ns) or doubtful_ns[after] > stamp + DOUBTFUL_NS

        return {stamp: T for stamp, T in all_poses.items() if is_trusted(stamp)}

    def doubts(self, start_ns: int) -> list[str]:
        """Describe which frames are left out because the motion is doubtful, in times after a start; [] if none."""
        if not self.doubtful_ns:
            return []
        count, first_s = len(self.doubtful_ns), (self.doubtful_ns[0] - start_ns) / NS
        when = f"at {count:,} of them, first {first_s:.1f} s after the start"
        left_out = f"frames within {DOUBTFUL_NS / NS:g} s are left out"
        return [f"the motion estimated from the sweeps is doubtful {when}: {left_out}"]

    def _begin(self, sweep: _Sweep) -> None:
        """Start a stretch with a sweep, at the last known pose."""
        self._first = sweep
        self._stretches.append({})
        self._keep(sweep, self._last_pose)

    def _begin_motion(self, first: _Sweep, second: _Sweep) -> None:
        """Register the first two sweeps repeatedly: the motion between them deskews both."""
        self._first = None
        motions = []
        for start in ([0.0] * 6, _best_speed(first, second)):
            self._twist_per_s = start
            for _ in range(NUM_WARM_UPS):
                self._kiss = _kiss_icp()
                self._kiss.last_pose = self._last_pose
                self._register(first, 0)
                self._twist_per_s = self._register(second, second.moment_ns - first.moment_ns)
            motions.append((_overlap(first, second, self._twist_per_s), self._kiss, self._twist_per_s))
        (second_best, _, twist), (best, self._kiss, self._twist_per_s) = sorted(
            motions, key=lambda motion: motion[0]
        )
        if _jumps(twist, self._twist_per_s) and best - second_best < CLEAR_OVERLAP:
            self._doubt(second)
        self._keep(second, self._kiss.last_pose)

    def _go_on(self, sweep: _Sweep) -> None:
        before, self._twist_per_s = self._twist_per_s, self._register(sweep, sweep.moment_ns - self._last_ns)
        if _jumps(before, self._twist_per_s):
            self._doubt(sweep)
            self._restart(sweep)
        else:
            self._keep(sweep, self._kiss.last_pose)

    def _restart(self, sweep: _Sweep) -> None:
        """Start a stretch after a jump, if there were not too many."""
        self._is_lost = self._num_restarts >= MAX_RESTARTS + self._num_sweeps // SWEEPS_A_RESTART
        if self._is_lost:
            self._doubt(sweep)
        else:
            self._num_restarts += 1
            self._begin(sweep)

    def _doubt(self, sweep: _Sweep) -> None:
        if sweep.moment_ns not in self.doubtful_ns[-2:]:
            self.doubtful_ns.append(sweep.moment_ns)

    def _keep(self, sweep: _Sweep, T: Pose) -> None:
        self._last_ns, self._last_pose = sweep.moment_ns, orthonormal(T)
        self._stretches[-1][self._last_ns] = self._last_pose

    def _register(self, sweep: _Sweep, step_ns: int) -> list[float]:
        """Register a sweep `step_ns` after the one before, and return the twist (6,) per second between them."""
        motion, before = core.Trajectory.constant(self._twist_per_s, 0.0), self._kiss.last_pose
        self._kiss.last_delta = displacement(motion, 0.0, step_ns / NS)
        points = motion.compensate(sweep.points, sweep.times_s, 0.0).astype(np.float64)
        if constraint_shares(points)[0][0] < MIN_SHARE:
            self._doubt(sweep)
        self._kiss.register_frame(points, np.empty(0))
        if step_ns == 0:
            return self._twist_per_s
        return twist_from(before, self._kiss.last_pose, step_ns / NS)


def _best_speed(first: _Sweep, second: _Sweep) -> list[float]:
    """Find the velocity along the least constrained direction at which two sweeps overlap most.

    Where a sweep sees little but walls and ground, registration that starts from a standstill finds a standstill.

    Returns:
        A twist (6,) per second.
    """
    _, axes = constraint_shares(first.points.astype(np.float64))
    twists = [[*(speed_m_s * axes[:, 0]), 0.0, 0.0, 0.0] for speed_m_s in SPEEDS_M_S]
    return max(twists, key=lambda twist: _overlap(first, second, twist))


def _overlap(first: _Sweep, second: _Sweep, twist_per_s: Sequence[float]) -> float:
    """Compute the share of the second sweep's points that lie in a voxel with points of the first, for a motion."""
    motion, seconds = core.Trajectory.constant(twist_per_s, 0.0), (second.moment_ns - first.moment_ns) / NS
    before = voxel_keys(motion.compensate(first.points, first.times_s, 0.0), OVERLAP_M)
    after = voxel_keys(motion.compensate(second.points, second.times_s + seconds, 0.0), OVERLAP_M)
    return float(np.isin(after, before).mean()) if len(after) else 0.0


def _jumps(before: Sequence[float], after: Sequence[float]) -> bool:
    change = np.subtract(after, before)
    return bool(np.linalg.norm(change[:3]) > MAX_CHANGE_M_S or np.linalg.norm(change[3:]) > MAX_CHANGE_RAD_S)


def _sweep(points: Points, times_s: Numbers | None, stamp_ns: int) -> _Sweep:
    times_s = np.zeros(len(points)) if times_s is None else times_s
    ranges_m = np.linalg.norm(points, axis=1)
    counts = (ranges_m > RANGES_M[0]) & (ranges_m < RANGES_M[1]) & np.isfinite(times_s)
    kept = _thinned(np.flatnonzero(counts), points)
    points, times_s = np.ascontiguousarray(points[kept], np.float32), times_s[kept].astype(np.float64)
    middle_s = 0.5 * (times_s.min() + times_s.max()) if len(times_s) else 0.0
    return _Sweep(points, times_s - middle_s, stamp_ns + round(middle_s * NS))


def _thinned(indices: npt.NDArray[np.intp], points: Points) -> npt.NDArray[np.intp]:
    """Keep fewer of the points with these indices if there are too many, or if they fill too many voxels."""
    indices = indices[:: -(-len(indices) // MAX_SWEEP_POINTS) or 1]
    if len(indices) <= MAX_SWEEP_CELLS:
        return indices
    cells = voxel_keys(points[indices], VOXEL_M)
    filled = np.unique(cells)
    if len(filled) <= MAX_SWEEP_CELLS:
        return indices
    return indices[np.isin(cells, filled[:: -(-len(filled) // MAX_SWEEP_CELLS)])]


def _extrapolate(poses: Sequence[tuple[int, Pose]]) -> tuple[int, Pose]:
    """Extrapolate by one step, forward or backward, the motion through two or three poses with their times."""
    (start_ns, start), (before_ns, _), (end_ns, end) = poses[0], poses[-2], poses[-1]
    step_ns = max(-MAX_GAP_NS // 2, min(end_ns - before_ns, MAX_GAP_NS // 2))
    motion = core.Trajectory.constant(twist_from(start, end, abs(end_ns - start_ns) / NS), 0.0)
    return end_ns + step_ns, end @ displacement(motion, 0.0, abs(step_ns) / NS)


def twist_from(start: Pose, end: Pose, seconds: float) -> list[float]:
    """Compute the twist (6,) per second that leads from one pose (4, 4) to another."""
    return core.Trajectory.through([0.0, seconds], [orthonormal(start), orthonormal(end)]).twist_at(0.0)


def _kiss_icp() -> Any:
    from kiss_icp.config import KISSConfig
    from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
    from kiss_icp.kiss_icp import KissICP

    return KissICP(
        KISSConfig(
            data=DataConfig(min_range=RANGES_M[0], max_range=RANGES_M[1], deskew=False),
            mapping=MappingConfig(voxel_size=VOXEL_M),
            registration=RegistrationConfig(max_num_threads=1, max_num_iterations=MAX_ITERATIONS),
        )
    )
