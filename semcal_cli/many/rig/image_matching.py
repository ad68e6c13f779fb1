"""Transforms between two cameras of a rig by their images, where these overlap.

Features of two images (SIFT: Lowe, *Distinctive image features from scale-invariant keypoints*, IJCV 2004) that were
taken with one sweep are matched, and the points of the sweep around a feature say how far away it is. Pairs of matches
vote for the rotation between the cameras (RANSAC: Fischler and Bolles 1981; TRIAD: Black 1964); the transform is then
fitted to all matches by robust least squares. The distances hardly depend on the poses of the cameras, which may be off
by degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np

from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import Array, Matrix, Numbers, Points, Pose, Rays, Vectors
from semcal_cli.geometry.poses import cross_matrix, inverse, orthonormal
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.many.rig.matched_images import MIN_MATCHES, MatchedImages
from semcal_cli.many.rig.rig_uncertainty import rows
from semcal_cli.many.rig.shared_clouds import cloud_path, content_key
from semcal_cli.observations.frame_selection import evenly_spaced, with_frames
from semcal_cli.observations.masks import seen_pixels
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.reading import read_clouds, read_needed_image
from semcal_cli.threads import thread_pool

MAX_FRAMES = 10
"""Largest number of frames of two cameras whose images are matched."""
PIXEL_DEG = 0.1
"""Least angle of a pixel of the images that features are found in; finer ones are shrunk, to save time."""
NUM_FEATURES = 8000
"""Largest number of features of an image, the strongest ones."""
RATIO = 0.8
"""A feature is matched if the second nearest descriptor is farther than the nearest by this ratio (Lowe 2004)."""
NUM_NEAR, NEAR_DEG, SPREAD = 4, 0.8, 1.15
"""Number of points that tell the range of a feature, their largest angle from it, and the largest ratio of their
ranges: beside an edge, no range is certain."""
SAME_RANGE = 1.3
"""Largest ratio of the ranges that both cameras see of a match. A wrong match has any."""
GATE_DEG = 10.0
"""Largest angle between a feature and where the poses expect it: cameras are off by 5 degrees at most, each."""
NUM_VOTES, VOTE_DEG = 500, 0.5
"""Number of pairs of matches that vote, and largest angle of a match that agrees: a position that is 0.2 m off shifts a
point at 25 m by that much."""
NUM_STEPS = 20
"""Number of steps of the fit, which settles within ten."""
MIN_SPREAD_RAD = math.radians(0.01)
"""Smallest scatter of matches, which are never better than that."""
PRIOR_M = 0.3
"""Standard deviation of the distance between two cameras, which distant points hardly tell."""
FITS_SPREADS = 4.0
"""Spreads of the scatter within which a match fits."""
MIN_SHARE = 0.3
"""Least share of the matches within the gate that fit."""


class _Features(NamedTuple):
    """Features of an image, and the sweep that was taken with it."""

    rays: Rays
    """(N, 3) camera frame."""
    descriptors: Array
    """(N, 128)"""
    points: Points
    """(M, 3) metres, LiDAR frame."""

    def ranges_m(self, T_camera_lidar: Pose) -> Numbers:
        """Compute the range (N,) of each feature, metres, by the points around it; NaN where it is not certain."""
        from scipy.spatial import cKDTree

        points = self.points @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
        ranges = np.linalg.norm(points, axis=1)
        is_seen = ranges > 0.0
        points, ranges = points[is_seen], ranges[is_seen]
        chord = 2.0 * math.sin(math.radians(NEAR_DEG) / 2.0)
        tree = cKDTree(points / ranges[:, None])
        _, nearest = tree.query(self.rays, NUM_NEAR, distance_upper_bound=chord)
        around = np.append(ranges, np.nan)[nearest]
        is_certain = np.max(around, axis=1) <= SPREAD * np.min(around, axis=1)
        return np.where(is_certain, np.median(around, axis=1), np.nan)


class _Matches(NamedTuple):
    """Matched features of two cameras of one sweep, and both images."""

    of_source: _Features
    of_to: _Features
    pairs: Array
    """(K, 2) indices of the features of each match."""

    def points(self, T_source_lidar: Pose, T_to_lidar: Pose) -> tuple[Vectors, Rays]:
        """Return the points (K, 3) of the matches with a range, metres, source frame, and their rays (K, 3) in `to`."""
        T = T_to_lidar @ inverse(T_source_lidar)
        of_source, of_to = self.pairs.T
        rays, rays_to = self.of_source.rays[of_source], self.of_to.rays[of_to]
        own = self.of_source.ranges_m(T_source_lidar)[of_source]
        beyond = self.of_to.ranges_m(T_to_lidar)[of_to, None] * rays_to
        # How far a point is from the other camera hardly depends on how the two are turned.
        other = np.linalg.norm((beyond - T[:3, 3]) @ T[:3, :3], axis=1)
        ranges = np.where(np.isnan(own), other, own)
        ratio = np.where(np.isnan(own * other), 1.0, own / other)
        is_known = ~np.isnan(ranges) & (ratio < SAME_RANGE) & (ratio > 1.0 / SAME_RANGE)
        return (ranges[:, None] * rays)[is_known], rays_to[is_known]


class CameraImages:
    """The features of the images of a camera, found once."""

    def __init__(self, drive: Drive, sweeps: SweepCache) -> None:
        """Keep what features are found in.

        Args:
            drive: Drive of the camera; only its frames with an image are used.
            sweeps: Sweeps that were read before.
        """
        with_image = [at for at, frame in enumerate(drive.frames) if frame.image is not None]
        self.drive, self.sweeps = with_frames(drive, with_image), sweeps
        self._features: dict[int, _Features] = {}

    @cached_property
    def frame_of_cloud(self) -> dict[object, int]:
        """Index of the frame of each cloud."""
        clouds = (cloud_path(self.drive, frame.points) for frame in self.drive.frames)
        return {content_key(cloud): at for at, cloud in enumerate(clouds)}

    def features(self, frames: Sequence[int]) -> list[_Features]:
        """Find the features of frames, by their indices.

        Raises:
            InputError: an image, a sweep or a mask is missing or wrong.
        """
        missing = [frame for frame in frames if frame not in self._features]
        if missing:
            drive = with_frames(self.drive, missing)
            clouds = compensated(drive, read_clouds(drive, self.sweeps))
            masks = seen_pixels(drive, drive.frames)
            with thread_pool() as pool:
                images = pool.map(lambda frame: read_needed_image(drive, frame), drive.frames)
                found = list(pool.map(lambda image, mask: _detect(drive, image, mask), images, masks))
            for at, (rays, descriptors), cloud in zip(missing, found, clouds, strict=True):
                self._features[at] = _Features(rays, descriptors, cloud.points)
        return [self._features[frame] for frame in frames]


class ImagePair:
    """Two cameras whose images are matched."""

    def __init__(self, source: tuple[str, CameraImages], to: tuple[str, CameraImages]) -> None:
        """Match the features of both cameras' images of the same sweeps.

        Args:
            source: Name and images of the camera from whose frame the transform leads.
            to: The same of the other one.

        Raises:
            InputError: an image, a sweep or a mask is missing or wrong.
        """
        (self.source, of_source), (self.to, of_to) = source, to
        shared = [cloud for cloud in of_source.frame_of_cloud if cloud in of_to.frame_of_cloud]
        shared = evenly_spaced(shared, MAX_FRAMES)
        pairs = zip(
            of_source.features([of_source.frame_of_cloud[cloud] for cloud in shared]),
            of_to.features([of_to.frame_of_cloud[cloud] for cloud in shared]),
            strict=True,
        )
        self.matches = [_Matches(*pair, _matched(*pair)) for pair in pairs]

    def fit(self, poses: Mapping[str, Pose]) -> MatchedImages | None:
        """Fit the transform between both cameras to the matches; None if too few agree.

        Args:
            poses: T_camera_lidar (4, 4) of both cameras, off by 5 degrees and 0.3 m at most.
        """
        T_source, T_to = poses[self.source], poses[self.to]
        T_start = T_to @ inverse(T_source)
        if not self.matches:
            return None
        of_frames = [matches.points(T_source, T_to) for matches in self.matches]
        frames = np.repeat(np.arange(len(of_frames)), [len(rays) for _, rays in of_frames])
        points, rays = (np.concatenate(parts) for parts in zip(*of_frames, strict=True))
        is_near = np.sum(_directions(T_start, points) * rays, axis=1) > math.cos(math.radians(GATE_DEG))
        if is_near.sum() < MIN_MATCHES:
            return None
        points, rays, frames = points[is_near], rays[is_near], frames[is_near]
        T_voted, agrees = _vote(T_start, points, rays)
        if agrees.sum() < MIN_MATCHES:
            return None
        T, covariance, spread = _fit(T_voted, T_start, points[agrees], rays[agrees])
        fits = np.linalg.norm(_directions(T, points) - rays, axis=1) < FITS_SPREADS * spread
        if fits.sum() < max(MIN_MATCHES, MIN_SHARE * len(points)):
            return None
        errors = np.sqrt(np.diag(covariance))
        return MatchedImages(
            to=self.to,
            source=self.source,
            T_to_source=rows(orthonormal(T)),
            num_matches=int(fits.sum()),
            num_frames=len(np.unique(frames[fits])),
            sigma_m=tuple(errors[:3].tolist()),
            sigma_deg=tuple(np.degrees(errors[3:]).tolist()),
        )


def pair_images(
    drives: Mapping[str, Drive], poses: Mapping[str, Pose], sweeps: SweepCache
) -> list[ImagePair]:
    """Match the images of each two cameras that may see the same things.

    Args:
        drives: Drive of each camera, of one LiDAR.
        poses: T_camera_lidar (4, 4) of each camera, off by 5 degrees at most.
        sweeps: Sweeps that were read before.

    Raises:
        InputError: an image, a sweep or a mask is missing or wrong.
    """
    images = {name: CameraImages(drives[name], sweeps) for name in poses}
    return [
        ImagePair((source, images[source]), (to, images[to]))
        for source, to in combinations(poses, 2)
        if _may_overlap(drives, poses, source, to)
    ]


def fit_all(pairs: Iterable[ImagePair], poses: Mapping[str, Pose]) -> list[MatchedImages]:
    """Fit the transforms between cameras to their matched images, and leave out those where too few matches agree."""
    return [shown for pair in pairs if (shown := pair.fit(poses)) is not None]


def _may_overlap(drives: Mapping[str, Drive], poses: Mapping[str, Pose], source: str, to: str) -> bool:
    """Whether the views of two cameras overlap, or would if poses were off by as much as is allowed."""
    T = poses[to] @ inverse(poses[source])
    between = math.acos(np.clip(T[2, 2], -1.0, 1.0))
    return between < _reach(drives[source]) + _reach(drives[to]) + math.radians(GATE_DEG)


def _reach(drive: Drive) -> float:
    """Largest angle, radians, between the optical axis and the ray of a pixel."""
    width, height = drive.camera.size
    u, v = np.meshgrid(np.linspace(0.0, width - 1.0, 9), np.linspace(0.0, height - 1.0, 9))
    rays = core_camera(drive.camera).unproject(np.column_stack([u.ravel(), v.ravel()]))
    return math.acos(np.clip(np.nanmin(rays[:, 2]), -1.0, 1.0))


def _detect(drive: Drive, image: Array, mask: Array) -> tuple[Rays, Array]:
    """Find features: their rays (N, 3) and descriptors (N, 128)."""
    lens = core_camera(drive.camera)
    scale = min(1.0 / (math.radians(PIXEL_DEG) * lens.pixels_per_radian), 1.0)
    size = tuple(max(round(scale * side), 1) for side in drive.camera.size)
    gray = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
    of_scene = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    points, descriptors = cv2.SIFT.create(NUM_FEATURES).detectAndCompute(gray, of_scene)
    if not points:
        return np.zeros((0, 3)), np.zeros((0, 128), np.float32)
    per_pixel = np.array(drive.camera.size) / size
    # Centres of pixels are integers.
    pixels = (np.array([point.pt for point in points]) + 0.5) * per_pixel - 0.5
    rays = lens.unproject(pixels)
    is_seen = np.isfinite(rays).all(axis=1)
    return rays[is_seen], descriptors[is_seen]


def _matched(source: _Features, to: _Features) -> Array:
    """Match the features of two images: indices (K, 2)."""
    if len(source.rays) < 2 or len(to.rays) < 2:
        return np.zeros((0, 2), np.int64)
    nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(source.descriptors, to.descriptors, k=2)
    kept = [
        (best.queryIdx, best.trainIdx) for best, second in nearest if best.distance < RATIO * second.distance
    ]
    return np.array(kept, np.int64).reshape(-1, 2)


def _directions(T: Pose, points: Vectors) -> Rays:
    """Directions (N, 3) of points (N, 3) that a transform moves."""
    moved = points @ T[:3, :3].T + T[:3, 3]
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _vote(T_start: Pose, points: Vectors, rays: Rays) -> tuple[Pose, Array]:
    """Turn a transform by the rotation that most matches agree with, and return which (N,) agree."""
    expected, rng = _directions(T_start, points), np.random.default_rng(0)
    first, second = rng.integers(len(points), size=(2, NUM_VOTES))
    rotations = np.einsum("nij,nkj->nik", _frames(rays, first, second), _frames(expected, first, second))
    # Squared chords, of all matches by each vote.
    cosines = np.einsum("nij,mj,mi->nm", rotations, expected, rays, optimize=True)
    agrees = cosines > math.cos(math.radians(VOTE_DEG))
    best = int(np.argmax(agrees.sum(axis=1)))
    T: Pose = T_start.copy()
    T[:3] = rotations[best] @ T_start[:3]
    return T, agrees[best]


def _frames(rays: Rays, first: Array, second: Array) -> Numbers:
    """Orthonormal frames (N, 3, 3), in columns, of pairs of rays; those of equal rays are none, and win no vote."""
    across = np.cross(rays[first], rays[second])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.stack([rays[first], across, np.cross(rays[first], across)], axis=2)


def _fit(T: Pose, T_start: Pose, points: Vectors, rays: Rays) -> tuple[Pose, Matrix, float]:
    """Fit a transform to matches by Gauss-Newton steps with Cauchy's weights.

    The position of the camera has a weak prior, at the start.

    Returns:
        The transform (4, 4), the covariance (6, 6) of a twist on its left, and the scatter of matches in radians.
    """
    prior = np.diag([PRIOR_M**-2] * 3 + [0.0] * 3)
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
        pull += prior @ np.concatenate([T[:3, 3] - T_start[:3, 3], np.zeros(3)])
        T = apply_twist(T, -np.linalg.solve(information, pull))
    return T, np.linalg.inv(information), spread
