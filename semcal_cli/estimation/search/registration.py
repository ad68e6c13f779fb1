"""Alg. 2 as in the paper: register label images with spherical images, sample correspondences, and solve PnP."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from semcal_cli import core
from semcal_cli.config import InitializationConfig
from semcal_cli.errors import CalibrationError, InputError, format_against_limit
from semcal_cli.estimation.search.pnp import solve_pnp
from semcal_cli.geometry.arrays import Matrix, Pose, Vector
from semcal_cli.geometry.poses import camera_center
from semcal_cli.geometry.twists import rotation_matrix
from semcal_cli.observations.observations import Observations
from semcal_cli.threads import thread_pool

MAX_SHARE_OUTSIDE = 0.2
"""Maximum fraction of the points outside the field of view of the `lidar:` block."""
MAX_TILT_DEG = 30.0
"""Tilt of the LiDAR against the ground from which it is also searched as if it stood upright. Rolls are searched up to
15 degrees, and ascents reach as far again."""
ALL_ROLLS_DEG = 180.0
"""`max_roll_deg` that searches all rolls."""
MIN_SINE = 1e-6
"""Below this sine of a tilt, a LiDAR is upside down, and any level axis turns it."""


@dataclass(frozen=True)
class Candidate:
    """A hypothesis that is not yet scored."""

    T_camera_lidar: Pose
    num_pairs: int | None = None
    """Number of pairs of the registration; None without a registration."""
    num_inliers: int | None = None
    """Number of inliers of PnP; None without PnP."""


def register(
    observations: Observations,
    config: InitializationConfig,
    seed: int,
    around: tuple[Pose, float] | None = None,
) -> list[Candidate]:
    """Register label images with spherical images and solve PnP for each of the best placements (Alg. 2).

    Rolls are searched around an upright LiDAR. Where the ground shows that it is not, it is turned upright, unless a
    pose is given; labels, and a search of all rolls, also take it as it is.

    Args:
        observations: Labelled points and label images.
        config: Settings of the search.
        seed: Seed of the choice of correspondences.
        around: T_camera_lidar (4, 4) and an angle in radians. Only rotations within the angle are searched, and the
            spherical images are centred at the camera, otherwise where the rays start.

    Returns:
        Candidates of each placement, sorted by its mutual information, best first.

    Raises:
        CalibrationError: sweeps and images do not overlap, or no placement leads to a pose.
        InputError: the points are not in the field of view of the drive's `lidar:` block.
    """
    if around is not None:  # All rolls around the given pose are searched.
        T = _centred(np.eye(3), camera_center(around[0]))
        return _registered(_moved(observations, T), _grid(observations), config, seed, T, around)
    origin_m, candidates = np.array(observations.origin_m), list[Candidate]()
    upright = _upright_rotation(observations)
    # Ground and objects are as alike upside down: only the classes of labels tell which way up the camera is.
    has_segments = any(cloud.partitions is not None for cloud in observations.clouds)
    if upright is None or not has_segments or config.max_roll_deg >= ALL_ROLLS_DEG:
        T = _centred(np.eye(3), origin_m)
        moved = _moved(observations, T) if origin_m.any() else observations
        candidates += _registered(moved, _grid(observations), config, seed, T)
    if upright is not None:
        T = _centred(upright, origin_m)
        moved = _moved(observations, T)
        grid = core.estimate_grid([cloud.points for cloud in moved.clouds])
        candidates += _registered(moved, grid, config, seed, T)
    return candidates


def _upright_rotation(observations: Observations) -> Matrix | None:
    """Compute the rotation (3, 3) that turns away from the ground up; None if it is up, or no ground is seen."""
    up = core.estimate_up([cloud.points for cloud in observations.clouds])
    if up is None or math.acos(np.clip(up.direction[2], -1.0, 1.0)) <= math.radians(MAX_TILT_DEG):
        return None
    axis = np.cross(up.direction, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    axis = axis / sine if sine > MIN_SINE else np.array([1.0, 0.0, 0.0])
    return rotation_matrix(axis * math.acos(np.clip(up.direction[2], -1.0, 1.0)))


def _centred(rotation: Matrix, center: Vector) -> Pose:
    """Make the transform (4, 4) that moves a centre (3,), metres, to the origin, and turns by a rotation (3, 3)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, -rotation @ center
    return T


def _moved(observations: Observations, T: Pose) -> Observations:
    """Move all points by a transform (4, 4)."""
    return observations.with_clouds(
        cloud.with_points((cloud.points @ T[:3, :3].T + T[:3, 3]).astype(np.float32))
        for cloud in observations.clouds
    )


def _registered(
    observations: Observations,
    grid: core.Grid,
    config: InitializationConfig,
    seed: int,
    T_search_lidar: Pose,
    around: tuple[Pose, float] | None = None,
) -> list[Candidate]:
    """Register, as `register` describes, with points that are moved to where directions are measured from."""
    images = core.SphericalImages(observations.core, grid)
    placements = core.register(observations.core, images, config, around)
    samples = core.sample_correspondences(
        observations.core, images, config.zoom, placements, config.num_correspondences, seed
    )

    def solve(placement: core.Hypothesis, pairs: core.Correspondences) -> Candidate | CalibrationError:
        try:
            T_camera_search, num_inliers = solve_pnp(
                pairs.points, pairs.pixels, observations.camera, config.pnp
            )
        except CalibrationError as error:
            return error
        return Candidate(T_camera_search @ T_search_lidar, placement.num_pairs, num_inliers)

    # OpenCV solves each problem on one core.
    with thread_pool() as pool:
        answers = list(pool.map(solve, placements, samples))
    candidates = [answer for answer in answers if isinstance(answer, Candidate)]
    if not candidates:
        failure = answers[-1] if answers else "no placement of the image"
        raise CalibrationError(f"no initial calibration: {failure}")
    return candidates


def _grid(observations: Observations) -> core.Grid:
    origin = np.asarray(observations.origin_m, np.float32)
    pattern = None if observations.lidar is None else observations.lidar.pattern
    if pattern is None:
        return core.estimate_grid([cloud.points - origin for cloud in observations.clouds])
    fov_up, fov_down = np.radians([pattern.fov_up_deg, pattern.fov_down_deg]).tolist()
    grid = core.scan_grid(pattern.channels, pattern.columns, fov_up, fov_down)
    columns = ((cloud.points - origin).T for cloud in observations.clouds)
    elevations = np.concatenate([np.arctan2(z, np.hypot(x, y)) for x, y, z in columns])
    bottom = grid.top - grid.rows * grid.cell_height
    outside = float(np.mean((elevations > grid.top) | (elevations < bottom)))
    if outside > MAX_SHARE_OUTSIDE:
        low, high = np.degrees(np.quantile(elevations, (0.01, 0.99)))
        share, maximum = format_against_limit(outside, MAX_SHARE_OUTSIDE, unit="%")
        raise InputError(
            f"lidar.fov_down_deg, lidar.fov_up_deg: found {share} of the points outside, needed at most "
            f"{maximum}; the points are from {low:.1f} to {high:.1f} degrees"
        )
    return grid
