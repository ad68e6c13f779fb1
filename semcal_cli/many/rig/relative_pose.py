"""The transform between two cameras by points that the first one sees at a known distance, and the second one's rays.

Pairs of matches vote for the rotation between the cameras (RANSAC: Fischler and Bolles 1981; TRIAD: Black 1964). The
transform is then fitted to all matches by Gauss-Newton steps with Cauchy's weights.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from semcal_cli.geometry.arrays import Mask, Matrix, Numbers, Pose, Rays, Vectors
from semcal_cli.geometry.poses import camera_center, cross_matrix
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.many.rig.matched_images import MIN_MATCHES

GATES_DEG = 10.0, 180.0
"""Largest angle between a ray and where the poses expect it: cameras are mostly off by 5 degrees at most, each. All
matches are tried where too few of those fit."""
NUM_VOTES, VOTE_DEG = 500, 0.5
"""Number of pairs of matches that vote, and largest angle of a match that agrees: a position that is 0.2 m off shifts a
point at 25 m by that much."""
MIN_APART = math.sin(math.radians(1.0))
"""Sine of the smallest angle between the rays of a pair; nearer ones do not tell a rotation."""
NUM_STEPS = 20
"""Number of steps of the fit, which settles within ten."""
MIN_SPREAD_RAD = math.radians(0.01)
"""Smallest scatter of matches, which are never better than that."""
PRIOR_M = 0.3
"""Standard deviation of the distance between two cameras, which distant points hardly tell."""
FITS_SPREADS = 4.0
"""Spreads of the scatter within which a match fits."""
MIN_SHARE = 0.3
"""Smallest share of the matches within the gate that fit: wrong matches agree with no rotation in such numbers."""
MAX_SPREAD_DEG = 0.5
"""Largest standard error of the rotation, over three axes: matches of a single object tell less."""


class RelativePose(NamedTuple):
    """A transform between two cameras."""

    T: Pose
    """T_to_source (4, 4), metres."""
    covariance: Matrix
    """(6, 6) of a twist on its left, by the scatter of the matches."""
    fits: Mask
    """(N,) which matches fit it."""

    @property
    def sigmas(self) -> Numbers:
        """Standard errors (6,), metres and radians."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_relative_pose(T_start: Pose, points: Vectors, rays: Rays) -> RelativePose | None:
    """Fit the transform between two cameras to matches.

    Args:
        T_start: T_to_source (4, 4) to start from. Its position is known to `PRIOR_M`.
        points: (N, 3) points of the matches, metres, in the frame of `source`.
        rays: (N, 3) unit directions of the same matches, in the frame of `to`.

    Returns:
        The transform; None if too few matches agree, or they do not tell the rotation.
    """
    for gate_deg in GATES_DEG:
        is_near = np.sum(_directions(T_start, points) * rays, axis=1) >= math.cos(math.radians(gate_deg))
        found = _fit_within(T_start, points[is_near], rays[is_near])
        if found is not None and np.linalg.norm(np.degrees(found.sigmas[3:])) <= MAX_SPREAD_DEG:
            fits = np.zeros(len(points), bool)
            fits[is_near] = found.fits
            return found._replace(fits=fits)
    return None


def _fit_within(T_start: Pose, points: Vectors, rays: Rays) -> RelativePose | None:
    """Fit the transform to the matches within a gate."""
    if len(points) < MIN_MATCHES or (voted := _vote(T_start, points, rays)) is None:
        return None
    T_voted, agrees = voted
    if agrees.sum() < MIN_MATCHES:
        return None
    T, covariance, spread = _fit(T_voted, T_start, points[agrees], rays[agrees])
    fits = np.linalg.norm(_directions(T, points) - rays, axis=1) < FITS_SPREADS * spread
    return (
        RelativePose(T, covariance, fits) if fits.sum() >= max(MIN_MATCHES, MIN_SHARE * len(points)) else None
    )


def _directions(T: Pose, points: Vectors) -> Rays:
    """Directions (N, 3) of points (N, 3) that a transform moves."""
    moved = points @ T[:3, :3].T + T[:3, 3]
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _vote(T_start: Pose, points: Vectors, rays: Rays) -> tuple[Pose, Mask] | None:
    """Turn a camera in its place by the rotation that most matches agree with.

    Returns:
        The transform (4, 4), and which matches (N,) agree; None if all rays are alike.
    """
    expected, rng = _directions(T_start, points), np.random.default_rng(0)
    first, second = rng.integers(len(points), size=(2, NUM_VOTES))
    apart = [np.linalg.norm(np.cross(side[first], side[second]), axis=1) for side in (rays, expected)]
    is_pair = np.minimum(*apart) > MIN_APART
    if not is_pair.any():
        return None
    first, second = first[is_pair], second[is_pair]
    rotations = np.einsum(
        "nij,nkj->nik", _axes(rays[first], rays[second]), _axes(expected[first], expected[second])
    )
    cosines = np.einsum("nij,mj,mi->nm", rotations, expected, rays, optimize=True)
    agrees = cosines > math.cos(math.radians(VOTE_DEG))
    best = int(np.argmax(agrees.sum(axis=1)))
    T: Pose = T_start.copy()
    T[:3] = rotations[best] @ T_start[:3]
    return T, agrees[best]


def _axes(first: Rays, second: Rays) -> Numbers:
    """Orthonormal axes (N, 3, 3), in columns, of pairs of rays that are apart."""
    across = np.cross(first, second)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([first, across, np.cross(first, across)], axis=2)


def _fit(T: Pose, T_start: Pose, points: Vectors, rays: Rays) -> tuple[Pose, Matrix, float]:
    """Fit a transform to matches, with a weak prior of the camera's place at the start.

    Returns:
        The transform (4, 4), the covariance (6, 6) of a twist on its left, and the scatter of matches in radians.
    """
    prior, center = np.diag([PRIOR_M**-2] * 3 + [0.0] * 3), camera_center(T_start)
    for _ in range(NUM_STEPS):
        moved = points @ T[:3, :3].T + T[:3, 3]
        ranges = np.linalg.norm(moved, axis=1)
        directions = moved / ranges[:, None]
        residuals = directions - rays
        # A direction changes by what of a shift is across it: (I - d d^T) (rho + phi x p) / |p|.
        across = (np.eye(3) - np.einsum("ni,nj->nij", directions, directions)) / ranges[:, None, None]
        turned = -np.array([cross_matrix(point) for point in moved])
        slopes = np.concatenate([across, across @ turned], axis=2)
        sizes = np.linalg.norm(residuals, axis=1)
        # The median of a size in two dimensions is 1.18 standard deviations.
        spread = max(float(np.median(sizes)) / 1.18, MIN_SPREAD_RAD)
        weights = 1.0 / (1.0 + (sizes / (2.0 * spread)) ** 2) / spread**2
        information = np.einsum("n,nki,nkj->ij", weights, slopes, slopes) + prior
        pull = np.einsum("n,nki,nk->i", weights, slopes, residuals)
        # The camera has moved by -R^T of what is left of its old centre in its frame.
        pull += prior @ np.concatenate([T[:3, :3] @ center + T[:3, 3], np.zeros(3)])
        T = apply_twist(T, -np.linalg.solve(information, pull))
    return T, np.linalg.inv(information), spread
