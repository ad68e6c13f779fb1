"""Pictures of the registration (Alg. 2), after Fig. 1 of Jiang, Osteen and Saripalli (arXiv 2104.12023).

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
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.config import InitializationConfig, Zoom
from semcal_cli.drive.frame_selection import evenly_spaced, few_frames
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import SemcalError
from semcal_cli.files.images import write_image
from semcal_cli.files.writing import make_folder
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.registration import Registration, place
from semcal_cli.report.colors import Colors, palettes
from semcal_cli.report.overlay import Image, add_caption, overlay_paths
from semcal_cli.result.calibration import Calibration

AROUND_DEG = 10.0
"""The shift is searched within this angle of the pose: the registration is good to a few degrees."""
WIDTH = 1280
"""Columns of a picture."""
NUM_LINES = 60
"""Number of correspondences that are drawn."""
MIN_STRIP_ROWS = 120
"""Rows of a spherical image in a picture, at least; few channels would hardly be seen."""
EMPTY_COLOR = (24, 24, 24)
LINE_COLOR = (235, 235, 235)
CAPTIONS = (
    "sweep: labels by azimuth and elevation",
    "camera: zoomed labels at the best shift",
    "correspondences, down to the camera's labels",
)


@dataclass(frozen=True)
class RegistrationPictures:
    """The registration of the frames that the search looks at near a pose, to be drawn frame by frame."""

    observations: Observations
    registration: Registration
    config: InitializationConfig
    middle: float
    """Azimuth of the optical axis in the LiDAR frame, in radians: the middle of the strips."""

    @classmethod
    def near(
        cls, observations: Observations, T_camera_lidar: Pose, config: InitializationConfig
    ) -> RegistrationPictures:
        """Register the label images of the search anew within `AROUND_DEG` of a pose (4, 4), as its rotation says.

        Raises:
            CalibrationError: sweeps and images do not overlap there.
            InputError: the points do not lie in the field of view of the drive's `lidar:` block.
        """
        observations = few_frames(observations, config.max_frames)
        T = np.eye(4)
        T[:3, :3] = T_camera_lidar[:3, :3]
        placed = place(observations, config, (T, math.radians(AROUND_DEG)))
        return cls(observations, placed, config, math.atan2(T[2, 1], T[2, 0]))

    @classmethod
    def of_record(cls, observations: Observations, record: Calibration) -> RegistrationPictures | None:
        """Register anew near the first stage of a calibration; None if it began at a given pose or nothing overlaps."""
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
        placement, images = self.registration.placements[0], self.registration.images
        of_points, of_pixels = palettes(self.observations)
        sweep = images.classes(frame)
        zoomed = placement.zoomed(self.observations.core, images, self.config.zoom, frame)
        strips = [self._strip(_colored(sweep, of_points)), self._strip(_colored(zoomed, of_pixels))]
        labels = _colored(self.observations.images[frame].classes, of_pixels)
        scale = WIDTH / labels.shape[1]
        size = WIDTH, max(1, round(labels.shape[0] * scale))
        picture = _resized(labels, size)
        parts = [
            add_caption(part, text, WIDTH) for part, text in zip((*strips, picture), CAPTIONS, strict=True)
        ]
        canvas: Image = np.vstack(parts)
        top = canvas.shape[0] - picture.shape[0]
        caption = parts[0].shape[0] - strips[0].shape[0]
        for start, end in self._lines(frame, strips[0].shape[0], scale):
            cv2.line(
                canvas,
                (start[0], start[1] + caption),
                (end[0], end[1] + top),
                LINE_COLOR,
                1,
                cv2.LINE_AA,
            )
        return canvas

    def _strip(self, image: Image) -> Image:
        """Turn a spherical image so that the optical axis is in its middle, and scale it to the picture's width."""
        columns = image.shape[1]
        turned = np.roll(image, round(self.middle / (2.0 * math.pi) * columns), axis=1)
        rows = max(MIN_STRIP_ROWS, round(image.shape[0] * WIDTH / columns))
        return _resized(turned, (WIDTH, rows))

    def _lines(
        self, frame: int, strip_rows: int, scale: float
    ) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
        """Give the ends of correspondences: on the strip of the sweep, and on the scaled picture."""
        one = self.observations.of_frames([frame])
        grid = self.registration.images.grid
        (pairs,) = _core.sample_correspondences(
            one.core,
            _core.SphericalImages(one.core, grid),
            self.config.zoom,
            [self.registration.placements[0]],
            NUM_LINES,
            0,
        )
        x, y, z = pairs.points.T
        right = self.middle - np.arctan2(y, x)
        columns = (right / (2.0 * math.pi) + 0.5) % 1.0 * WIDTH
        rows = (grid.top - np.arctan2(z, np.hypot(x, y))) / (grid.rows * grid.cell_height) * strip_rows
        pixels = (pairs.pixels + 0.5) * scale
        starts = np.column_stack([columns, rows]).astype(int).tolist()
        for start, end in zip(starts, pixels.astype(int).tolist(), strict=True):
            yield (start[0], start[1]), (end[0], end[1])


def _colored(classes: npt.NDArray[np.uint8], palette: Colors) -> Image:
    """Colour a label image; pixels without a class are dark."""
    table = np.full((256, 3), EMPTY_COLOR, np.uint8)
    table[: len(palette)] = palette
    return table[classes]


def _resized(image: Image, size: tuple[int, int]) -> Image:
    resized: Image = cv2.resize(image, size, interpolation=cv2.INTER_NEAREST).astype(np.uint8, copy=False)
    return resized
