"""Points of a frame on its image: where they project, which are hidden, and whether their classes agree."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.frame_selection import evenly_spaced
from semcal_cli.observations.motion import points_at, unrolled
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.report.colors import AGREES, DISAGREES, HIDDEN, NO_PAIR, coloring_of, depth_levels, is_edge

OUTSIDE = 255
"""Kind of a point outside the image."""
MAX_POSITION = 65_535
"""Largest value of encoded positions, at the end of the image's longer side."""


class ProjectedPoints(NamedTuple):
    """Points that project into an image, farthest first."""

    indices: npt.NDArray[np.intp]
    positions: npt.NDArray[np.float64]
    """(M, 2), (u, v)."""
    ranges_m: npt.NDArray[np.float64]
    """(M,) distances from the camera."""
    is_hidden: npt.NDArray[np.bool_]

    @property
    def pixels(self) -> npt.NDArray[np.intp]:
        """(M, 2), (u, v), nearest pixels."""
        return np.rint(self.positions).astype(np.intp)


def points_in_image(
    points: npt.NDArray[np.float32],
    T_camera_lidar: Pose,
    camera: Camera,
    origin_m: Sequence[float] = (0.0, 0.0, 0.0),
) -> ProjectedPoints:
    """Find the points (N, 3), metres, LiDAR frame, that project into the image, and mark the hidden ones among them.

    Their rays start at `origin_m` (3,), LiDAR frame.
    """
    projected = core.project_points(core_camera(camera), points, T_camera_lidar, origin_m)
    indices = np.flatnonzero(np.isfinite(projected.ranges))
    indices = indices[np.argsort(-projected.ranges[indices], kind="stable")]
    return ProjectedPoints(
        indices, projected.pixels[indices], projected.ranges[indices], projected.is_hidden[indices]
    )


class View(NamedTuple):
    """A pose, and the observations as seen by the camera and the clock that it belongs to."""

    observations: Observations
    T_camera_lidar: Pose

    def project_frame(self, frame: int) -> ProjectedPoints:
        """Find the points of a frame in its image, each at the moment its row is exposed."""
        points = points_at(self.observations, frame, self.T_camera_lidar)
        return points_in_image(
            points, self.T_camera_lidar, self.observations.camera, self.observations.origin_m
        )

    def agreement(self) -> core.Agreement:
        """Count the pairs of classes of visible points and of their pixels in all frames."""
        return core.agreement(unrolled(self.observations, self.T_camera_lidar).core, self.T_camera_lidar)


def associated_classes(agreement: core.Agreement) -> npt.NDArray[np.bool_]:
    """Return a mask of the classes of points (rows) and of pixels (columns) that co-occur more often than by chance.

    Their pointwise mutual information is positive.
    """
    return pmi_ratio(agreement.joint) > 1.0


