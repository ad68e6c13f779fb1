"""The edges cue: steps along the scans of sweeps against gradients of the images. No labels are needed.

A LiDAR scans as it turns. Where the range steps, the nearer surface ends, and the image changes along the scan line;
where the intensity steps, the material changes. Levinson and Thrun, *Automatic Online Calibration of Cameras and
Lasers* (RSS 2013), multiply the two. Here, levels of steps and levels of gradients are classes, and mutual information
weights them by the data. Edges between rings are left out: they are half a ring off, which is 0.2 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from semcal_cli import core
from semcal_cli.config import ContrastConfig, ExactConfig, StartsConfig
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import CalibrationError, name_in_errors
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import ClassIds, Image, Mask, Numbers, Points, Values
from semcal_cli.observations.cues.cue import Cue
from semcal_cli.observations.cues.intensity import surroundings
from semcal_cli.observations.masks import seen_pixels
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.observations import (
    NO_CLASS,
    Z_AXIS,
    Along,
    LabelledCloud,
    LabelledImage,
    Observations,
    ScanLines,
)
from semcal_cli.observations.reading import make_observations, read_clouds, read_needed_image
from semcal_cli.threads import thread_pool

NO_EDGE = 0
"""Class of a point next to which nothing changes."""
SOBEL_SUM = 8.0
"""Sum of the weights of Sobel's filter for a slope of 1."""
MIN_GRADIENT = 0.006
"""Gradient of the logarithm of colours, per pixel, that is added to that of the surroundings: less is sensor noise."""
DARK = 8.0
"""Value that is added to colours, 0 to 255, before their logarithm is taken: less is dark. With 3 to 50, poses by real
drives scatter alike (docs/benchmarks_cues.md)."""


@dataclass(frozen=True)
class EdgesConfig:
    """How steps along the scans of sweeps, and gradients of images, become classes."""

    range_steps_m: tuple[float, ...] = (0.3, 1.0, 3.0)
    """Smallest step in range of each level, metres."""
    range_share: float = 0.01
    """Share of a point's range that is added to these steps."""
    intensity_shares: tuple[float, ...] = (0.1, 0.05, 0.02)
    """Share of the points, those with the largest steps in intensity, that reach each level."""
    same_surface_m: float = 0.3
    """Neighbours that differ by less than this in range lie on one surface, whose intensity may step."""
    plain_per_edge: float = 3.0
    """Number of points without an edge for each point with one; more cost time and add little."""
    num_levels: int = 8
    """Number of equally frequent levels of the gradient of an image."""
    blur_rays: float = 0.3
    """Standard deviation of the blur of an image before and after its gradient is taken, in angles between
    neighbouring rays: a step lies anywhere between two rays. docs/benchmarks_cues.md compares it with 0.5."""
    most_blur_across_deg: float = 0.05
    """Largest standard deviation of the blur across the scans, degrees: a step is where its ring is, and a blur of a
    coarse LiDAR's rays moves the upper edge downwards (tests/benchmarks/hand_eye.py)."""
    least_blur_px: float = 0.7
    """Smallest standard deviation of the blur, pixels."""
    level_blur_px: float = 1.0
    """Standard deviation of the blur of the levels at full resolution, pixels. From 0.7 to 1.5 pixels the pose scatters
    alike; without a blur the information is too rough to bend steadily from pixel to pixel."""
    surroundings_deg: float = 6.0
    """Standard deviation of the window over which the mean of the gradients is taken, along the scans, degrees."""
    surroundings_across_deg: float = 1.5
    """The same across the scans. Gradients become weaker from the horizon to the road, and steps rarer; a window as
    high as wide leaves some of that, which pulls the pitch (docs/benchmarks_lidars.md)."""


EDGES = EdgesConfig()


