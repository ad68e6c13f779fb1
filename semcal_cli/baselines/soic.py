"""SOIC, for comparison: an initial pose from semantic centroids, then points are moved onto pixels of their class.

Source: Wang, Nobuhara, Nakamura and Sakurada, *SOIC: Semantic Online Initialization and Calibration for LiDAR and
Camera*, arXiv 2003.04260. Points and pixels need classes of the same names, and the method gives no uncertainty.

A sweep covers a full turn and an image does not, so the centroid of a class in the whole sweep is no point of the
image. Centroids are therefore computed in many sectors as wide as the image, and the pose with the least cost is taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.baselines.config import SoicConfig
from semcal_cli.config import PnpConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import CalibrationError
from semcal_cli.geometry.baseline import baseline_m
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.pnp import solve_pnp

BINS_PER_SECTOR = 4
"""Number of azimuth bins per sector; neighbouring sectors share bins."""


class Soic:
    """Cost of SOIC over all frames of a drive, in pixels."""

    def __init__(self, observations: Observations, config: SoicConfig) -> None:
        """Compute the distance fields of the classes that points and pixels share.

        Raises:
            CalibrationError: the frames have points and pixels of fewer than two shared class names.
        """
        self.observations, self.config = observations, config
        image_classes = {name: index for index, name in enumerate(observations.image_class_names)}
        self.classes = [
            (index, image_classes[name])
            for index, name in enumerate(observations.point_class_names)
            if name in image_classes
        ]
        """Classes of points and of pixels that have the same name."""
        parts = [part for frame in range(observations.num_frames) for part in self._parts(frame)]
        num_classes = len({number for number, _, _ in parts})
        if num_classes < 2:
            raise CalibrationError(
                f"SOIC: found {num_classes} classes of one name on both sides of a frame, needed at least 2"
            )
        self.distance = _core.SemanticDistance(core_camera(observations.camera), parts, block=config.block_px)

    def cost(self, T_camera_lidar: Pose) -> float:
        """Compute the mean distance of points from the pixels of their class, averaged over classes, in pixels."""
        return self.distance.at(T_camera_lidar)

    def initialize(self, max_baseline_m: float) -> Pose:
        """Find an initial pose from semantic centroids.

        Args:
            max_baseline_m: Largest distance between camera and LiDAR, in metres.

        Returns:
            T_camera_lidar (4, 4), metres.

        Raises:
            CalibrationError: the centroids of no sector determine such a pose.
        """
        camera, config = self.observations.camera, self.config
        pnp = PnpConfig(max_error_deg=config.centroid_error_deg, min_inliers=config.min_centroids)
        found: list[Pose] = []
        for points, pixels in self._centroids():
            try:
                T_camera_lidar, _ = solve_pnp(points, pixels, camera, pnp)
            except CalibrationError:
                continue
            if baseline_m(T_camera_lidar) <= max_baseline_m:
                found.append(T_camera_lidar)
        if not found:
            most = len(self.classes) * self.observations.num_frames
            raise CalibrationError(
                f"SOIC: of {most} semantic centroids at most, {len(self.classes)} classes in "
                f"{self.observations.num_frames} frames, no direction has {config.min_centroids} that agree on a pose "
                f"within {max_baseline_m:g} m of the LiDAR"
            )
        return min(found, key=self.cost)

    def minimize(self, T_init: Pose) -> _core.DistanceMinimum:
        """Minimise the cost from a pose.

        Raises:
            CalibrationError: no point projects into the image there.
        """
        return self.distance.minimize(T_init, self.config)

    def _parts(self, frame: int) -> Iterator[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.float32]]]:
        """Give the number, the points and the distance field of each shared class in a frame."""
        cloud = self.observations.clouds[frame]
        points, classes = cloud.points, cloud.classes
        image, block = self.observations.images[frame].classes, self.config.block_px
        height, width = (max(side // block, 1) for side in image.shape)
        for number, (of_points, of_pixels) in enumerate(self.classes):
            chosen = points[classes == of_points]
            others = image != of_pixels
            if len(chosen) == 0 or others.all():
                continue
            distances = cv2.distanceTransform(others.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            # Rows and columns beyond the last whole block are left out, so that all blocks have the same size.
            whole = distances[: height * block, : width * block]
            small = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
            yield number, chosen, small.astype(np.float32, copy=False)

    def _centroids(self) -> Iterator[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
        """Compute centroids of classes in each sector, points (N, 3) metres and pixels (N, 2), over all frames."""
        config = self.config
        num_bins = BINS_PER_SECTOR * config.num_sectors
        # (frames, classes, bins, 4) and (frames, classes, 3): sums of coordinates, and counts.
        points = np.array(
            [self._point_sums(frame, num_bins) for frame in range(self.observations.num_frames)]
        )
        pixels = np.array([self._pixel_sums(frame) for frame in range(self.observations.num_frames)])
        # An image of a full turn contains each bin once.
        reach = min(round(self._half_width() / (2.0 * math.pi) * num_bins), (num_bins - 1) // 2)
        window = np.arange(-reach, reach + 1)
        for sector in range(config.num_sectors):
            inside = points[:, :, (BINS_PER_SECTOR * sector + window) % num_bins].sum(2)
            seen = (inside[..., -1] >= config.min_pixels) & (pixels[..., -1] >= config.min_pixels)
            of_points, of_pixels = inside[seen], pixels[seen]
            yield of_points[:, :3] / of_points[:, 3:], of_pixels[:, :2] / of_pixels[:, 2:]

    def _point_sums(self, frame: int, num_bins: int) -> npt.NDArray[np.float64]:
        """Sum x, y, z and 1 over the points of each class in each bin of azimuth, (classes, bins, 4)."""
        cloud = self.observations.clouds[frame]
        points, classes = cloud.points, cloud.classes
        turns = np.arctan2(points[:, 1], points[:, 0]) / (2.0 * math.pi)
        bins = np.rint(turns * num_bins).astype(int) % num_bins
        sums = np.zeros((len(self.classes), num_bins, 4))
        for number, (of_points, _) in enumerate(self.classes):
            chosen = classes == of_points
            for axis in range(3):
                sums[number, :, axis] = np.bincount(bins[chosen], points[chosen, axis], num_bins)
            sums[number, :, 3] = np.bincount(bins[chosen], minlength=num_bins)
        return sums

    def _pixel_sums(self, frame: int) -> npt.NDArray[np.float64]:
        """Sum u, v and 1 over the pixels of each class, (classes, 3)."""
        image = self.observations.images[frame].classes
        moments = [cv2.moments((image == of_pixels).view(np.uint8), True) for _, of_pixels in self.classes]
        return np.array([[found["m10"], found["m01"], found["m00"]] for found in moments])

    def _half_width(self) -> float:
        """Compute half of the horizontal field of view, radians."""
        camera, lens = self.observations.camera, core_camera(self.observations.camera)
        middle = camera.K[1][2]
        rays = lens.unproject(np.array([[0.0, middle], [camera.width - 1.0, middle]]))
        angles = np.arctan2(np.abs(rays[:, 0]), rays[:, 2])
        return float(np.where(np.isfinite(angles), angles, lens.limit).mean())