def pmi_ratio(joint: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the frequency of each pair relative to chance, p(x, y) / (p(x) p(y)); 0 for a pair never seen."""
    by_chance = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0) / max(joint.sum(), 1.0)
    return np.asarray(joint / np.where(by_chance > 0.0, by_chance, 1.0))


def at_pixels(image: npt.NDArray[np.uint8], pixels: npt.NDArray[np.intp]) -> npt.NDArray[np.uint8]:
    """Return the values of an image at the pixels (M, 2), (u, v), or at the nearest ones inside."""
    u, v = pixels.T
    return np.asarray(image[v.clip(0, image.shape[0] - 1), u.clip(0, image.shape[1] - 1)])


def agreement_kinds(
    observations: Observations, frame: int, projection: ProjectedPoints, is_associated: npt.NDArray[np.bool_]
) -> npt.NDArray[np.intp]:
    """Return the index in `AGREEMENT_COLORS` of each point (M,); `NO_PAIR` if it or its pixel has no label.

    Points with a step agree with a gradient of the upper half of the levels; others are not judged.
    """
    point_classes = observations.clouds[frame].classes[projection.indices]
    pixel_classes = at_pixels(observations.images[frame].classes, projection.pixels)
    is_labelled = (point_classes != NO_CLASS) & (pixel_classes != NO_CLASS)
    if coloring_of(observations) == "edge":
        is_labelled &= is_edge(point_classes)
        agrees = pixel_classes[is_labelled] >= len(observations.image_class_names) // 2
    else:
        agrees = is_associated[point_classes[is_labelled], pixel_classes[is_labelled]]
    kinds = np.full(len(point_classes), NO_PAIR, np.intp)
    kinds[is_labelled] = np.where(projection.is_hidden[is_labelled], HIDDEN, ~agrees)
    return kinds


class PosePoints(NamedTuple):
    """Points of a frame at one pose, all arrays in one order."""

    positions: npt.NDArray[np.float64]
    """(N, 2), (u, v); an integer pixel is a pixel centre."""
    kinds: npt.NDArray[np.uint8]
    """(N,) an index in `AGREEMENT_COLORS`, `NO_PAIR`, or `OUTSIDE`."""
    levels: npt.NDArray[np.uint8]
    """(N,) see `depth_levels`."""

    @property
    def is_visible(self) -> npt.NDArray[np.bool_]:
        """(N,) whether a point is in the image and not hidden."""
        return np.asarray((self.kinds != OUTSIDE) & (self.kinds != HIDDEN))

    @property
    def num_judged(self) -> int:
        """Number of visible points with a label on both sides."""
        return int((self.kinds <= DISAGREES).sum())

    @property
    def agreement(self) -> float | None:
        """Share of the visible points that agree; None if none has labels on both sides."""
        return int((self.kinds == AGREES).sum()) / self.num_judged if self.num_judged else None


class FramePoints(NamedTuple):
    """Points of a frame that at least one pose puts into the image, farthest first."""

    indices: npt.NDArray[np.intp]
    """(N,) index of each point in its cloud."""
    classes: npt.NDArray[np.uint8]
    """(N,) class of each point."""
    poses: tuple[PosePoints, ...]
    by_edge: bool = False
    """Whether classes are steps next to the points."""

    def thin(self, count: int) -> FramePoints:
        """Keep at most `count` points, evenly spaced in their order, preferring those with an edge."""
        is_first = is_edge(self.classes) if self.by_edge else np.zeros(len(self.classes), bool)
        chosen_first = choose_evenly(is_first, count)
        chosen = np.sort(np.concatenate([chosen_first, choose_evenly(~is_first, count - len(chosen_first))]))
        poses = tuple(PosePoints(*(array[chosen] for array in pose)) for pose in self.poses)
        return FramePoints(self.indices[chosen], self.classes[chosen], poses, self.by_edge)

    def moved_px(self) -> npt.NDArray[np.float64]:
        """Return the distances in pixels between the first and the last pose, of points visible at both."""
        first, last = self.poses[0], self.poses[-1]
        is_in_both = first.is_visible & last.is_visible
        return np.asarray(np.linalg.norm(last.positions[is_in_both] - first.positions[is_in_both], axis=1))

    def encode(self, width: int, height: int) -> dict[str, object]:
        """Write the arrays as base64 for a page's script; positions as uint16 from the image's corner."""
        scale = MAX_POSITION / max(width, height)

        def encode_pose(pose: PosePoints) -> dict[str, str]:
            positions = np.clip(np.rint((pose.positions + 0.5) * scale), 0, MAX_POSITION).astype("<u2")
            return {
                "positions": encode_base64(positions),
                "kinds": encode_base64(pose.kinds),
                "levels": encode_base64(pose.levels),
            }

        return {
            "scale": scale,
            "classes": encode_base64(self.classes),
            "poses": [*map(encode_pose, self.poses)],
        }


def frame_points(views: Sequence[View], frame: int, is_associated: npt.NDArray[np.bool_]) -> FramePoints:
    """Project the points of a frame.

    Args:
        views: Poses, and the same points and label images as their cameras see them.
        frame: Number of the frame, from 0.
        is_associated: Mask of the classes that `associated_classes` returns.
    """
    observations = views[-1].observations
    cloud = observations.clouds[frame]
    projections = [view.project_frame(frame) for view in views]
    # Farthest first at the last pose, after points that only another pose shows.
    order = projections[-1].indices
    for projection in projections[:-1]:
        order = np.concatenate([projection.indices[~np.isin(projection.indices, order)], order])
    poses = []
    for projection in projections:
        positions = np.zeros((cloud.num_points, 2))
        kinds = np.full(cloud.num_points, OUTSIDE, np.uint8)
        levels = np.zeros(cloud.num_points, np.uint8)
        positions[projection.indices] = projection.positions
        kinds[projection.indices] = np.where(
            projection.is_hidden, HIDDEN, agreement_kinds(observations, frame, projection, is_associated)
        )
        levels[projection.indices] = depth_levels(projection.ranges_m)
        poses.append(PosePoints(positions[order], kinds[order], levels[order]))
    return FramePoints(order, cloud.classes[order], tuple(poses), coloring_of(observations) == "edge")


def choose_evenly(mask: npt.NDArray[np.bool_], count: int) -> npt.NDArray[np.intp]:
    """Return the indices of at most `count` evenly spaced points among those that a mask (N,) selects."""
    return np.array(evenly_spaced(np.flatnonzero(mask).tolist(), count), np.intp)


def encode_base64(array: npt.NDArray[np.generic]) -> str:
    """Write an array as base64."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
