"""Registration of the sweeps of two LiDARs of a rig, where they overlap, by the extra `registration`.

Each pair of sweeps of one moment is registered by itself with small_gicp (Koide, *small_gicp: Efficient and parallel
algorithms for point cloud registration*, JOSS 2024). What the pairs say together is their robust mean, by weights of
Student's t, and its covariance is that of their scatter: the Hessian of a registration takes thousands of neighbouring
points as independent, and is far too confident. It only tells whether the scene holds the pose in all directions: in a
tunnel, all pairs stay where they started. Sweeps are registered as they were recorded: what moves during a sweep is not
deskewed, so that drives at a standstill say most.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import check_installed, counted
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.files.validation import Count, StatedTransform, StrictModel, Width, Widths, length
from semcal_cli.geometry.arrays import Matrix, Numbers, Points, Pose, Vectors
from semcal_cli.geometry.poses import orthonormal
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.many.rig.rig_document import FIRST_LIDAR
from semcal_cli.many.rig.rig_estimate import MANY, twist_between
from semcal_cli.many.rig.rig_uncertainty import rows
from semcal_cli.many.rig.shared_clouds import cloud_path
from semcal_cli.many.rig.ties import Tie
from semcal_cli.observations.frame_selection import evenly_spaced
from semcal_cli.observations.reading import read_clouds
from semcal_cli.result.uncertainty import Uncertainty

MAX_PAIRS, MIN_PAIRS = 30, 5
"""Largest number of pairs of sweeps that are registered, and smallest number whose scatter is meaningful."""
SAME_MOMENT_S = 1e-3
"""Largest difference of the stamps of two sweeps of one moment, in seconds: 3 cm at 30 m/s."""
RANGES_M = 1.5, 80.0
"""Ranges of the points that are registered: nearer ones may lie on the vehicle itself."""
STEPS_M = (0.5, 2.0), (0.2, 0.5)
"""Side of the voxels and largest distance of corresponding points, first coarse, then fine."""
CONVERGED = {"max_iterations": 50, "rotation_epsilon": 1e-5, "translation_epsilon": 1e-4}
"""When the steps of a registration are small enough, in radians and metres. By default, a turn of 0.1 degrees is."""
MIN_OVERLAP = 0.3
"""Smallest share of the points of a sweep that have a corresponding one."""
MAX_JUMP_M, MAX_JUMP_DEG = 0.5, 5.0
"""Farthest that a registration may lead from its start. Its start, from cameras, is nearer by far, unless one is wrong
by degrees, which the registration is to show."""
MIN_STIFFNESS = np.repeat([5.0, 2.0], 3)
"""Smallest stiffness against shifts and turns, where a surface counts about 500 along its normal and 0.5 across it, so
that 1 % of the points have to face every direction. Synthetic tunnels and round rooms have 0.6, and the ground of
sweeps of KITTI, KITTI-360 and nuScenes up to 1.7 against shifts; streets of these have at least 6.9 and 4.4, and roads
through fields 3.1, which is left out."""
FLOOR_M, FLOOR_DEG = 0.002, 0.01
"""Smallest standard error of the mean: what all pairs of sweeps have in common, such as the pattern of the scan, does
not show in their scatter."""
OF_UNKNOWN_MOMENTS = (
    "may be of different moments: state points_stamp, `synchronization: hardware` if one signal triggers all, or "
    "`motion: {speed_m_s: 0}` if the rig stood"
)
_Place: TypeAlias = tuple[Drive, Frame]
"""A frame with its drive."""
TAIL = 4.0
"""Degrees of freedom of Student's t for the scatter of pairs."""
NUM_ROUNDS = 20
"""Number of rounds of weights, which settle within a few."""


class Registration(StrictModel):
    """Registration of the sweeps of a further LiDAR with those of the first one."""

    T_lidar_further: StatedTransform
    """The transform in metres, p_first = T_lidar_further * p_further."""
    num_pairs: Annotated[int, Field(ge=MIN_PAIRS)]
    """Number of pairs of sweeps that were used."""
    num_left_out: Count
    """Number of pairs that were left out: of other moments, or whose registration cannot be relied on."""
    sigma_m: Widths
    """Standard errors of the position along the axes of the first LiDAR, in metres."""
    sigma_deg: Widths
    """Standard errors of the rotation about them, in degrees."""
    degrees_of_freedom: Annotated[tuple[Width, ...], length(6, 6)]
    """Degrees of freedom of Student's t of the six."""
    software: str
    """Software that registered them, with its version."""

    def tie(self, lidar: str) -> Tie:
        """Make the tie of the two LiDARs."""
        T = np.array(self.T_lidar_further)
        covariance = np.diag(np.array([*self.sigma_m, *np.radians(self.sigma_deg)]) ** 2)
        uncertainty = Uncertainty.from_covariance(T, covariance, np.array(self.degrees_of_freedom))
        return Tie("registration", FIRST_LIDAR, lidar, T, covariance, uncertainty)


