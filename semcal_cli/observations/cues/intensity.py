"""The intensity cue: the LiDAR's intensities against the grey values of the images.

Source: Pandey, McBride, Savarese, Eustice, *Automatic extrinsic calibration of vision and lidar by maximizing mutual
information* (Journal of Field Robotics, 2015). Each value is taken relative to its surroundings, a few degrees across.
This removes the effects of range, incidence, light and exposure, which vary slowly, and keeps the edges of materials.
The values are divided into equally frequent levels, which take the place of classes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import Mask, Numbers
from semcal_cli.observations.cues.cue import Cue
from semcal_cli.observations.cues.segments import STARTS
from semcal_cli.observations.masks import seen_pixels
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.observations import NO_CLASS, LabelledCloud, LabelledImage, Observations
from semcal_cli.observations.reading import make_observations, read_clouds, read_needed_image
from semcal_cli.threads import thread_pool

CELL_DEG = 0.5
"""Size of the cells of directions in which the surroundings of points are summed."""
BLOCKS_A_SIGMA = 8.0
"""Blocks per standard deviation of the blur with which the surroundings of pixels are summed."""
MIN_SPREAD = 0.02
"""Smallest spread of the surroundings, relative to the spread of all values. Smaller spreads are noise."""
SAMPLES = 200_000
"""Number of values from which the limits of the levels are computed."""


@dataclass(frozen=True)
class IntensityConfig:
    """How intensities become levels.

    With 16 levels and surroundings of 4 degrees, 10 of 10 refinements from 2 degrees and 0.2 m converged on two
    development drives of 20 pairs; with raw intensities, 5 of 10.
    """

    num_levels: int = 16
    """Number of levels, which take the place of classes."""
    surroundings_deg: float = 4.0
    """Standard deviation of the window over which mean and contrast are taken."""


INTENSITY = IntensityConfig()


def observe_intensity(
    drive: Drive, sweeps: SweepCache | None = None, is_raw: bool = False, config: IntensityConfig = INTENSITY
) -> Observations:
    """Load every frame of a drive, with levels of intensity as classes.

    Each frame needs an image, and each cloud intensities. Raw intensities and grey values are not taken relative to
    their surroundings; they become vectors of one number, with unit variance over all frames on each side.

    Raises:
        InputError: a file is missing or wrong, a frame has no image, or a cloud has no intensity.
        CalibrationError: the intensities or the grey values are nearly all the same.
    """
    clouds = read_clouds(drive, sweeps)
    moved = compensated(drive, clouds)
    masks = seen_pixels(drive, drive.frames)

    def pixels_of(frame: Frame, mask: Mask) -> Numbers:
        grey = grey_values(drive, frame)
        return grey if is_raw else _contrast_of_pixels(drive.camera, grey, mask, config)

    def points_of(frame: Frame, cloud: SweepCloud, points: npt.NDArray[np.float32]) -> Numbers:
        intensities = _intensity(drive, frame, cloud)
        return intensities if is_raw else _contrast_of_points(drive.rays(points), intensities, config)

    with thread_pool() as pool:
        pixel_values = list(pool.map(pixels_of, drive.frames, masks))
        point_values = list(pool.map(points_of, drive.frames, clouds, [sweep.points for sweep in moved]))
    point_limits = _limits(drive, "intensity", np.concatenate(point_values), config)
    # Each image has its own exposure, unless it is raw; the sensor's intensity has a single scale.
    pixels = [image[mask] for image, mask in zip(pixel_values, masks, strict=True)]
    compared = [np.concatenate(pixels)] * len(pixel_values) if is_raw else pixels
    images = []
    for image, mask, values in zip(pixel_values, masks, compared, strict=True):
        levels = np.digitize(image, _limits(drive, "grey", values, config))
        classes = np.where(mask, levels, NO_CLASS).astype(np.uint8)
        images.append(LabelledImage(classes, blur_px=None if is_raw else 0.0))
    labelled = [
        LabelledCloud(sweep.points, np.digitize(values, point_limits).astype(np.uint8))
        for sweep, values in zip(moved, point_values, strict=True)
    ]
    if is_raw:
        labelled = [
            replace(cloud, vectors=vectors)
            for cloud, vectors in zip(labelled, _standardized(point_values), strict=True)
        ]
        images = [
            replace(image, vectors=vectors)
            for image, vectors in zip(images, _standardized(pixel_values), strict=True)
        ]
    names = [str(level) for level in range(config.num_levels)]
    return make_observations(drive, clouds, moved, labelled, images, (names, names))


def _standardized(values: Sequence[Numbers]) -> list[npt.NDArray[np.float16]]:
    """Scale the values of all frames to zero mean and unit variance, each as a vector of one channel."""
    pooled = np.concatenate([frame_values.ravel() for frame_values in values])
    mean, spread = pooled.mean(), pooled.std()
    return [((frame_values - mean) / spread)[..., None].astype(np.float16) for frame_values in values]


def _intensity(drive: Drive, frame: Frame, cloud: SweepCloud) -> Numbers:
    if cloud.intensity is None:
        raise InputError(
            f"{drive.resolve(frame.points)}: found no intensity, expected one for each point for this cue"
        )
    values = cloud.intensity.astype(np.float64)
    if not np.isfinite(values).all():
        raise InputError(f"{drive.resolve(frame.points)}: intensity: found values that are not finite")
    return values


def grey_values(drive: Drive, frame: Frame) -> Numbers:
    """Read the grey values (H, W) of a frame's image, 0 to 255."""
    return cv2.cvtColor(read_needed_image(drive, frame), cv2.COLOR_BGR2GRAY).astype(np.float64)


