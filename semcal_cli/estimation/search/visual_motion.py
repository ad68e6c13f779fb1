"""Motion of the camera between two images, from matched features: its rotation, and the direction of its translation.

MAGSAC++ (Barath et al., CVPR 2020) finds the essential matrix from matches of SIFT (Lowe, IJCV 2004). The motion is
then refined over all inliers by Sampson's error of their rays, which also gives its covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.geometry.arrays import Mask, Matrix, Rays, Vector
from semcal_cli.geometry.twists import rotation_matrix
from semcal_cli.observations.masks import seen_pixels
from semcal_cli.observations.reading import read_needed_image
from semcal_cli.threads import thread_pool

MAX_WIDTH = 640
"""Wider images are scaled down to this, which takes 4 s of CPU time for a drive instead of 14 s. SIFT doubles each
image first, so little is lost on most drives; docs/calibrating.md has the figures."""
MAX_FEATURES, MIN_CONTRAST = 3000, 0.02
MAX_RATIO = 0.8
"""Largest distance of a match over that of the second best (Lowe, section 7.1)."""
MIN_Z = 0.35
"""Smallest z of a ray that is used, 70 degrees from the optical axis: the essential matrix is found in the plane
z = 1."""
INLIER_PX = 2.0
MIN_INLIERS = 40
"""Smallest number of inliers of a motion. Any five matches fit some motion, and a wrong motion has few more."""
CONFIDENCE = 0.999
ROUNDS = 8
"""Largest number of steps of the refinement, which needs about four."""
MIN_SINE = 1e-3
"""Sine of the angle between a ray and the translation, below which the ray carries no information."""
MIN_SIGMA_PX = 0.1
"""Smallest standard deviation of a feature: SIFT is not more accurate."""


class CameraMotion(NamedTuple):
    """Motion of the camera from one image to another."""

    R: Matrix
    """(3, 3) rotation of the second camera in the frame of the first."""
    direction: Vector
    """(3,) unit vector from the first camera to the second, in the frame of the first."""
    information: Matrix
    """(5, 5) inverse covariance of a rotation vector on the left of R, radians, and of the direction along `across`."""
    num_inliers: int

    @property
    def across(self) -> Matrix:
        """Two unit vectors (2, 3) perpendicular to the direction."""
        return across(self.direction)


class _Features(NamedTuple):
    rays: Rays
    descriptors: npt.NDArray[np.float32]
    """(N, 128)."""


def camera_motions(drive: Drive, pairs: Sequence[tuple[Frame, Frame]]) -> list[CameraMotion | None]:
    """Estimate the motion between the images of each pair of frames; None if too few features match.

    Raises:
        InputError: an image or a mask is missing or wrong.
    """
    camera = drive.camera
    frames = {frame.image: frame for pair in pairs for frame in pair}
    with thread_pool() as pool:
        masks = seen_pixels(drive, list(frames.values()))
        by_frame = pool.map(
            lambda frame, mask: _features(camera, read_needed_image(drive, frame), mask),
            frames.values(),
            masks,
        )
        features = dict(zip(frames, by_frame, strict=True))

        def between(pair: tuple[Frame, Frame]) -> CameraMotion | None:
            first, second = (features[frame.image] for frame in pair)
            return _motion(camera, first, second)

        return list(pool.map(between, pairs))


def refined(first: Rays, second: Rays, R: Matrix, direction: Vector, sigma: float) -> CameraMotion:
    """Refine a motion over matched rays (N, 3) of both images, by Sampson's epipolar error.

    The error of a match is f1 . (t x R f2), divided by the norm of its gradient by both rays; outliers weigh less
    (Cauchy).

    Args:
        first: Rays of the first image.
        second: Their matches in the second image.
        R: (3, 3) rotation of the second camera in the frame of the first.
        direction: (3,) direction of its translation.
        sigma: Smallest standard deviation of a ray, radians.
    """
    for _ in range(ROUNDS):
        rotated, basis = second @ R.T, across(direction)
        by_first, by_second = np.cross(direction, rotated), np.cross(first, direction)
        epipolar = np.einsum("ni,ni->n", first, by_first)
        slope = np.sqrt(
            np.maximum((by_first**2).sum(1) + (by_second**2).sum(1) - 2.0 * epipolar**2, MIN_SINE**2)
        )
        errors = epipolar / slope
        by_turn, by_direction = np.cross(rotated, by_second), np.cross(rotated, first) @ basis.T
        slopes = np.concatenate([by_turn, by_direction], 1) / slope[:, None]
        scatter = max(1.4826 * float(np.median(np.abs(errors))), sigma)
        weights = 1.0 / (1.0 + (errors / scatter) ** 2) / scatter**2
        # Without translation the direction is undetermined: a prior of one radian keeps it finite.
        information = slopes.T @ (slopes * weights[:, None]) + np.diag([0.0, 0.0, 0.0, 1.0, 1.0])
        step = -np.linalg.lstsq(information, slopes.T @ (errors * weights), rcond=None)[0]
        R = rotation_matrix(step[:3]) @ R
        direction = direction + basis.T @ step[3:]
        direction = direction / np.linalg.norm(direction)
    # The perpendicular directions rotate with the step, which vanishes at the end.
    return CameraMotion(R, direction, information, len(first))


def across(direction: Vector) -> Matrix:
    """Return two unit vectors (2, 3) perpendicular to a unit vector (3,), always the same for the same vector."""
    axis = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _features(camera: Camera, image: npt.NDArray[np.uint8], mask: Mask) -> _Features:
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    is_seen = mask.astype(np.uint8)
    if camera.width > MAX_WIDTH:
        size = MAX_WIDTH, round(camera.height * MAX_WIDTH / camera.width)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        is_seen = cv2.resize(is_seen, size, interpolation=cv2.INTER_NEAREST).astype(np.uint8)
    scale = np.array([camera.width, camera.height]) / grey.shape[::-1]
    keypoints, descriptors = cv2.SIFT_create(MAX_FEATURES, 3, MIN_CONTRAST).detectAndCompute(grey, is_seen)  # type: ignore[attr-defined]
    if not keypoints:
        return _Features(np.empty((0, 3)), np.empty((0, 128), np.float32))
    pixels = (np.array([keypoint.pt for keypoint in keypoints]) + 0.5) * scale - 0.5
    rays = core_camera(camera).unproject(np.ascontiguousarray(pixels))
    is_in_view = rays[:, 2] > MIN_Z  # False for NaN, where the lens does not reach.
    return _Features(rays[is_in_view], descriptors[is_in_view])


def _motion(camera: Camera, first: _Features, second: _Features) -> CameraMotion | None:
    if min(len(first.rays), len(second.rays)) < MIN_INLIERS:
        return None
    matches = cv2.BFMatcher().knnMatch(first.descriptors, second.descriptors, k=2)
    kept = [a for a, b in matches if a.distance < MAX_RATIO * b.distance]
    best: dict[int, cv2.DMatch] = {}
    for match in sorted(kept, key=lambda match: -match.distance):
        best[match.trainIdx] = match  # A feature of the second image keeps only its best match.
    if len(best) < MIN_INLIERS:
        return None
    f1 = first.rays[[match.queryIdx for match in best.values()]]
    f2 = second.rays[[match.trainIdx for match in best.values()]]
    flat1, flat2 = f1[:, :2] / f1[:, 2:], f2[:, :2] / f2[:, 2:]
    pixel = 1.0 / core_camera(camera).pixels_per_radian
    E, mask = cv2.findEssentialMat(
        flat1, flat2, np.eye(3), method=cv2.USAC_MAGSAC, prob=CONFIDENCE, threshold=INLIER_PX * pixel
    )
    if E is None or E.shape != (3, 3):
        return None
    _, R_second_first, t_second_first, mask = cv2.recoverPose(E, flat1, flat2, np.eye(3), mask=mask.copy())
    is_inlier = mask.ravel() > 0
    if is_inlier.sum() < MIN_INLIERS:
        return None
    R = np.asarray(R_second_first.T, np.float64)
    direction = np.asarray(-(R @ t_second_first).ravel(), np.float64)
    return refined(f1[is_inlier], f2[is_inlier], R, direction, MIN_SIGMA_PX * pixel)
