"""A point cloud for the 3-D view: points that the camera sees have colours, the others are grey."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.document import Camera
from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.drive.reading import read_frame_image
from semcal_cli.geometry.poses import Pose, camera_center, inverse
from semcal_cli.report.colors import Colors, hex_color, palettes
from semcal_cli.report.input import ReportInput
from semcal_cli.report.overlay import points_in_image
from semcal_cli.report.points import packed

MAX_SEEN, MAX_OTHERS = 16_000, 8_000
"""Largest number of points kept that the camera sees, and of points that it does not see."""
MAX_RANGE_M = 120.0
"""Largest range of the points that the view shows."""
GREY = 92
FRUSTUM_M = 1.0
"""Length of the drawn edges of the camera's view."""


@dataclass(frozen=True)
class Cloud:
    """Points and the camera, in the LiDAR frame; arrays as base64 for the page's script."""

    frame: str
    positions_cm: str
    """int16, little-endian, (N, 3)."""
    colors: dict[str, str]
    """uint8 red, green, blue, (N, 3), by the meaning of the colours."""
    legends: dict[str, dict[str, str]]
    """Colour of each visible class, as #rrggbb, by the meaning of the colours."""
    camera_center: list[float]
    optical_axis: list[float]
    corners: list[list[float]]
    """Ends of the edges of the camera's view; empty if the lens does not reach the corners of the image."""


def frame_cloud(report: ReportInput) -> Cloud:
    """Colour a frame's points by the label of the pixel they project onto, by their own label, and by the image.

    The frame is the first one that has an image, else the first of all.
    """
    observations, T = report.observations, report.T_camera_lidar
    names = [frame.image for frame in report.drive.frames]
    number = next((i for i, name in enumerate(names) if name is not None), 0)
    points, classes = observations.clouds[number].points, observations.clouds[number].classes
    seen = points_in_image(points, T, observations.camera)
    visible = thinned(~seen.is_hidden, MAX_SEEN)
    is_other = np.linalg.norm(points, axis=1) < MAX_RANGE_M
    is_other[seen.indices[~seen.is_hidden]] = False
    others = thinned(is_other, MAX_OTHERS)
    pixels, indices = seen.pixels[visible], seen.indices[visible]
    kept = np.concatenate([indices, others])
    of_points, of_pixels = palettes(observations)
    pixel_classes = at_pixels(observations.images[number].classes, pixels)
    point_classes = classes[indices]
    by = {
        "label of the pixel": _label_colors(pixel_classes, of_pixels),
        "label of the point": _label_colors(point_classes, of_points),
    }
    legends = {
        "label of the pixel": _legend(pixel_classes, observations.image_class_names, of_pixels),
        "label of the point": _legend(point_classes, observations.point_class_names, of_points),
    }
    image = read_frame_image(report.drive, report.drive.frames[number])
    if image is not None:
        by["picture"] = at_pixels(image, pixels)[:, ::-1]
    grey = np.full((len(others), 3), GREY, np.uint8)
    return Cloud(
        frame=report.drive.frames[number].points,
        positions_cm=centimetres(points[kept]),
        colors={name: packed(np.vstack([colors, grey]).astype(np.uint8)) for name, colors in by.items()},
        legends=legends,
        camera_center=camera_center(T).tolist(),
        optical_axis=T[2, :3].tolist(),
        corners=frustum(observations.camera, T),
    )


def thinned(mask: npt.NDArray[np.bool_], count: int) -> npt.NDArray[np.intp]:
    """Indices of at most `count` evenly spaced points among those that a mask (N,) selects."""
    return np.array(evenly_spaced(np.flatnonzero(mask).tolist(), count), np.intp)


def at_pixels(image: npt.NDArray[np.uint8], pixels: npt.NDArray[np.intp]) -> npt.NDArray[np.uint8]:
    """Values of an image at the pixels (M, 2)."""
    u, v = pixels.T
    found: npt.NDArray[np.uint8] = image[
        v.clip(0, image.shape[0] - 1),
        u.clip(0, image.shape[1] - 1),
    ]
    return found


def _label_colors(classes: npt.NDArray[np.uint8], palette: Colors) -> npt.NDArray[np.uint8]:
    """Red, green and blue of each point's class; grey for a point without a class."""
    table = np.full((NO_CLASS + 1, 3), GREY, np.uint8)
    table[: len(palette)] = palette[:, ::-1]
    return table[classes]


def _legend(classes: npt.NDArray[np.uint8], names: Sequence[str], palette: Colors) -> dict[str, str]:
    present = [index for index in np.unique(classes).tolist() if index != NO_CLASS]
    return {names[index]: hex_color(tuple(palette[index].tolist())) for index in present}


def frustum(camera: Camera, T_camera_lidar: Pose) -> list[list[float]]:
    """Ends of the edges of a camera's view, in the LiDAR frame; none if the lens does not reach the corners."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    pixels = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    rays = core_camera(camera).unproject(pixels)
    if not np.isfinite(rays).all():
        return []
    T_lidar_camera = inverse(T_camera_lidar)
    corners: list[list[float]] = (
        FRUSTUM_M * rays @ T_lidar_camera[:3, :3].T + T_lidar_camera[:3, 3]
    ).tolist()
    return corners


def centimetres(points: npt.NDArray[np.float32]) -> str:
    """Encode points (N, 3), metres, as int16 centimetres."""
    return packed(np.clip(np.rint(100.0 * points), -32_767, 32_767).astype("<i2"))