class SweepPair(NamedTuple):
    """Sweeps of two LiDARs of one moment."""

    first: Points
    """(N, 3) metres, in the frame of the first LiDAR."""
    further: Points
    """(M, 3) metres, in the frame of the further one."""


class SweepPairs(NamedTuple):
    """Pairs of sweeps of two LiDARs."""

    pairs: tuple[SweepPair, ...]
    left_out: Counter[str] = Counter()
    """Number of pairs that may be of different moments, by what is wrong with them."""


class NotRegistered(NamedTuple):
    """Why the sweeps of two LiDARs have no registration."""

    num_pairs: int
    """Number of pairs that could be registered."""
    left_out: Counter[str]
    """Number of others, by what is wrong with them."""

    @property
    def reason(self) -> str:
        """The numbers and causes in words."""
        causes = "".join(f"; {count} {cause}" for cause, count in self.left_out.items())
        total = counted(self.num_pairs + self.left_out.total(), "pair")
        return f"{self.num_pairs} of {total} of sweeps could be, needed {MIN_PAIRS}{causes}"


def check_registration(key: str) -> None:
    """Check that small_gicp, which registers sweeps, is installed.

    Raises:
        InputError: it is not; the message begins with `key`.
    """
    check_installed(key, "small_gicp", "registration")


def read_sweep_pairs(
    first: Sequence[Drive], further: Sequence[Drive], sweeps: SweepCache | None = None
) -> SweepPairs:
    """Read the sweeps of two LiDARs of the same moments: those that drives pair with one image, or stamp alike.

    Args:
        first: Drives of the first LiDAR.
        further: Drives of the further one.
        sweeps: Sweeps that were read before.

    Raises:
        InputError: a sweep is missing or wrong.
    """
    places = {key: place for place in _frames(first) for key in _keys(*place)}
    paired = dict[str, tuple[_Place, _Place]]()
    for drive, frame in _frames(further):
        other = next((places[key] for key in _keys(drive, frame) if key in places), None)
        if other is not None:
            paired.setdefault(str(cloud_path(drive, frame.points)), (other, (drive, frame)))
    doubts = {name: _doubt_of_moment(*both) for name, both in paired.items()}
    chosen = evenly_spaced([both for name, both in paired.items() if doubts[name] is None], MAX_PAIRS)
    pairs = tuple(SweepPair(*(_points(*place, sweeps) for place in both)) for both in chosen)
    return SweepPairs(pairs, Counter(doubt for doubt in doubts.values() if doubt is not None))


def register_sweeps(sweeps: SweepPairs, T_start: Pose) -> Registration | NotRegistered:
    """Register sweeps of two LiDARs.

    Args:
        sweeps: Pairs of sweeps.
        T_start: (4, 4) start, p_first = T_start p_further, metres.

    Returns:
        What the pairs say together, or why fewer than `MIN_PAIRS` could be registered.
    """
    results = [_register(pair, T_start) for pair in sweeps.pairs]
    registered = [T for T in results if not isinstance(T, str)]
    left_out = sweeps.left_out + Counter(cause for cause in results if isinstance(cause, str))
    if len(registered) < MIN_PAIRS:
        return NotRegistered(len(registered), left_out)
    mean, scatter = robust_mean_of_vectors(np.array([twist_between(T, T_start) for T in registered]))
    errors = np.hypot(scatter, np.repeat([FLOOR_M, math.radians(FLOOR_DEG)], 3))
    # Only the scatter is estimated (Satterthwaite). The weights cost about as much as one more value.
    freedom = (len(registered) - 2) * (errors / np.maximum(scatter, errors / MANY)) ** 4
    return Registration(
        T_lidar_further=rows(orthonormal(apply_twist(T_start, mean))),
        num_pairs=len(registered),
        num_left_out=left_out.total(),
        sigma_m=tuple(errors[:3].tolist()),
        sigma_deg=tuple(np.degrees(errors[3:]).tolist()),
        degrees_of_freedom=tuple(np.minimum(freedom, MANY).tolist()),
        software=f"small_gicp {version('small_gicp')}",
    )


