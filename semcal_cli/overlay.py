"""Pictures of LiDAR points on camera images, coloured by class: what a calibration looks like."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.camera import core_camera
from semcal_cli.classes import NO_CLASS
from semcal_cli.drive import Camera, Drive
from semcal_cli.errors import InputError
from semcal_cli.observations import Observations
from semcal_cli.pictures import read_picture, write_picture
from semcal_cli.poses import Pose

Picture: TypeAlias = npt.NDArray[np.uint8]
"""(H, W, 3) blue, green, red."""
Colors: TypeAlias = npt.NDArray[np.uint8]
"""(C, 3) blue, green, red of each class."""

# Red, green, blue. CARLA's palette, with those colours lightened that are too dark for dots on a picture.
CARLA_COLORS = {
    "road": (170, 95, 170),
    "sidewalk": (244, 35, 232),
    "building": (200, 145, 95),
    "wall": (135, 135, 205),
    "fence": (235, 190, 190),
    "pole": (210, 210, 210),
    "traffic_light": (250, 170, 30),
    "traffic_sign": (220, 220, 0),
    "vegetation": (125, 170, 40),
    "terrain": (152, 251, 152),
    "sky": (70, 130, 180),
    "pedestrian": (220, 20, 60),
    "rider": (255, 80, 0),
    "car": (60, 120, 255),
    "truck": (0, 200, 255),
    "bus": (0, 160, 170),
    "train": (0, 130, 160),
    "motorcycle": (130, 80, 255),
    "bicycle": (210, 70, 120),
    "static": (110, 190, 160),
    "dynamic": (170, 120, 50),
    "other": (85, 140, 125),
    "water": (65, 90, 215),
    "road_line": (157, 234, 50),
    "ground": (145, 0, 145),
    "bridge": (150, 100, 100),
    "rail_track": (230, 150, 140),
    "guard_rail": (180, 165, 180),
}
# Red, green, blue. Okabe and Ito's colours without black, then some of Tol's: told apart by the colour-blind.
QUALITATIVE_COLORS = (
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (0, 114, 178),
    (213, 94, 0),
    (204, 121, 167),
    (221, 204, 119),
    (170, 68, 153),
    (153, 153, 51),
    (204, 102, 119),
    (120, 100, 230),
    (160, 50, 100),
    (220, 220, 220),
    (150, 100, 60),
)

BACKGROUND_STRENGTH = 0.6
BACKGROUND_GRAY = 0.6
"""How much of a picture's colour is taken out, so that the dots' colours are the only ones."""
LABEL_STRENGTH = 0.5
COLUMNS_PER_DOT_RADIUS = 640
TEXT_COLOR = (235, 235, 235)
MARGIN_COLOR = (32, 32, 32)
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_HEIGHT = 22
"""Pixels of the font's capitals at scale 1."""


def class_colors(names: Sequence[str]) -> Colors:
    """Choose the colour of each class: CARLA's for its names, else the next of a fixed list."""
    unknown = [name for name in names if name not in CARLA_COLORS]
    colors = {name: QUALITATIVE_COLORS[i % len(QUALITATIVE_COLORS)] for i, name in enumerate(unknown)}
    rgb = [(CARLA_COLORS | colors)[name] for name in names]
    return np.array(rgb, dtype=np.uint8).reshape(-1, 3)[:, ::-1]


def visible_points(
    points: npt.NDArray[np.float32], classes: npt.NDArray[np.uint8], T_camera_lidar: Pose, camera: Camera
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.uint8]]:
    """Find the labelled points that the camera sees.

    Args:
        points: (N, 3), metres, LiDAR frame.
        classes: (N,), `NO_CLASS` for those without a label.
        T_camera_lidar: (4, 4).
        camera: Where they land.

    Returns:
        The nearest pixels (M, 2), (u, v), and the classes (M,), farthest first.
    """
    pixels, ranges, hidden = _core.land(core_camera(camera), points, T_camera_lidar)
    seen = np.flatnonzero(np.isfinite(ranges) & ~hidden & (classes != NO_CLASS))
    seen = seen[np.argsort(-ranges[seen], kind="stable")]
    return np.rint(pixels[seen]).astype(np.intp), classes[seen]


def draw_overlay(
    image_bgr: Picture,
    points: npt.NDArray[np.float32],
    classes: npt.NDArray[np.uint8],
    T_camera_lidar: Pose,
    camera: Camera,
    palette: Colors,
) -> Picture:
    """Draw points on a dimmed picture as dots in the colours of their classes; hidden points are left out.

    Args:
        image_bgr: (H, W, 3), of the camera's size.
        points: (N, 3), metres, LiDAR frame.
        classes: (N,), rows of `palette`, or `NO_CLASS`: not drawn.
        T_camera_lidar: (4, 4).
        camera: The camera that took the picture.
        palette: (C, 3) blue, green, red.
    """
    return _draw_points(_dim(image_bgr), points, classes, T_camera_lidar, camera, palette)


