"""A sweep and cameras for the 3-D view: points that a camera sees are coloured, the others are grey."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.geometry.arrays import Colors, Pose
from semcal_cli.geometry.poses import camera_center, inverse
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.observations.reading import read_frame_image
from semcal_cli.report.colors import QUALITATIVE_COLORS, hex_color, paint, palettes
from semcal_cli.report.input import ReportInput
from semcal_cli.report.points import at_pixels, choose_evenly, encode_base64, points_in_image

Rgb = tuple[int, int, int]
MAX_VISIBLE, MAX_OTHERS = 16_000, 8_000
"""Largest number of points that a camera sees, and of other points, to keep."""
MAX_RANGE_M = 120.0
"""Largest range of the points that the view shows."""
GREY = 92
WHITE = 255, 255, 255
BY_CAMERA, BY_IMAGE = "camera that sees them", "images"
"""Meanings of the colours of points that several cameras see."""
FRUSTUM_M = 1.0
"""Length of the drawn edges of a camera frustum."""


@dataclass(frozen=True)
class CameraInView:
    """A camera for the script of the page, in the LiDAR frame, metres."""

    name: str
    color: Rgb
    camera_center: list[float]
    optical_axis: list[float]
    corners: list[list[float]]
    """Corners of the camera frustum; empty if the lens does not reach the corners of the image."""

    @classmethod
    def at_pose(cls, name: str, color: Rgb, camera: Camera, T_camera_lidar: Pose) -> CameraInView:
        """Place a camera at its pose (4, 4)."""
        right, bottom = camera.width - 0.5, camera.height - 0.5
        pixels = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
        rays, T_lidar_camera = core_camera(camera).unproject(pixels), inverse(T_camera_lidar)
        corners = FRUSTUM_M * rays @ T_lidar_camera[:3, :3].T + T_lidar_camera[:3, 3]
        return cls(
            name,
            color,
            camera_center(T_camera_lidar).tolist(),
            T_camera_lidar[2, :3].tolist(),
            corners.tolist() if np.isfinite(rays).all() else [],
        )


@dataclass(frozen=True)
class CloudInView:
    """Points and cameras in the LiDAR frame; arrays as base64 for the script of the page."""

    frame: str
    positions_cm: str
    """int16, little-endian, (N, 3)."""
    colors: dict[str, str]
    """uint8 red, green, blue, (N, 3), by meaning."""
    cameras: list[CameraInView]
    legends: dict[str, dict[str, str]] = field(default_factory=dict)
    """Colour of each visible class, as #rrggbb, by the meaning of the colours."""


def make_cloud(
    frame: str,
    points: npt.NDArray[np.float32],
    is_seen: npt.NDArray[np.bool_],
    colors_by_meaning: Mapping[str, tuple[npt.NDArray[np.intp], npt.NDArray[np.uint8]]],
    cameras: Sequence[CameraInView],
) -> CloudInView:
    """Keep the points of a sweep that have a colour, and some of those that no camera sees.

    Args:
        frame: Name of the sweep.
        points: (N, 3), metres, LiDAR frame.
        is_seen: (N,) whether a camera sees a point.
        colors_by_meaning: Indices (M,) of points, and their colours (M, 3), red, green, blue.
        cameras: Cameras to draw.
    """
    colored_indices = np.unique(np.concatenate([indices for indices, _ in colors_by_meaning.values()]))
    other_indices = choose_evenly(~is_seen & (np.linalg.norm(points, axis=1) < MAX_RANGE_M), MAX_OTHERS)
    kept_indices = np.concatenate([colored_indices, other_indices])
    colors = {}
    for name, (indices, rgb) in colors_by_meaning.items():
        all_colors = np.full((len(points), 3), GREY, np.uint8)
        all_colors[indices] = rgb
        colors[name] = encode_base64(all_colors[kept_indices])
    centimetres = np.clip(np.rint(100.0 * points[kept_indices]), -32_767, 32_767).astype("<i2")
    return CloudInView(frame, encode_base64(centimetres), colors, list(cameras))


@dataclass(frozen=True)
class SweepView:
    """One frame of a camera, with its points."""

    name: str
    T_camera_lidar: Pose
    drive: Drive
    """Drive with this frame only."""
    observations: Observations
    """Points of the frame, without labels."""
    is_of_sweep: bool
    """Whether the frame has the sweep that the 3-D view shows."""