def robust_mean_of_vectors(values: Vectors) -> tuple[Numbers, Numbers]:
    """Compute the mean of vectors, in which a few may be far off, by weights of Student's t.

    Args:
        values: (N, k), at least two.

    Returns:
        The mean (k,) and its standard errors (k,), by the scatter of the values.
    """
    mean = np.median(values, axis=0)
    scale = np.maximum(1.4826 * np.median(np.abs(values - mean), axis=0), np.finfo(float).tiny)
    count, size = values.shape
    for _ in range(NUM_ROUNDS):
        weights = (TAIL + size) / (TAIL + (((values - mean) / scale) ** 2).sum(axis=1))
        mean = weights @ values / weights.sum()
        scale = np.sqrt(weights @ (values - mean) ** 2 / count).clip(min=np.finfo(float).tiny)
    # The covariance of an M-estimate: weights fall where values are far off, so that they pull by less than they weigh.
    squared = ((values - mean) / scale) ** 2
    weights = (TAIL + size) / (TAIL + squared.sum(axis=1))
    pull = weights.sum() - 2.0 * weights**2 @ squared / (TAIL + size)
    squares = weights**2 @ (values - mean) ** 2 / pull**2
    return mean, np.sqrt(squares * count / (count - 1))


def _register(pair: SweepPair, T_start: Pose) -> Pose | str:
    """Register two sweeps, or describe what is wrong with them."""
    import small_gicp

    T = T_start
    for voxel_m, distance_m in STEPS_M:
        (target, tree), (source, _) = (
            small_gicp.preprocess_points(points.astype(float), voxel_m) for points in pair
        )
        result = small_gicp.align(
            target, source, tree, T, max_correspondence_distance=distance_m, num_threads=1, **CONVERGED
        )
        T = result.T_target_source
    if not (result.converged and np.isfinite(T).all()):
        return "do not converge"
    if result.num_inliers < MIN_OVERLAP * source.size():
        return f"overlap by less than {MIN_OVERLAP:.0%}".replace("%", " %")
    moved = twist_between(T, T_start)
    if np.linalg.norm(moved[:3]) > MAX_JUMP_M or np.linalg.norm(moved[3:]) > math.radians(MAX_JUMP_DEG):
        return f"end more than {MAX_JUMP_M:g} m or {MAX_JUMP_DEG:g} degrees from the start"
    ranges_squared = (source.points()[:, :3] ** 2).sum(axis=1).mean()
    if (stiffness(result.H / result.num_inliers, ranges_squared) < MIN_STIFFNESS).any():
        return "do not hold the pose in all directions, as in a tunnel"
    return np.asarray(T)


def stiffness(H: Matrix, ranges_squared: float) -> Numbers:
    """Compute how much the points resist shifts and turns of a sweep.

    Args:
        H: (6, 6) Hessian for each point, of the rotation, then the position.
        ranges_squared: Mean square of their ranges, square metres.

    Returns:
        Three eigenvalues against shifts, in whatever way the sweep turns with them, and three against turns, likewise.
    """
    turn_block, shift_block, mixed = H[:3, :3], H[3:, 3:], H[3:, :3]
    against_shifts = shift_block - mixed @ np.linalg.pinv(turn_block) @ mixed.T
    against_turns = turn_block - mixed.T @ np.linalg.pinv(shift_block) @ mixed
    return np.concatenate(
        [np.linalg.eigvalsh(against_shifts), np.linalg.eigvalsh(against_turns) / ranges_squared]
    )


def _frames(drives: Sequence[Drive]) -> list[_Place]:
    return [(drive, frame) for drive in drives for frame in drive.frames]


def _keys(drive: Drive, frame: Frame) -> list[object]:
    """Return what may identify the moment of a sweep: the image that was taken with it, and its stamp."""
    image = [] if frame.image is None else [cloud_path(drive, frame.image)]
    return [*image, *([] if frame.points_stamp is None else [frame.points_stamp])]


def _doubt_of_moment(first: _Place, further: _Place) -> str | None:
    """Describe why two sweeps may be of different moments; None if they are of one, or if the rig stood still."""
    drives = [drive for drive, _ in (first, further)]
    stamps = [frame.points_stamp for _, frame in (first, further) if frame.points_stamp is not None]
    if all(drive.motion is not None and drive.motion.speed_m_s == 0.0 for drive in drives):
        return None
    if len(stamps) == len(drives):
        is_same = abs(stamps[0] - stamps[1]) <= SAME_MOMENT_S
        return None if is_same else "are of different moments by their points_stamp"
    return None if all(drive.synchronization == "hardware" for drive in drives) else OF_UNKNOWN_MOMENTS


def _points(drive: Drive, frame: Frame, sweeps: SweepCache | None) -> Points:
    """Read the points of a sweep in the range that is registered."""
    (cloud,) = read_clouds(drive.model_copy(update={"frames": (frame,)}), sweeps)
    ranges_m = np.linalg.norm(cloud.points, axis=1)
    return np.asarray(cloud.points[(ranges_m > RANGES_M[0]) & (ranges_m < RANGES_M[1])])