def draw_legend(names: Sequence[str], palette: Colors, width: int) -> Picture:
    """Draw a strip, (h, width, 3), of swatches and names."""
    scale, line = _text_size(width)
    spots: list[tuple[int, int]] = []
    x, y = line // 2, 0
    for name in names:
        step = 2 * line + cv2.getTextSize(name, FONT, scale, 1)[0][0]
        if x + step > width and x > line // 2:
            x, y = line // 2, y + line
        spots.append((x, y))
        x += step
    strip = _filled(y + line, width)
    for name, color, (x, y) in zip(names, palette.tolist(), spots, strict=True):
        cv2.circle(strip, (x + line // 3, y + line // 2), line // 4, color, cv2.FILLED, cv2.LINE_AA)
        _write(strip, name, (x + line, y), scale, line)
    return strip


def add_caption(picture: Picture, caption: str, shown_width: int) -> Picture:
    """Put a line of text above a picture, sized for the width of all that is shown."""
    scale, line = _text_size(shown_width)
    strip = _filled(line, picture.shape[1])
    _write(strip, caption, (line // 2, 0), scale, line)
    return np.vstack([strip, picture])


def before_after(pictures: Mapping[str, Picture], *, stacked: bool = False) -> Picture:
    """Put pictures of one size beside (or above) each other, in order, each under its caption."""
    widths = [picture.shape[1] for picture in pictures.values()]
    width = max(widths) if stacked else sum(widths)
    captioned = [add_caption(picture, caption, width) for caption, picture in pictures.items()]
    return np.vstack(captioned) if stacked else np.hstack(captioned)


def write_overlay(
    drive: Drive,
    observations: Observations,
    poses: Mapping[str, Pose],
    frame: int,
    path: Path,
    *,
    stacked: bool = False,
) -> None:
    """Write a PNG of one frame's points on its picture, at each pose under its caption, and a legend.

    A frame without a picture shows its label image instead.

    Args:
        drive: Where the picture is looked for.
        observations: Of the same drive.
        poses: T_camera_lidar (4, 4) by caption.
        frame: Its number, from 0.
        path: The .png to write.
        stacked: Put the poses above each other, instead of beside.

    Raises:
        InputError: there is no such frame, its picture is wrong, or the file cannot be written.
    """
    if not 0 <= frame < observations.num_frames:
        raise InputError(f"{drive.path}: found {observations.num_frames} frames, needed one numbered {frame}")
    names, camera = observations.point_class_names, observations.camera
    points, classes = observations.points[frame], observations.point_classes[frame]
    palette, background = class_colors(names), _background(drive, observations, frame)
    pictures = {
        caption: _draw_points(background, points, classes, T, camera, palette) for caption, T in poses.items()
    }
    drawn = [visible_points(points, classes, T, camera)[1] for T in poses.values()]
    present = np.unique(np.concatenate(drawn))
    picture = before_after(pictures, stacked=stacked)
    legend = draw_legend([names[i] for i in present], palette[present], picture.shape[1])
    write_picture(np.vstack([picture, legend]), path)


def _draw_points(
    background: Picture,
    points: npt.NDArray[np.float32],
    classes: npt.NDArray[np.uint8],
    T_camera_lidar: Pose,
    camera: Camera,
    palette: Colors,
) -> Picture:
    canvas = background.copy()
    radius = max(1, round(camera.width / COLUMNS_PER_DOT_RADIUS))
    pixels, classes = visible_points(points, classes, T_camera_lidar, camera)
    for pixel, color in zip(pixels.tolist(), palette[classes].tolist(), strict=True):
        cv2.circle(canvas, pixel, radius, color, thickness=cv2.FILLED)
    return canvas


def _background(drive: Drive, observations: Observations, frame: int) -> Picture:
    """The picture of a frame, dimmed; without one, its label image at half strength."""
    name = drive.frames[frame].image
    if name is None:
        colors = class_colors(observations.image_class_names)
        table = np.zeros((256, 3), dtype=np.uint8)
        table[: len(colors)] = (LABEL_STRENGTH * colors).astype(np.uint8)
        return table[observations.image_classes[frame]]
    picture = read_picture(drive.resolve(name))
    found, needed = picture.shape[1::-1], (drive.camera.width, drive.camera.height)
    if found != needed:
        raise InputError(
            f"{drive.resolve(name)}: found {found[0]} x {found[1]} pixels, needed {needed[0]} x {needed[1]}"
        )
    return _dim(picture)


def _dim(picture: Picture) -> Picture:
    """Darken a picture and take colour out of it."""
    gray = picture.mean(axis=2, keepdims=True)
    mixed = BACKGROUND_GRAY * gray + (1.0 - BACKGROUND_GRAY) * picture
    dimmed: Picture = (BACKGROUND_STRENGTH * mixed).astype(np.uint8)
    return dimmed


def _text_size(width: int) -> tuple[float, int]:
    """Scale of the font and height of a line for a picture of a width."""
    line = max(16, width // 40)
    return 0.45 * line / FONT_HEIGHT, line


def _filled(height: int, width: int) -> Picture:
    return np.full((height, width, 3), MARGIN_COLOR, dtype=np.uint8)


def _write(strip: Picture, text: str, corner: tuple[int, int], scale: float, line: int) -> None:
    """Write text into the line whose upper left corner is given."""
    x, y = corner
    thickness = max(1, round(line / 24))
    cv2.putText(strip, text, (x, y + round(0.7 * line)), FONT, scale, TEXT_COLOR, thickness, cv2.LINE_AA)
