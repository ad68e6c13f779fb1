"""Comparison of two transforms, with the 95 % intervals of each if they are known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.estimation.uncertainty.quantiles import overall_width
from semcal_cli.formats import Extrinsic
from semcal_cli.geometry.poses import PoseError, compare_poses
from semcal_cli.pipeline.verdict import Verdict
from semcal_cli.result import pixel_errors
from semcal_cli.result.refined_camera import camera_differences


@dataclass(frozen=True)
class Axis:
    """Difference of two transforms along or about one axis of the camera."""

    name: str
    """Name of the axis."""
    unit: str
    """Unit of all figures: "cm" or "deg"."""
    difference: float
    """Value of transform A minus that of B."""
    half_width_a: float | None
    """Half width of the 95 % interval of A; None if it is unknown."""
    half_width_b: float | None
    """Half width of the 95 % interval of B; None if it is unknown."""

    @property
    def is_explained(self) -> bool | None:
        """Whether the intervals explain the difference; None if one of them is unknown."""
        if self.half_width_a is None or self.half_width_b is None:
            return None
        return abs(self.difference) <= float(np.hypot(self.half_width_a, self.half_width_b))


@dataclass(frozen=True)
class ImageDifference:
    """How far apart two transforms put the same points in the image, and how far both intervals allow, in pixels."""

    range_m: float
    """Distance of the points from the camera of A."""
    ahead_px: float | None
    """Difference straight ahead; None for a lens that does not show it."""
    median_px: float
    """Median of the differences over the image."""
    worst_px: float
    """Largest difference over the image."""
    allowed_ahead_px: float | None
    """What both intervals allow straight ahead; None if one of them is unknown."""
    allowed_worst_px: float | None
    """The same at the place of the largest difference."""


@dataclass(frozen=True)
class Comparison:
    """Differences between two transforms, A minus B."""

    error: PoseError
    """Difference of the poses."""
    axes: tuple[Axis, ...]
    """Difference on each axis: x, y, z of the camera centre, then of the rotation."""
    maps: tuple[pixel_errors.PixelMap, ...] = ()
    """Differences over the image, by the range of points; empty if no camera is known, or the images have nothing in
    common."""
    in_image: tuple[ImageDifference, ...] = ()
    """Summary of each map."""
    note: str | None = None
    """Why the images are not compared; None if they are, or no camera is known."""

    def half_width(self, unit: str) -> float | None:
        """Compute the 95 % half width of the total difference, "cm" or "deg"; None if neither is known."""
        axes = [axis for axis in self.axes if axis.unit == unit]
        half_widths = [(axis.half_width_a, axis.half_width_b) for axis in axes]
        if (None, None) in half_widths:
            return None
        return overall_width(
            [axis.difference for axis in axes], [math.hypot(a or 0.0, b or 0.0) for a, b in half_widths]
        )

    def verdict(self, off: float, allowed: float, unit: str) -> Verdict:
        """Judge the total difference: it is undecided if it is beyond its limit by less than its half width."""
        if off <= allowed:
            return "pass"
        return "fail" if off - (self.half_width(unit) or 0.0) > allowed else "inconclusive"


def describe_cameras(a: Extrinsic, b: Extrinsic) -> str | None:
    """Describe how the cameras of two transforms differ if either was estimated; None if they do not."""
    has_estimate = any(
        extrinsic.record is not None and extrinsic.record.has_found_camera for extrinsic in (a, b)
    )
    if a.camera is None or b.camera is None or not has_estimate:
        return None
    differences = camera_differences(a.camera, b.camera, "B")
    return f"that of A has {', '.join(differences)}" if differences else None


def _describe_sizes(a: Extrinsic, b: Extrinsic) -> str | None:
    """Describe why two transforms are not compared in the image; None if their images have one size, or none known."""
    if a.camera is None or b.camera is None or a.camera.size == b.camera.size:
        return None
    size_a, size_b = ("{} x {}".format(*camera.size) for camera in (a.camera, b.camera))
    return f"the images are of {size_a} and {size_b} pixels, so the difference in the image is unknown"


def compare(a: Extrinsic, b: Extrinsic) -> Comparison:
    """Compare two transforms along the axes of B's camera, and in the image."""
    error = compare_poses(a.T_camera_lidar, b.T_camera_lidar)
    axes = []
    for index, offset in enumerate(error.offsets.tolist()):
        name, unit, scale = ("camera centre", "cm", 100.0) if index < 3 else ("rotation", "deg", 1.0)
        half_a, half_b = (
            None if extrinsic.half_widths is None else scale * extrinsic.half_widths[index]
            for extrinsic in (a, b)
        )
        axes.append(Axis(f"{name} {'xyz'[index % 3]}", unit, scale * offset, half_a, half_b))
    cameras = _cameras(a, b)
    if cameras is None:
        return Comparison(error, tuple(axes), note=_describe_sizes(a, b))
    maps = pixel_errors.difference_maps((a.T_camera_lidar, cameras[0]), (b.T_camera_lidar, cameras[1]))
    pairs = [pair for pair in zip(maps, _allowed(a, b, cameras), strict=True) if not pair[0].is_empty]
    in_image = tuple(_summarise(*pair) for pair in pairs)
    return Comparison(error, tuple(axes), tuple(error_map for error_map, _ in pairs), in_image)


def _cameras(a: Extrinsic, b: Extrinsic) -> tuple[Camera, Camera] | None:
    """Return the cameras of two transforms, where one that is unknown is that of the other; None without any.

    A LiDAR point is compared in one image, so cameras of other sizes have nothing in common.
    """
    camera_a, camera_b = a.camera or b.camera, b.camera or a.camera
    if camera_a is None or camera_b is None or camera_a.size != camera_b.size:
        return None
    return camera_a, camera_b


def _allowed(
    a: Extrinsic, b: Extrinsic, cameras: tuple[Camera, Camera]
) -> Sequence[tuple[pixel_errors.PixelMap, ...] | None]:
    """Map the intervals of both transforms, by range; None for each range if one of them is unknown or not believed."""
    maps = [
        uncertainty.pixel_maps(camera)
        for extrinsic, camera in zip((a, b), cameras, strict=True)
        if extrinsic.record is not None and (uncertainty := extrinsic.record.believed_uncertainty) is not None
    ]
    return [*zip(*maps, strict=True)] if len(maps) == 2 else [None] * len(pixel_errors.RANGES_M)


def _summarise(
    error_map: pixel_errors.PixelMap, allowed: tuple[pixel_errors.PixelMap, ...] | None
) -> ImageDifference:
    """Summarise a map of differences beside the intervals of both transforms, which are added as if independent.

    Two results with one K share its errors, so these intervals are not independent.
    """
    allowed_ahead_px = allowed_worst_px = None
    if allowed is not None:
        place = np.unravel_index(int(np.nanargmax(error_map.errors_px)), error_map.errors_px.shape)
        allowed_worst_px = _of_both(float(half.errors_px[place]) for half in allowed)
        allowed_ahead_px = _of_both(half.ahead_px for half in allowed)
    return ImageDifference(
        error_map.range_m,
        error_map.ahead_px,
        error_map.median_px,
        error_map.worst_px,
        allowed_ahead_px,
        allowed_worst_px,
    )


def _of_both(half_widths: Iterable[float | None]) -> float | None:
    """Compute the half width of a difference from those of two values as if independent; None if one is unknown."""
    half_width = math.hypot(*(math.nan if half is None else half for half in half_widths))
    return half_width if math.isfinite(half_width) else None