def surroundings(
    camera: Camera, sigma_deg: float, across_deg: float | None = None
) -> Callable[[npt.NDArray[Any]], npt.NDArray[np.float32]]:
    """Make a function that blurs an image (H, W) with this standard deviation, degrees, and `across_deg` downwards."""
    along_across = np.array([sigma_deg, across_deg or sigma_deg])
    sigmas_px = np.radians(along_across) * core_camera(camera).pixels_per_radian
    # The surroundings vary slowly, so a small image is enough.
    factors = np.maximum(sigmas_px / BLOCKS_A_SIGMA, 1.0)
    width, height = (max(1, round(size / factor)) for size, factor in zip(camera.size, factors, strict=True))
    sigma_x, sigma_y = sigmas_px / factors

    def blur(values: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        small = cv2.resize(values.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        smooth = cv2.GaussianBlur(small, (0, 0), sigma_x, sigmaY=sigma_y)
        return np.asarray(cv2.resize(smooth, camera.size), np.float32)

    return blur


def _contrast_of_pixels(
    camera: Camera, grey: Numbers, mask: npt.NDArray[np.bool_], config: IntensityConfig
) -> Numbers:
    """Compute the contrast of grey values (H, W) relative to their surroundings."""
    blur = surroundings(camera, config.surroundings_deg)
    weights = blur(mask).astype(np.float64)
    grey = np.where(mask, grey, 0.0)
    sums, squares = blur(grey).astype(np.float64), blur(grey**2).astype(np.float64)
    return _contrast(grey, weights, sums, squares, float(grey[mask].std()))


def _contrast_of_points(points: npt.NDArray[np.float32], values: Numbers, config: IntensityConfig) -> Numbers:
    """Compute the contrast of the intensities (N,) of points (N, 3) relative to those in nearby directions."""
    from scipy.ndimage import gaussian_filter

    x, y, z = points.astype(np.float64).T
    azimuth, elevation = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    columns, rows = round(360.0 / CELL_DEG), round(180.0 / CELL_DEG)
    column = ((azimuth + 180.0) / CELL_DEG).astype(int) % columns
    row = np.clip((elevation + 90.0) / CELL_DEG, 0, rows - 1).astype(int)

    def around(summands: Numbers) -> Numbers:
        sums = np.bincount(row * columns + column, summands, rows * columns).reshape(rows, columns)
        # The columns of the grid cover a full turn.
        smooth = gaussian_filter(sums, config.surroundings_deg / CELL_DEG, mode=("nearest", "wrap"))
        return np.asarray(smooth[row, column])

    return _contrast(
        values, around(np.ones(len(values))), around(values), around(values**2), float(values.std())
    )


def _contrast(values: Numbers, weights: Numbers, sums: Numbers, squares: Numbers, spread: float) -> Numbers:
    """Compute the deviation from the mean of the surroundings, in standard deviations of the surroundings."""
    weights = np.maximum(weights, np.finfo(np.float64).tiny)
    mean = sums / weights
    variance = np.maximum(squares / weights - mean**2, (MIN_SPREAD * spread) ** 2)
    return np.asarray((values - mean) / np.sqrt(np.maximum(variance, np.finfo(np.float64).tiny)))


def _limits(drive: Drive, side: str, values: Numbers, config: IntensityConfig) -> Sequence[float]:
    """Find the limits between equally frequent levels."""
    some = values[:: max(1, len(values) // SAMPLES)]
    limits: list[float] = np.quantile(some, np.linspace(0.0, 1.0, config.num_levels + 1)[1:-1]).tolist()
    if not limits[0] < limits[-1]:
        raise CalibrationError(
            f"{drive.path}: {side} is nearly the same everywhere: it says nothing about the pose"
        )
    return limits


CUE = Cue(observe=observe_intensity, files=("image",), config=INTENSITY, starts=STARTS, is_weak=True)
