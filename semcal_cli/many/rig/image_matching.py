"""Matched features of the images of two cameras of a rig, where these overlap.

Features of two images (SIFT: Lowe, *Distinctive image features from scale-invariant keypoints*, IJCV 2004) that were
taken with one sweep are matched, and the points of the sweep around a feature say how far away it is. The distances
hardly depend on the poses of the cameras, which may be off by degrees.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import Array, Numbers, Points, Pose, Rays, Vectors
from semcal_cli.geometry.poses import inverse, orthonormal
from semcal_cli.many.rig.matched_images import MatchedImages
from semcal_cli.many.rig.relative_pose import GATES_DEG, fit_relative_pose
from semcal_cli.many.rig.rig_estimate import symmetric
from semcal_cli.many.rig.rig_uncertainty import rows
from semcal_cli.many.rig.shared_clouds import cloud_path, content_key
from semcal_cli.observations.frame_selection import evenly_spaced, with_frames
from semcal_cli.observations.masks import seen_pixels
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.reading import read_clouds, read_needed_image
from semcal_cli.threads import thread_pool

MAX_APART_S = 0.02
"""Longest time between two images that are matched: that of neighbouring cameras which a LiDAR of 10 turns a second
triggers as it passes by."""
SPEED_M_S, TURN_RAD_S = 10.0, math.radians(10.0)
"""Standard deviations of the speed and the turn of a rig meanwhile: those of a car in a town, or a stated speed if
that is higher."""
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


class _Features(NamedTuple):
    """Features of an image, and the sweep that was taken with it."""

    rays: Rays
    """(N, 3) camera frame."""
    descriptors: Array
    """(N, 128)"""
    points: Points
    """(M, 3) metres, LiDAR frame."""

    def ranges_m(self, features: Array, T_camera_lidar: Pose) -> Numbers:
        """Compute the ranges (K,) of features, by their indices, by the points around them; NaN where not certain."""
        from scipy.spatial import cKDTree

        rays = self.rays[features]
        if not len(rays):
            return np.zeros(0)
        points = self.points @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
        ranges = np.linalg.norm(points, axis=1)
        # Most points are far from all features, and would only make the tree larger.
        middle = rays.mean(axis=0)
        farthest = math.acos(np.clip((rays @ middle).min() / np.linalg.norm(middle), -1.0, 1.0))
        reach = min(farthest + math.radians(NEAR_DEG), math.pi)
        is_near = (ranges > 0.0) & (points @ middle >= math.cos(reach) * np.linalg.norm(middle) * ranges)
        points, ranges = points[is_near], ranges[is_near]
        chord = 2.0 * math.sin(math.radians(NEAR_DEG) / 2.0)
        tree = cKDTree(points / ranges[:, None])
        _, nearest = tree.query(rays, NUM_NEAR, distance_upper_bound=chord)
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
        own = self.of_source.ranges_m(of_source, T_source_lidar)
        beyond = self.of_to.ranges_m(of_to, T_to_lidar)[:, None] * rays_to
        # How far a point is from the other camera hardly depends on how the two are turned.
        other = np.linalg.norm((beyond - T[:3, 3]) @ T[:3, :3], axis=1)
        ranges = np.where(np.isnan(own), other, own)
        ratio = np.where(np.isnan(own * other), 1.0, own / other)
        is_known = ~np.isnan(ranges) & (ratio < SAME_RANGE) & (ratio > 1.0 / SAME_RANGE)
        return (ranges[:, None] * rays)[is_known], rays_to[is_known]


class FramePair(NamedTuple):
    """Frames of two cameras with the same cloud, by their indices."""

    source: int
    to: int
    apart_s: float
    """Time between their images; 0 where it is not known."""


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
    def frames_of_cloud(self) -> dict[object, list[int]]:
        """Indices of the frames of each cloud."""
        frames = defaultdict[object, list[int]](list)
        for at, frame in enumerate(self.drive.frames):
            frames[content_key(cloud_path(self.drive, frame.points))].append(at)
        return frames

    def files(self) -> list[Path]:
        """List the files of the frames that were matched."""
        matched = with_frames(self.drive, sorted(self._features))
        return [*map(self.drive.resolve, matched.files())] if self._features else []

    def pairs_with(self, other: CameraImages) -> list[FramePair]:
        """Pair frames of one cloud whose images are of nearly one moment: for each cloud, the nearest two."""
        nearest = (
            min(
                (FramePair(own, its, self._apart_s(other, own, its)) for own, its in product(frames, others)),
                key=lambda pair: pair.apart_s,
            )
            for cloud, frames in self.frames_of_cloud.items()
            if (others := other.frames_of_cloud.get(cloud))
        )
        return evenly_spaced([pair for pair in nearest if pair.apart_s <= MAX_APART_S], MAX_FRAMES)

    def _apart_s(self, other: CameraImages, own_frame: int, other_frame: int) -> float:
        """Compute the time between two images, as far as stamps tell; while the rig stands, there is none."""
        first, second = self._moment(own_frame), other._moment(other_frame)
        motions = self.drive.motion, other.drive.motion
        is_standing = any(motion is not None and motion.speed_m_s == 0.0 for motion in motions)
        return 0.0 if first is None or second is None or is_standing else abs(first - second)

    def _moment(self, frame: int) -> float | None:
        stamp = self.drive.frames[frame].image_stamp
        return None if stamp is None else stamp + self.drive.time_offset_s

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
        frames = of_source.pairs_with(of_to)
        pairs = zip(
            of_source.features([pair.source for pair in frames]),
            of_to.features([pair.to for pair in frames]),
            strict=True,
        )
        self.matches = [_Matches(*pair, _matched(*pair)) for pair in pairs]
        self.apart_s = max((pair.apart_s for pair in frames), default=0.0)
        motions = of_source.drive.motion, of_to.drive.motion
        stated = [
            motion.speed_m_s for motion in motions if motion is not None and motion.speed_m_s is not None
        ]
        self.speed_m_s = max([SPEED_M_S, *stated])

    def fit(self, poses: Mapping[str, Pose]) -> MatchedImages | None:
        """Fit the transform between both cameras to the matches; None if too few agree.

        Args:
            poses: T_camera_lidar (4, 4) of both cameras.
        """
        if not self.matches:
            return None
        T_source, T_to = poses[self.source], poses[self.to]
        point_rays = [matches.points(T_source, T_to) for matches in self.matches]
        frames = np.repeat(np.arange(len(point_rays)), [len(rays) for _, rays in point_rays])
        points, rays = (np.concatenate(parts) for parts in zip(*point_rays, strict=True))
        relative = fit_relative_pose(T_to @ inverse(T_source), points, rays)
        if relative is None:
            return None
        moved = self.apart_s * np.repeat([self.speed_m_s, TURN_RAD_S], 3)
        return MatchedImages(
            to=self.to,
            source=self.source,
            T_to_source=rows(orthonormal(relative.T)),
            num_matches=int(relative.fits.sum()),
            num_frames=len(np.unique(frames[relative.fits])),
            covariance=rows(symmetric(relative.covariance) + np.diag(moved**2)),
        )


class PairedImages(NamedTuple):
    """Pairs of cameras whose images were matched."""

    pairs: tuple[ImagePair, ...]
    files: tuple[Path, ...]
    """Files of the frames that were matched."""
    notes: tuple[str, ...]
    """Pairs of cameras whose images cannot be read, and why."""


def pair_images(drives: Mapping[str, Drive], poses: Mapping[str, Pose], sweeps: SweepCache) -> PairedImages:
    """Match the images of each two cameras that may see the same things; one that cannot be read stops no other.

    Args:
        drives: Drive of each camera, of one LiDAR.
        poses: T_camera_lidar (4, 4) of each camera.
        sweeps: Sweeps that were read before.
    """
    images = {name: CameraImages(drives[name], sweeps) for name in poses}
    pairs, notes = [], dict[str, None]()
    for source, to in combinations(poses, 2):
        if not _may_overlap(drives, poses, source, to):
            continue
        try:
            pairs.append(ImagePair((source, images[source]), (to, images[to])))
        except InputError as error:
            notes[f"images of {source} and {to} were not matched: {error}"] = None
    files = dict.fromkeys(file for camera_images in images.values() for file in camera_images.files())
    return PairedImages(tuple(pairs), tuple(files), tuple(notes))


def fit_all(pairs: Iterable[ImagePair], poses: Mapping[str, Pose]) -> list[MatchedImages]:
    """Fit the transforms between cameras to their matched images, and leave out those where too few matches agree."""
    return [shown for pair in pairs if (shown := pair.fit(poses)) is not None]


def _may_overlap(drives: Mapping[str, Drive], poses: Mapping[str, Pose], source: str, to: str) -> bool:
    """Whether the views of two cameras overlap, or could if both poses together were off by the first gate."""
    T = poses[to] @ inverse(poses[source])
    between = math.acos(np.clip(T[2, 2], -1.0, 1.0))
    return between < _reach(drives[source]) + _reach(drives[to]) + math.radians(GATES_DEG[0])


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
    small_mask = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    points, descriptors = cv2.SIFT.create(NUM_FEATURES).detectAndCompute(gray, small_mask)
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
