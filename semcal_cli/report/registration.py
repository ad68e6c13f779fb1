"""Images of the registration (Alg. 2), after Fig. 1 of Jiang, Osteen and Saripalli (arXiv 2104.12023).

From top to bottom: the spherical label image of a sweep, the zoomed label image of the camera at its best shift on the
same grid, and the label image itself, joined by correspondences.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from semcal_cli import _core
from semcal_cli.config import InitializationConfig, Zoom
from semcal_cli.drive.frame_selection import evenly_spaced, few_frames
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import SemcalError
from semcal_cli.files.images import write_image
from semcal_cli.files.writing import make_folder
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.registration import Registration, place
from semcal_cli.report.colors import painted, palettes
from semcal_cli.report.overlay import Image, add_caption, overlay_paths
from semcal_cli.result.calibration import Calibration

AROUND_DEG = 10.0
"""Angle around the pose within which the shift is searched. The registration is good to a few degrees."""
WIDTH = 1280
"""Columns of an image."""
NUM_LINES = 60
"""Number of correspondences that are drawn."""
MIN_STRIP_ROWS = 120
"""Minimum number of rows of a strip, so that a sweep of few channels can be seen."""
EMPTY_COLOR = (24, 24, 24)
"""Blue, green and red of pixels without a class."""
LINE_COLOR = (235, 235, 235)
CAPTIONS = (
    "sweep: labels by azimuth and elevation",
    "camera: zoomed labels at the best shift",
    "correspondences with the label image",
)


@dataclass(frozen=True)
class RegistrationImages:
    """The registration near a pose of the frames that the search uses, drawn frame by frame."""

    observations: Observations
    registration: Registration
    zoom: Zoom
    middle: float
    """Azimuth of the optical axis in the LiDAR frame, in radians: the middle of the strips."""

    @classmethod
    def near(
        cls, observations: Observations, T_camera_lidar: Pose, config: InitializationConfig
    ) -> RegistrationImages:
        """Register the label images of the search again, within `AROUND_DEG` of the rotation of a pose (4, 4).

        Raises:
            CalibrationError: sweeps and images do not overlap there.
            InputError: the points do not lie in the field of view of the drive's `lidar:` block.
        """
        observations = few_frames(observations, config.max_frames)
        T = np.eye(4)
        T[:3, :3] = T_camera_lidar[:3, :3]
        placed = place(observations, config, (T, math.radians(AROUND_DEG)))
        return cls(observations, placed, config.zoom, math.atan2(T[2, 1], T[2, 0]))

    @classmethod
    def of_record(cls, observations: Observations, record: Calibration) -> RegistrationImages | None:
        """Register again near the first stage of a calibration; None if it started at a pose or nothing overlaps."""
        if not any(each.num_pairs is not None for each in record.hypotheses):
            return None
        options = record.settings.options.get("initialization")
        found = options.get("zoom") if isinstance(options, dict) else None
        zoom: Zoom = "paper" if found == "paper" else "exact"
        T_initial = next(iter(record.stages.values())).T_camera_lidar
        try:
            return cls.near(observations, np.array(T_initial), InitializationConfig(zoom=zoom))
        except SemcalError:
            return None

    def write_all(self, folder: Path, max_images: int) -> Iterator[Path]:
        """Write PNGs of evenly spaced frames into a folder, which is made, and give each path when it is written.

        Raises:
            InputError: a file cannot be written.
        """
        make_folder(folder)
        frames = evenly_spaced(range(self.observations.num_frames), max_images)
        for frame, path in zip(frames, overlay_paths(folder, max_images), strict=False):
            write_image(self.draw(frame), path)
            yield path

    def draw(self, frame: int) -> Image:
        """Draw a frame, numbered from 0."""
        images, (point_colors, pixel_colors) = self.registration.images, palettes(self.observations)
        zoomed = self.registration.placements[0].zoomed(self.observations.core, images, self.zoom, frame)
        labels = painted(self.observations.images[frame].classes, pixel_colors, EMPTY_COLOR)
        strips = [
            self._strip(painted(images.classes(frame), point_colors, EMPTY_COLOR)),
            self._strip(painted(zoomed, pixel_colors, EMPTY_COLOR)),
        ]
        scale = WIDTH / labels.shape[1]
        camera_image = _resized(labels, max(1, round(labels.shape[0] * scale)))
        parts = [
            add_caption(part, text, WIDTH)
            for part, text in zip((*strips, camera_image), CAPTIONS, strict=True)
        ]
        canvas: Image = np.vstack(parts)
        strip_rows = strips[0].shape[0]
        caption, top = parts[0].shape[0] - strip_rows, canvas.shape[0] - camera_image.shape[0]
        points, pixels = self._correspondences(frame)
        columns, rows = self._on_strip(points, strip_rows)
        starts = np.column_stack([columns, rows]).astype(int)
        ends = (scale * (pixels + 0.5)).astype(int)
        for (x, y), (u, v) in zip(starts.tolist(), ends.tolist(), strict=True):
            cv2.line(canvas, (x, y + caption), (u, v + top), LINE_COLOR, 1, cv2.LINE_AA)
        return canvas

    def _strip(self, image: Image) -> Image:
        """Turn a spherical image so that the optical axis is in its middle, and scale it to the image's width."""
        columns = image.shape[1]
        turned = np.roll(image, round(self.middle / (2.0 * math.pi) * columns), axis=1)
        return _resized(turned, max(MIN_STRIP_ROWS, round(image.shape[0] * WIDTH / columns)))

    def _correspondences(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (N, 3), metres, LiDAR frame, and pixels (N, 2) of some correspondences of a frame."""
        core = self.observations.of_frames([frame]).core
        images = _core.SphericalImages(core, self.registration.images.grid)
        placement = self.registration.placements[0]
        (pairs,) = _core.sample_correspondences(core, images, self.zoom, [placement], NUM_LINES, 0)
        return pairs.points, pairs.pixels

    def _on_strip(self, points: np.ndarray, strip_rows: int) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows (N,) of points on the strip of the sweep."""
        (x, y, z), grid = points.T, self.registration.images.grid
        columns = ((self.middle - np.arctan2(y, x)) / (2.0 * math.pi) + 0.5) % 1.0 * WIDTH
        rows = (grid.top - np.arctan2(z, np.hypot(x, y))) / (grid.rows * grid.cell_height) * strip_rows
        return columns, rows


def _resized(image: Image, rows: int) -> Image:
    return np.asarray(cv2.resize(image, (WIDTH, rows), interpolation=cv2.INTER_NEAREST), np.uint8)