def observe_edges(
    drive: Drive, sweeps: SweepCache | None = None, is_raw: bool = False, config: EdgesConfig = EDGES
) -> Observations:
    """Load every frame of a drive, with levels of steps and of gradients as classes, whether raw or not.

    Each frame needs an image. Intensities of points are used if all clouds have them.

    Raises:
        InputError: a file is missing or wrong, or a frame has no image.
        CalibrationError: no sweep or no image has edges.
    """
    clouds = read_clouds(drive, sweeps)
    moved = compensated(drive, clouds)
    edges = edges_of_sweeps(clouds, config, drive.rays)
    if not any((classes[classes != NO_CLASS] != NO_EDGE).any() for classes in edges.classes):
        raise CalibrationError(
            f"{drive.path}: found no edges in any sweep, expected steps in range or intensity"
        )
    if edges.spacing == 0.0:
        raise CalibrationError(
            f"{drive.path}: found no rays within 1.1 degrees of each other along the scans"
        )
    blur_px = max(
        config.blur_rays * edges.spacing * core_camera(drive.camera).pixels_per_radian, config.least_blur_px
    )

    graded = partial(_read_graded, drive, blur_px, config, edges.axis)
    with thread_pool() as pool:
        images = list(pool.map(graded, drive.frames, seen_pixels(drive, drive.frames)))
    if not any(len(np.unique(image.classes[image.classes != NO_CLASS])) > 1 for image in images):
        raise CalibrationError(
            f"{drive.path}: image is nearly the same everywhere: it says nothing about the pose"
        )
    labelled = [
        LabelledCloud(sweep.points + to_step, classes, plain_class=NO_EDGE)
        for sweep, to_step, classes in zip(moved, edges.to_steps_m, edges.classes, strict=True)
    ]
    levels = [f"gradient {level}" for level in range(config.num_levels)]
    return make_observations(drive, clouds, moved, labelled, images, (edges.names, levels))


class SweepEdges(NamedTuple):
    """The edges of the sweeps of a drive."""

    classes: list[ClassIds]
    """Class of each point (N,) of each sweep; `NO_CLASS` without a return, and for surplus points without an edge."""
    to_steps_m: list[Values]
    """(N, 3) vector from each point with an edge to the step beside it, metres; 0 for others."""
    names: list[str]
    """Names of the classes: no edge, levels of steps in intensity, and levels of steps in range. If a point has both
    steps, that in range counts."""
    spacing: float
    """Angle between neighbouring rays, radians: the median of the sweeps' medians."""
    axis: Numbers
    """(3,) axis about which the LiDAR turns, LiDAR frame, with either sign: the mean of the sweeps'."""


def edges_of_sweeps(
    clouds: Sequence[SweepCloud],
    config: EdgesConfig = EDGES,
    rays: Callable[[Points], Points] = lambda points: points,
) -> SweepEdges:
    """Find the edges of sweeps along their scans; `rays` finds their vectors from where they start."""
    points = [rays(cloud.points) for cloud in clouds]
    of_clouds = [cloud.intensity for cloud in clouds]
    columns = [np.nan_to_num(values.astype(np.float32)) for values in of_clouds if values is not None]
    has_intensity = len(columns) == len(clouds)
    intensities = columns if has_intensity else [None] * len(clouds)
    rings = [cloud.ring for cloud in clouds]
    steps = core.edge_steps(list(zip(points, intensities, rings, strict=True)), config.same_surface_m)
    limits: list[float] = []
    if has_intensity:
        values = np.concatenate([sweep.intensity for sweep in steps if sweep.intensity is not None])
        values = values[np.isfinite(values)]
        if values.size and values.max() > 0.0:
            limits = np.quantile(values, 1.0 - np.array(config.intensity_shares)).tolist()
    names = [
        "no edge",
        *(f"intensity step {level + 1}" for level in range(len(limits))),
        *(f"range step {level + 1}" for level in range(len(config.range_steps_m))),
    ]
    classes, to_steps_m = [], []
    for of_sweep, sweep in zip(points, steps, strict=True):
        of_points = _classes(np.linalg.norm(of_sweep, axis=1), sweep, limits, config)
        is_edge = (of_points != NO_CLASS) & (of_points != NO_EDGE)
        steps_in_range = is_edge & (of_points > len(limits))
        to_steps = np.where(steps_in_range[:, None], sweep.to_range_step_m, sweep.to_intensity_step_m)
        classes.append(of_points)
        to_steps_m.append(np.asarray(np.where(is_edge[:, None], to_steps, 0.0), np.float32))
    spacing = float(np.median([sweep.spacing for sweep in steps]))
    return SweepEdges(classes, to_steps_m, names, spacing, _axis_of(steps))


