"""SOIC, for comparison: a pose from semantic centroids, and then one that moves points onto pixels of their class.

Source: Wang, Nobuhara, Nakamura and Sakurada, *SOIC: Semantic Online Initialization and Calibration for LiDAR and
Camera*, arXiv 2003.04260. Points and pixels need classes of the same names, and the method gives no uncertainty.

A sweep covers a full turn and an image does not, so the centroid of a class in the whole sweep is not the centroid in
the image. Centroids are therefore computed in many sectors as wide as the image, and the pose with the lowest cost is
taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.pose_checks import check_distance
from semcal_cli.assessment.stages import Stages
from semcal_cli.config import CalibrationConfig, PnpConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.events import Listener, Progress, ignore
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import CalibrationError
from semcal_cli.experiments.baselines.config import SoicConfig
from semcal_cli.geometry.poses import Pose, baseline_m
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.initialization.pnp import solve_pnp
from semcal_cli.initialization.search import GIVEN
from semcal_cli.pipeline import make_calibration
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.checks import SOIC
from semcal_cli.result.stage import StageResult, announced

BINS_PER_SECTOR = 4
"""Number of azimuth bins per sector; neighbouring sectors share bins."""


def calibrate_by_soic(
    data: LoadedDrive,
    config: CalibrationConfig,
    *,
    initial_pose: InitialPose | None = None,
    relative_to: Path = Path(),
    on_event: Listener = ignore,
    hashes: dict[str, str] | None = None,
) -> Calibration:
    """Calibrate with SOIC; arguments and errors are those of `pipeline.calibrate`.

    The semantic centroids put the camera no farther from the LiDAR than `config.refinement.max_baseline_m`. An initial
    pose replaces them. A result whose camera is farther away is not trusted.
    """
    on_event(Progress("computing distances to classes"))
    max_baseline_m = config.refinement.max_baseline_m
    soic = Soic(data.observations, SoicConfig())

    def start() -> StageResult:
        if initial_pose is None:
            T, origin = soic.initialize(max_baseline_m), "semantic centroids"
            note = f"started at {origin}"
        else:
            T, origin, note = initial_pose.T_camera_lidar, initial_pose.name, GIVEN
        details = f"from {origin}, {soic.cost(T):.2f} px"
        return soic.stage(T, note=note, details=details, settings={"soic": asdict(soic.config)})

    def minimize() -> StageResult:
        found = soic.minimize(initial.T_camera_lidar)
        details = f"soic, {found.cost_px:.2f} px after {found.num_evaluations} evaluations"
        if found.converged:
            return soic.stage(found.T_camera_lidar, details=details)
        unsettled = SOIC.finding(f"SOIC had not settled after {soic.config.max_restarts} restarts")
        note = "still moving at the end"
        return soic.stage(found.T_camera_lidar, findings=(unsettled,), note=note, details=details)

    doing = "trying semantic centroids" if initial_pose is None else f"starting at {initial_pose.name}"
    initial = announced("initial", doing, start, on_event)
    T_init, doing = initial.T_camera_lidar, "moving points to their classes"
    refined = announced("refined", doing, minimize, on_event, T_init)
    of_comparison = check_distance(refined.T_camera_lidar, max_baseline_m)
    stages = Stages.from_refined(data, initial, refined, is_compensated=False, of_comparison=of_comparison)
    return make_calibration(
        data, stages, config, initial_pose=initial_pose, relative_to=relative_to, hashes=hashes
    )


class Soic:
    """SOIC's cost over all frames of a drive, in pixels."""

    def __init__(self, observations: Observations, config: SoicConfig) -> None:
        """Compute the distance fields of the classes that points and pixels share.

        Raises:
            CalibrationError: fewer than two class names are shared by the points and pixels of a frame.
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
                f"SOIC: found {num_classes} class names that points and pixels of a frame share, needed at least 2"
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
            CalibrationError: no sector's centroids determine such a pose.
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
                f"SOIC: of at most {most} semantic centroids, {len(self.classes)} classes in "
                f"{self.observations.num_frames} frames, no direction has {config.min_centroids} that agree on a pose "
                f"within {max_baseline_m:g} m of the LiDAR"
            )
        return min(found, key=self.cost)

    def minimize(self, T_init: Pose) -> _core.DistanceMinimum:
        """Minimise the cost from a pose.

        Raises:
            CalibrationError: no point projects into the image at that pose.
        """
        return self.distance.minimize(T_init, self.config)

    def stage(self, T_camera_lidar: Pose, **more: Any) -> StageResult:
        """Make the result of a stage at a pose, with the agreement there."""
        agreement = _core.agreement(self.observations.core, T_camera_lidar)
        return StageResult(T_camera_lidar=T_camera_lidar, agreement=agreement, **more)

    def _parts(self, frame: int) -> Iterator[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.float32]]]:
        """Give the number, the points and the distance field of each shared class in a frame."""
        cloud = self.observations.clouds[frame]
        points, classes = cloud.points, cloud.classes
        image, block = self.observations.images[frame].classes, self.config.block_px
        height, width = (max(side // block, 1) for side in image.shape)
        for number, (point_class, pixel_class) in enumerate(self.classes):
            chosen = points[classes == point_class]
            others = image != pixel_class
            if len(chosen) == 0 or others.all():
                continue
            distances = cv2.distanceTransform(others.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            # Rows and columns after the last whole block are left out, so that all blocks have the same size.
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
        camera, lens = self.observations.camera, core_camera(self.observations.camera)
        middle = camera.K[1][2]
        rays = lens.unproject(np.array([[0.0, middle], [camera.width - 1.0, middle]]))
        angles = np.arctan2(np.abs(rays[:, 0]), rays[:, 2])
        half_width = float(np.where(np.isfinite(angles), angles, lens.limit).mean())
        # An image that covers a full turn contains each bin once.
        reach = min(round(half_width / (2.0 * math.pi) * num_bins), (num_bins - 1) // 2)
        window = np.arange(-reach, reach + 1)
        for sector in range(config.num_sectors):
            inside = points[:, :, (BINS_PER_SECTOR * sector + window) % num_bins].sum(2)
            seen = (inside[..., -1] >= config.min_pixels) & (pixels[..., -1] >= config.min_pixels)
            yield inside[seen][:, :3] / inside[seen][:, 3:], pixels[seen][:, :2] / pixels[seen][:, 2:]

    def _point_sums(self, frame: int, num_bins: int) -> npt.NDArray[np.float64]:
        """Sum x, y, z and 1 over the points of each class in each bin of azimuth, (classes, bins, 4)."""
        cloud = self.observations.clouds[frame]
        points, classes = cloud.points, cloud.classes
        turns = np.arctan2(points[:, 1], points[:, 0]) / (2.0 * math.pi)
        bins = np.rint(turns * num_bins).astype(int) % num_bins
        sums = np.zeros((len(self.classes), num_bins, 4))
        for number, (point_class, _) in enumerate(self.classes):
            chosen = classes == point_class
            for axis in range(3):
                sums[number, :, axis] = np.bincount(bins[chosen], points[chosen, axis], num_bins)
            sums[number, :, 3] = np.bincount(bins[chosen], minlength=num_bins)
        return sums

    def _pixel_sums(self, frame: int) -> npt.NDArray[np.float64]:
        """Sum u, v and 1 over the pixels of each class, (classes, 3)."""
        image = self.observations.images[frame].classes
        moments = [
            cv2.moments((image == pixel_class).view(np.uint8), True) for _, pixel_class in self.classes
        ]
        return np.array([[found["m10"], found["m01"], found["m00"]] for found in moments])
