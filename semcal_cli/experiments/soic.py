"""SOIC, for comparison: it moves points onto pixels of their class.

Source: Wang, Nobuhara, Nakamura and Sakurada, *SOIC: Semantic Online Initialization and Calibration for LiDAR and
Camera*, arXiv 2003.04260. Points and pixels need classes of the same names, and the method gives no uncertainty. Its
first stage, a start from semantic centroids, is left out: the experiments give all methods the same start.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import CalibrationError
from semcal_cli.experiments.soic_config import SoicConfig
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations


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
        self.distance = core.SemanticDistance(core_camera(observations.camera), parts, block=config.block_px)

    def cost(self, T_camera_lidar: Pose) -> float:
        """Compute the mean distance of points from the pixels of their class, averaged over classes, in pixels."""
        return self.distance.at(T_camera_lidar)

    def minimize(self, T_init: Pose) -> core.DistanceMinimum:
        """Minimise the cost from a pose.

        Raises:
            CalibrationError: no point projects into the image at that pose.
        """
        return self.distance.minimize(T_init, self.config)

    def _parts(self, frame: int) -> Iterator[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.float32]]]:
        """Yield the number, the points and the distance field of each shared class in a frame."""
        cloud = self.observations.clouds[frame]
        points, classes = cloud.points, cloud.classes
        image, block = self.observations.images[frame].classes, self.config.block_px
        height, width = (max(side // block, 1) for side in image.shape)
        for number, (point_class, pixel_class) in enumerate(self.classes):
            class_points = points[classes == point_class]
            is_other = image != pixel_class
            if len(class_points) == 0 or is_other.all():
                continue
            distances = cv2.distanceTransform(is_other.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            # Rows and columns after the last whole block are left out, so that all blocks have the same size.
            cropped = distances[: height * block, : width * block]
            block_means = cv2.resize(cropped, (width, height), interpolation=cv2.INTER_AREA)
            yield number, class_points, block_means.astype(np.float32, copy=False)