def _axis_of(sweeps: Sequence[core.Steps]) -> Numbers:
    """Compute the mean axis (3,) of the sweeps that tell one; z if none does. Either end of it may be meant."""
    axes = np.array([sweep.axis for sweep in sweeps if sweep.axis is not None] or [[*Z_AXIS]])
    return np.asarray(np.linalg.eigh(axes.T @ axes).eigenvectors[:, -1])


def _classes(ranges_m: Values, steps: core.Steps, limits: Sequence[float], config: EdgesConfig) -> ClassIds:
    classes = np.full(len(steps.range_m), NO_EDGE, np.uint8)
    if steps.intensity is not None:
        for level, limit in enumerate(limits):
            classes[steps.intensity > limit] = level + 1
    allowed = config.range_share * ranges_m
    for level, step_m in enumerate(config.range_steps_m):
        classes[steps.range_m > step_m + allowed] = len(limits) + level + 1
    num_plain = max(int(config.plain_per_edge * np.sum(classes != NO_EDGE)), 1)
    classes[np.isnan(steps.range_m)] = NO_CLASS
    # Points next to which nothing changes are many and much alike: some of them are enough.
    plain = np.flatnonzero(classes == NO_EDGE)
    is_dropped = np.random.default_rng(0).random(len(plain)) * len(plain) > num_plain
    classes[plain[is_dropped]] = NO_CLASS
    return classes


def _read_graded(
    drive: Drive,
    blur_px: float,
    config: EdgesConfig,
    axis: Numbers,
    frame: Frame,
    mask: Mask | None = None,
    along: Along = "rows",
) -> LabelledImage:
    """Read the image of a frame, and find the levels of its gradients along the scan lines of a LiDAR.

    The mask (H, W) of the pixels that show the scene is read if it is not given.
    """
    image = read_needed_image(drive, frame)
    (mask,) = [mask] if mask is not None else seen_pixels(drive, [frame])
    with name_in_errors(drive.resolve(str(frame.image))):
        levels = _levels(drive.camera, image, mask, blur_px, config, along)
    lines = ScanLines(axis.tolist(), along, partial(_read_graded, drive, blur_px, config, axis, frame, None))
    return LabelledImage(levels, blur_px=config.level_blur_px, scan_lines=lines)


def _levels(
    camera: Camera, image: Image, mask: Mask, blur_px: float, config: EdgesConfig, along: Along
) -> ClassIds:
    """Compute the level (H, W) of the gradient of an image along scan lines, relative to its surroundings."""
    strength, is_inside = gradients(camera, image, mask, blur_px, config, along)
    if not is_inside.any():
        raise CalibrationError(
            "found no pixel that is inside the lens and far enough from its border, expected image gradients"
        )
    limits = np.quantile(strength[is_inside], np.linspace(0.0, 1.0, config.num_levels + 1)[1:-1])
    levels = np.zeros(strength.shape, np.uint8)
    if limits[0] < limits[-1]:
        for limit in limits:  # A loop over few limits takes a tenth of the time of a search for each pixel.
            levels += strength >= limit
    return np.where(is_inside, levels, np.uint8(NO_CLASS))


