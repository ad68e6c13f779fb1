"""Drawings of LiDAR points and labels on camera images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, counted
from semcal_cli.files.image_files import write_image
from semcal_cli.files.output_files import make_folder
from semcal_cli.geometry.arrays import Colors, Image, Pose
from semcal_cli.observations.cues.edges import gradients
from semcal_cli.observations.cues.segments import SegmentationConfig
from semcal_cli.observations.frame_naming import frame_names
from semcal_cli.observations.masks import seen_pixels
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.observations.reading import read_frame_image, read_needed_image
from semcal_cli.report.colors import (
    NO_PAIR,
    ColorMeaning,
    Legend,
    class_colors,
    coloring_of,
    depth_levels,
    is_edge,
    level_colors,
    paint,
    palette_of,
    palettes,
    segment_colors,
)
from semcal_cli.report.dots import PLAIN, DotStyle, draw_dots
from semcal_cli.report.named_frames import frame_paths
from semcal_cli.report.overlay_video import write_video
from semcal_cli.report.points import (
    ProjectedPoints,
    View,
    agreement_kinds,
    associated_classes,
    frame_points,
    points_in_image,
)

WIDE = 2.0
"""Ratio of width to height from which images are stacked vertically."""

BACKGROUND_STRENGTH = 0.6
BACKGROUND_GRAY = 0.6
"""Fraction of the colour that is removed from an image, so that only the dots have strong colours."""
LABEL_STRENGTH = 0.5
LABEL_SHARE = 0.55
"""Weight of the label colours in an image with labels."""
TEXT_COLOR = (235, 235, 235)
MARGIN_COLOR = (32, 32, 32)
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_HEIGHT = 22
"""Height of the font's capitals at scale 1, pixels."""

GREY_STRENGTH = 0.25
"""Strength of the image below its edges, for orientation."""
BLUR_PX = 1.0
"""Blur of the image, pixels: the eye prefers sharper edges than sparse rays need."""
EDGE_STRENGTH = 170.0
"""Grey value that the strongest edges add: bright, but dots on them remain visible."""
STRONGEST = 0.99
"""Quantile of the gradients of an image from which an edge is drawn at full strength."""


def image_of(drive: Drive, observations: Observations, frame: int) -> tuple[Image, bool]:
    """Read the image of a frame, and whether it is a photograph; without one, colour the label image instead.

    Raises:
        InputError: the frame has neither, or its image is wrong.
    """
    image = read_frame_image(drive, drive.frames[frame])
    if image is not None:
        return image, True
    if not observations.image_class_names:
        key = drive.frames[frame].key("image")
        raise InputError(f"{drive.path}: {key}: found nothing, expected an image, or labels to show instead")
    return paint(observations.images[frame].classes, palettes(observations)[1]), False


def edge_image(drive: Drive, observations: Observations, number: int) -> Image:
    """Draw the edges of a frame's image that scan lines cross in white on the darkened grey image, (H, W, 3).

    Raises:
        InputError: the frame has no image, or it is wrong.
    """
    frame = drive.frames[number]
    image = read_needed_image(drive, frame)
    (mask,) = seen_pixels(drive, [frame])
    strength, is_inside = gradients(
        drive.camera, image, mask, BLUR_PX, along=observations.images[number].along
    )
    full = max(float(np.quantile(strength[is_inside], STRONGEST)), float(np.finfo(np.float32).tiny))
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    grey_with_edges = GREY_STRENGTH * grey + EDGE_STRENGTH * np.minimum(strength / full, 1.0)
    return np.asarray(np.repeat(grey_with_edges.astype(np.uint8)[..., None], 3, axis=2))