def sweep_cloud(views: Sequence[SweepView]) -> CloudInView:
    """Colour the points of a sweep by the camera that sees them, and by the cameras' images.

    Args:
        views: Frames of the cameras, of which at least one has the sweep.

    Raises:
        InputError: an image is missing or wrong.
    """
    sweep_view = next(view for view in views if view.is_of_sweep)
    points = sweep_view.observations.clouds[0].points
    is_seen = np.zeros(len(points), np.bool_)
    parts: dict[str, list[tuple[npt.NDArray[np.intp], npt.NDArray[np.uint8]]]] = {BY_CAMERA: [], BY_IMAGE: []}
    # Where views overlap, points belong to the first camera: its colours are set last.
    for number, view in reversed(list(enumerate(views))):
        # Each camera sees the sweep at the moment of its own image.
        own_points = view.observations.clouds[0].points if view.is_of_sweep else points
        observations = view.observations
        projected = points_in_image(
            own_points, view.T_camera_lidar, observations.camera, observations.origin_m
        )
        is_seen[projected.indices[~projected.is_hidden]] = True
        visible = choose_evenly(~projected.is_hidden, MAX_VISIBLE // len(views))
        indices = projected.indices[visible]
        parts[BY_CAMERA].append((indices, np.full((len(indices), 3), _color(number), np.uint8)))
        image = read_frame_image(view.drive, view.drive.frames[0]) if view.is_of_sweep else None
        if image is not None:
            parts[BY_IMAGE].append((indices, at_pixels(image, projected.pixels[visible])[:, ::-1]))
    colors = {
        name: (np.concatenate([i for i, _ in pairs]), np.concatenate([rgb for _, rgb in pairs]))
        for name, pairs in parts.items()
        if pairs
    }
    cameras = [
        CameraInView.at_pose(view.name, _color(number), view.observations.camera, view.T_camera_lidar)
        for number, view in enumerate(views)
    ]
    return make_cloud(sweep_view.drive.frames[0].points, points, is_seen, colors, cameras)


def _color(number: int) -> Rgb:
    """Choose the colour of a camera by its number."""
    return QUALITATIVE_COLORS[number % len(QUALITATIVE_COLORS)]


def frame_cloud(report: ReportInput) -> CloudInView:
    """Colour a frame's points by the label of the pixel they project onto, by their own label, and by the image.

    The frame is the first one with an image, or the first one if none has an image.
    """
    observations, T, frames = report.observations, report.T_camera_lidar, report.drive.frames
    number = next((i for i, frame in enumerate(frames) if frame.image is not None), 0)
    points, classes = observations.clouds[number].points, observations.clouds[number].classes
    projected = points_in_image(points, T, observations.camera, observations.origin_m)
    is_seen = np.zeros(len(points), np.bool_)
    is_seen[projected.indices[~projected.is_hidden]] = True
    visible = choose_evenly(~projected.is_hidden, MAX_VISIBLE)
    pixels, indices = projected.pixels[visible], projected.indices[visible]
    point_colors, pixel_colors = palettes(observations)
    pixel_classes = at_pixels(observations.images[number].classes, pixels)
    labels = {
        "label of the pixel": (pixel_classes, observations.image_class_names, pixel_colors),
        "label of the point": (classes[indices], observations.point_class_names, point_colors),
    }
    colors_by_meaning = {
        name: (indices, paint(side_classes, palette, (GREY,) * 3)[:, ::-1])
        for name, (side_classes, _, palette) in labels.items()
    }
    image = read_frame_image(report.drive, frames[number])
    if image is not None:
        colors_by_meaning["image"] = indices, at_pixels(image, pixels)[:, ::-1]
    camera = CameraInView.at_pose("", WHITE, observations.camera, T)
    cloud = make_cloud(frames[number].points, points, is_seen, colors_by_meaning, [camera])
    cloud.legends.update({name: _class_legend(*side) for name, side in labels.items()})
    return cloud


def _class_legend(classes: npt.NDArray[np.uint8], names: Sequence[str], palette: Colors) -> dict[str, str]:
    return {
        names[index]: hex_color(palette[index].tolist())
        for index in np.unique(classes).tolist()
        if index != NO_CLASS
    }