def gradients(
    camera: Camera,
    image: Image,
    mask: Mask,
    blur_px: float,
    config: EdgesConfig = EDGES,
    along: Along = "rows",
) -> tuple[Values, Mask]:
    """Compute the gradients of an image along scan lines, relative to their mean in the surroundings.

    They are those of the logarithm of the colours, so that an edge is as strong in the shade as in the light.

    Args:
        camera: The camera, whose lens converts angles to pixels.
        image: (H, W, 3) colours.
        mask: (H, W) pixels that show the scene and are within the reach of the lens.
        blur_px: Standard deviation of the blur before and after the gradient is taken; smaller across the scan lines
            where it is more than the config allows.
        config: Settings of the cue.
        along: The lines of pixels that scan lines are along.

    Returns:
        Strength of the gradient (H, W), and whether (H, W) all pixels that it comes from are in the mask.
    """
    across_px = math.radians(config.most_blur_across_deg) * core_camera(camera).pixels_per_radian
    across_px = max(min(blur_px, across_px), config.least_blur_px)
    (blur_x, blur_y), around_x_y = (
        pair if along == "rows" else pair[::-1]
        for pair in ((blur_px, across_px), (config.surroundings_deg, config.surroundings_across_deg))
    )
    blurred = partial(cv2.GaussianBlur, ksize=(0, 0), sigmaX=blur_x, sigmaY=blur_y)
    smooth = blurred(np.log(image.astype(np.float32) + DARK))
    reach = 2 * int(np.ceil(3.0 * blur_px)) + 3
    # The border of the image is not a border of the mask.
    padded = np.pad(mask.astype(np.uint8), 1, mode="edge")
    is_inside = cv2.erode(padded, np.ones((reach, reach), np.uint8))[1:-1, 1:-1] > 0
    dx, dy = (1, 0) if along == "rows" else (0, 1)
    of_colors = cv2.Sobel(smooth, cv2.CV_32F, dx, dy, ksize=3, scale=1.0 / SOBEL_SUM)
    strength = np.sqrt(np.mean(np.square(of_colors), axis=2)) * is_inside
    mean_around = surroundings(camera, *around_x_y)
    weights = np.maximum(mean_around(is_inside), np.finfo(np.float32).tiny)
    beside = strength / (mean_around(strength) / weights + MIN_GRADIENT)
    return np.asarray(blurred(beside), np.float32), is_inside


MIN_SCENES = 4
"""Minimum number of scenes from which a pose by edges is trusted: the limit of `few-scenes`, which has the source."""
STARTS = StartsConfig(
    coarsest_block_deg=2.6,
    min_blocks=8,
    num_starts=(64, 24, 12, 6, 4, 3),
    spread_deg=(1.0, 5.0),
    spread_m=(0.1, 0.3),
    farthest_deg=9.0,
    num_rounds=1,
    coarse=ExactConfig(steps=40, batch_size=2048, max_points=60_000),
)
"""On blocks of 2.6 degrees, single ascents on three real drives converged from 2 degrees and 0.2 m in 75 to 97 % of 40
runs, and from 5 degrees and 0.3 m in 15 to 65 %; the one that ended highest was always right."""
STARTS_ALONE = replace(
    STARTS,
    coarsest_block_deg=0.9,
    num_starts=(32, 12, 6, 4),
    farthest_deg=6.5,
    farthest_m=0.4,
    contrast=ContrastConfig(
        class_weights={"range step 1": 1.0, "range step 2": 2.0, "range step 3": 3.0},
        num_draws=300,
        max_points=10_000,
        distance_weight=0.1,
    ),
    searches_beside=True,
)
"""A start is known to 5 degrees and 0.3 m. Farther away, information may be higher where edges lie on weak gradients.
Larger steps in range are more surely edges of the image than smaller ones, and than steps in intensity: on a street of
KITTI-360, fewer random poses have more contrast than the published one (tests/benchmarks/contrast.py)."""
CUE = Cue(
    observe=observe_edges,
    files=("image",),
    config=EDGES,
    starts=STARTS,
    starts_alone=STARTS_ALONE,
    can_find_mounting=False,
    min_scenes=MIN_SCENES,
)