@dataclass(frozen=True)
class Overlays:
    """Drawings of the frames of a drive with their points at each captioned pose, with a legend.

    A frame without an image shows its label image instead. Poses are placed side by side; with wide
    images, they are stacked.
    """

    drive: Drive
    """Drive whose images are drawn."""
    observations: Observations
    """Observations of the same drive; without labels if the colours show depth or segments."""
    poses: Mapping[str, Pose]
    """T_camera_lidar (4, 4) by caption; at least one."""
    by: ColorMeaning = "class"
    """Meaning of the colours: the point's class; its distance from the camera; whether its class and the pixel's occur
    together more often than by chance at the last pose; its segment of the sweep; or the step in range or intensity
    next to it, on the edges of the image, which needs observations of the cue edges."""
    others: Mapping[str, Observations] = field(default_factory=dict)
    """The same frames for poses of another camera or clock, by caption: see `applied.seen_as`."""
    style: DotStyle = PLAIN
    draws_labels: bool = False
    """Whether the classes of pixels are drawn on the images, too."""

    @property
    def views(self) -> dict[str, View]:
        """Each pose with what it belongs to, by caption."""
        return {name: View(self.others.get(name, self.observations), T) for name, T in self.poses.items()}

    def write_all(self, folder: Path) -> Iterator[Path]:
        """Write the PNG of every frame into a folder, which is created, and yield each path once it is written.

        Raises:
            InputError: the folder cannot be made, or a frame cannot be drawn (see `write`).
        """
        make_folder(folder)
        for frame, path in enumerate(frame_paths(folder, self.drive)):
            self.write(frame, path)
            yield path

    def styled(
        self, radius_px: int | None, opacity: float, *, has_outline: bool, draws_labels: bool
    ) -> Overlays:
        """Choose how points are drawn (see `DotStyle`), and whether the classes of pixels are.

        Raises:
            InputError: pixels have no classes to draw.
        """
        if draws_labels and (
            coloring_of(self.observations) == "edge" or not self.observations.image_class_names
        ):
            raise InputError(f"{self.drive.path}: found no image labels, which --labels draws")
        return replace(self, style=DotStyle(radius_px, opacity, has_outline), draws_labels=draws_labels)

    def write_video(self, path: Path) -> None:
        """Write all frames as a video, .mp4.

        Raises:
            InputError: a frame cannot be drawn, or the file cannot be written.
        """
        write_video(map(self.image, range(self.observations.num_frames)), path)

    def write(self, frame: int, path: Path) -> None:
        """Write the PNG of a frame, numbered from 0.

        Raises:
            InputError: there is no such frame, its image is wrong, or the file cannot be written.
        """
        write_image(self.image(frame), path)

    def image(self, frame: int) -> Image:
        """Draw a frame, numbered from 0, with captions and the legend.

        Raises:
            InputError: there is no such frame, or its image is wrong.
        """
        camera = self.observations.camera
        images, legend = self.draw(frame)
        images = {self.strip(frame, caption): image for caption, image in images.items()}
        return with_legend(images, legend, stacked=camera.width >= WIDE * camera.height)

    @cached_property
    def frame_names(self) -> list[str]:
        """Names of all frames."""
        return frame_names([frame.points for frame in self.drive.frames])

    def strip(self, frame: int, caption: str) -> str:
        """Caption a frame: its name, the share of its points that agree at a pose, and the name of the pose."""
        words = [self.frame_names[frame]]
        observations = self.observations
        is_shown = not observations.is_multimodal  # with many maxima, the share may rise at a wrong pose
        if is_shown and observations.point_class_names and observations.image_class_names:
            (points,) = frame_points([self.views[caption]], frame, self.is_associated).poses
            words += [] if points.agreement is None else [f"{100.0 * points.agreement:.1f} % agree"]
        return "   ".join([*words, caption])

    def draw(self, frame: int) -> tuple[dict[str, Image], Legend]:
        """Draw the points of a frame, numbered from 0, at each pose: images by caption, and the legend of the colours.

        Raises:
            InputError: there is no such frame, or its image is wrong.
        """
        observations = self.observations
        if not 0 <= frame < observations.num_frames:
            raise InputError(
                f"{self.drive.path}: found {counted(observations.num_frames, 'frame')}, expected one numbered {frame}"
            )
        background = self._background(frame)
        images: dict[str, Image] = {}
        legend: Legend = {}
        for caption, view in self.views.items():
            pixels, colors, pose_legend = self._colored(frame, view.project_frame(frame))
            images[caption] = draw_dots(background, pixels, colors, self.style)
            legend |= pose_legend
        return images, legend

    def _background(self, frame: int) -> Image:
        """Return the image of a frame, dimmed, or its edges; without an image, its label image at half strength."""
        if self.by == "edge":
            return edge_image(self.drive, self.observations, frame)
        image, is_photograph = image_of(self.drive, self.observations, frame)
        if not is_photograph:
            return (LABEL_STRENGTH * image).astype(np.uint8)
        if self.draws_labels:
            labels = paint(self.observations.images[frame].classes, palettes(self.observations)[1])
            return ((1.0 - LABEL_SHARE) * _dim(image) + LABEL_SHARE * labels).astype(np.uint8)
        return _dim(image)

    def _colored(self, frame: int, projected: ProjectedPoints) -> tuple[npt.NDArray[np.intp], Colors, Legend]:
        """Return pixels (M, 2) and colours (M, 3) of the dots in the order in which they are drawn, and the legend."""
        indices = np.flatnonzero(~projected.is_hidden)
        if self.by == "segment":
            colors, legend = segment_colors(self._segmented[frame])
            return projected.pixels[indices], colors[projected.indices[indices]], legend
        palette = palette_of(self.observations, self.by)
        if self.by == "depth":
            return (
                projected.pixels[indices],
                palette.colors[depth_levels(projected.ranges_m)[indices]],
                palette.legend(),
            )
        if self.by == "agreement":
            kinds = agreement_kinds(self.observations, frame, projected, self.is_associated)
            is_judged = kinds != NO_PAIR
            return projected.pixels[is_judged], palette.colors[kinds[is_judged]], palette.legend()
        classes = self.observations.clouds[frame].classes[projected.indices]
        indices = indices[classes[indices] != NO_CLASS]
        if self.by == "edge":
            # Steps in intensity come first, then those in range; the strongest of each are drawn last.
            indices = indices[is_edge(classes[indices])]
            indices = indices[np.argsort(classes[indices], kind="stable")]
        return projected.pixels[indices], palette.colors[classes[indices]], palette.legend(classes[indices])

    @cached_property
    def _segmented(self) -> list[core.SegmentedSweep]:
        rays = [self.observations.rays(cloud.points) for cloud in self.observations.clouds]
        return core.segment_sweeps(rays, SegmentationConfig())

    @cached_property
    def is_associated(self) -> npt.NDArray[np.bool_]:
        """See `associated_classes`, at the last pose."""
        return associated_classes(list(self.views.values())[-1].agreement())


def draw_depths(image: Image, points: npt.NDArray[np.float32], T_camera_lidar: Pose, camera: Camera) -> Image:
    """Draw points on an image, coloured by their distance from the camera; hidden ones are left out.

    Args:
        image: (H, W, 3) blue, green, red.
        points: (N, 3) metres, LiDAR frame.
        T_camera_lidar: (4, 4), metres.
        camera: Camera of the image.
    """
    projected = points_in_image(points, T_camera_lidar, camera)
    is_visible, colors = ~projected.is_hidden, level_colors(np.arange(256, dtype=np.uint8))
    return draw_dots(
        _dim(image), projected.pixels[is_visible], colors[depth_levels(projected.ranges_m[is_visible])]
    )


def _dim(image: Image) -> Image:
    grey_mixed = BACKGROUND_GRAY * image.mean(axis=2, keepdims=True) + (1.0 - BACKGROUND_GRAY) * image
    dimmed: Image = (BACKGROUND_STRENGTH * grey_mixed).astype(np.uint8)
    return dimmed


def draw_labels(
    image: Image,
    ids: npt.NDArray[np.uint16],
    classes: Mapping[str, Sequence[int]],
    ignored: Sequence[int],
) -> Image:
    """Draw an image next to a copy coloured by its labels, with a legend of the classes in it.

    Args:
        image: (H, W, 3) blue, green, red.
        ids: (H, W) ids of the pixels.
        classes: Ids of each name; empty without names.
        ignored: Ids without information, which get no colour.

    Returns:
        (H', W', 3) blue, green, red.
    """
    ids_shown, counts = np.unique(ids, return_counts=True)
    num_pixels = dict(zip(ids_shown.tolist(), counts.tolist(), strict=True))
    names = {value: name for name, values in classes.items() for value in values}
    visible_ids = [value for value in num_pixels if value not in ignored and (value in names or not names)]
    # All classes get colours, so that these do not depend on what an image shows.
    all_names = list(classes) or [str(value) for value in visible_ids]
    colors = dict(zip(all_names, class_colors(all_names), strict=True))
    colored = image.copy()
    for value in visible_ids:
        mask = ids == value
        mixed = (1.0 - LABEL_SHARE) * image[mask] + LABEL_SHARE * colors[names.get(value, str(value))]
        colored[mask] = mixed.round().astype(np.uint8)
    shown_names = [
        names.get(value, str(value)) for value in sorted(visible_ids, key=lambda value: -num_pixels[value])
    ]
    is_wide = image.shape[1] > WIDE * image.shape[0]
    legend = {name: tuple(colors[name].tolist()) for name in shown_names}
    return with_legend({"image": image, "labels": colored}, legend, stacked=is_wide)


def with_legend(images: Mapping[str, Image], legend: Legend, *, stacked: bool = False) -> Image:
    """Put captioned images of one size side by side, or stack them, above the legend of their colours."""
    image = before_after(images, stacked=stacked)
    return np.vstack([image, draw_legend(legend, image.shape[1])])


def before_after(images: Mapping[str, Image], *, stacked: bool = False) -> Image:
    """Put images of one size side by side, or stack them, in order, each with its caption."""
    widths = [image.shape[1] for image in images.values()]
    width = max(widths) if stacked else sum(widths)
    captioned = [_add_caption(image, caption, width) for caption, image in images.items()]
    return np.vstack(captioned) if stacked else np.hstack(captioned)


def _add_caption(image: Image, caption: str, shown_width: int) -> Image:
    """Put a line of text above an image, sized for the total width."""
    scale, line = _text_size(shown_width)
    strip = _blank_strip(line, image.shape[1])
    _write(strip, caption, (line // 2, 0), scale, line)
    return np.vstack([strip, image])


def draw_legend(legend: Legend, width: int) -> Image:
    """Draw a strip, (h, width, 3), of swatches and names."""
    scale, line = _text_size(width)
    spots: list[tuple[int, int]] = []
    x, y = line // 2, 0
    for name in legend:
        step = 2 * line + cv2.getTextSize(name, FONT, scale, 1)[0][0]
        if x + step > width and x > line // 2:
            x, y = line // 2, y + line
        spots.append((x, y))
        x += step
    strip = _blank_strip(y + line, width)
    for (name, color), (x, y) in zip(legend.items(), spots, strict=True):
        cv2.circle(strip, (x + line // 3, y + line // 2), line // 4, color, cv2.FILLED, cv2.LINE_AA)
        _write(strip, name, (x + line, y), scale, line)
    return strip


def _text_size(width: int) -> tuple[float, int]:
    """Return the scale of the font and the height of a line, pixels, for the width of an image."""
    line = max(16, width // 40)
    return 0.45 * line / FONT_HEIGHT, line


def _blank_strip(height: int, width: int) -> Image:
    return np.full((height, width, 3), MARGIN_COLOR, dtype=np.uint8)


def _write(strip: Image, text: str, corner: tuple[int, int], scale: float, line: int) -> None:
    """Write text into a line whose upper left corner is `corner`."""
    x, y = corner
    thickness = max(1, round(line / 24))
    cv2.putText(strip, text, (x, y + round(0.7 * line)), FONT, scale, TEXT_COLOR, thickness, cv2.LINE_AA)
