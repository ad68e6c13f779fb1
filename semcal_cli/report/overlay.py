"""Drawings of LiDAR points on camera images, coloured by class, depth, agreement, segment or edge."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.pairing import frame_names
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.cues.segments import SegmentationConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.motion import points_at, unrolled
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.drive.reading import read_frame_image
from semcal_cli.errors import InputError
from semcal_cli.files.images import write_image
from semcal_cli.files.writing import make_folder
from semcal_cli.geometry.poses import Pose
from semcal_cli.report.colors import Colors, Legend, palettes, segment_colors
from semcal_cli.report.edges import edge_picture, edges_by_strength
from semcal_cli.report.palette import AGREES, DISAGREES, HIDDEN, NO_PAIR, Coloring, depth_levels, palette_of

Image: TypeAlias = npt.NDArray[np.uint8]
"""(H, W, 3) blue, green, red."""
WHOLE_LEGEND = ("depth", "agreement")
"""Colours whose legend names all of them, whether they occur or not."""
WIDE = 2.0
"""Ratio of width to height from which images are put above each other."""

BACKGROUND_STRENGTH = 0.6
BACKGROUND_GRAY = 0.6
"""Share of an image's colour that is taken out, so that only the dots have strong colours."""
LABEL_STRENGTH = 0.5
COLUMNS_PER_DOT_RADIUS = 640
TEXT_COLOR = (235, 235, 235)
MARGIN_COLOR = (32, 32, 32)
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_HEIGHT = 22
"""Pixels of the font's capitals at scale 1."""


def overlay_paths(folder: Path, count: int) -> list[Path]:
    """Name the files of the drawn frames in a folder."""
    return [folder / f"{frame:06d}.png" for frame in range(count)]


class Seen(NamedTuple):
    """Points that project into an image, farthest first."""

    indices: npt.NDArray[np.intp]
    positions: npt.NDArray[np.float64]
    """(M, 2), (u, v)."""
    ranges_m: npt.NDArray[np.float64]
    """(M,) distances from the camera."""
    is_hidden: npt.NDArray[np.bool_]

    @property
    def pixels(self) -> npt.NDArray[np.intp]:
        """(M, 2), (u, v), nearest pixels."""
        return np.rint(self.positions).astype(np.intp)


def points_in_image(points: npt.NDArray[np.float32], T_camera_lidar: Pose, camera: Camera) -> Seen:
    """Find the points (N, 3), metres, LiDAR frame, that project into the image, and mark the hidden ones among them."""
    projected = _core.project_points(core_camera(camera), points, T_camera_lidar)
    ranges = projected.ranges
    seen = np.flatnonzero(np.isfinite(ranges))
    seen = seen[np.argsort(-ranges[seen], kind="stable")]
    return Seen(seen, projected.pixels[seen], ranges[seen], projected.is_hidden[seen])


class View(NamedTuple):
    """A pose, and the observations as the camera and the clock see them that it belongs to."""

    observations: Observations
    T_camera_lidar: Pose

    def seen_in_frame(self, frame: int) -> Seen:
        """Find the points of a frame that its picture shows, each on the line that is exposed then."""
        points = points_at(self.observations, frame, self.T_camera_lidar)
        return points_in_image(points, self.T_camera_lidar, self.observations.camera)


def draw_legend(names: Sequence[str], palette: Colors, width: int) -> Image:
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


def add_caption(image: Image, caption: str, shown_width: int) -> Image:
    """Put a line of text above an image, sized for the width of all that is shown."""
    scale, line = _text_size(shown_width)
    strip = _filled(line, image.shape[1])
    _write(strip, caption, (line // 2, 0), scale, line)
    return np.vstack([strip, image])


def before_after(images: Mapping[str, Image], *, stacked: bool = False) -> Image:
    """Put images of one size beside (or above) each other, in order, each under its caption."""
    widths = [image.shape[1] for image in images.values()]
    width = max(widths) if stacked else sum(widths)
    captioned = [add_caption(image, caption, width) for caption, image in images.items()]
    return np.vstack(captioned) if stacked else np.hstack(captioned)


@dataclass(frozen=True)
class Overlays:
    """Drawings of the frames of a drive with their points, at each pose under its caption, with a legend.

    A frame without an image shows its label image instead. The poses stand beside each other; those of wide images
    stand above each other.
    """

    drive: Drive
    """Drive whose images are drawn."""
    observations: Observations
    """Observations of the same drive; without labels if the colours show depth or segments."""
    poses: Mapping[str, Pose]
    """T_camera_lidar (4, 4) by caption; at least one."""
    by: Coloring = "class"
    """Meaning of the colours: the point's class; its distance from the camera; whether its class and the pixel's are
    found together more often than by chance at the last pose; the segment of the sweep that it is part of; or how far
    range or intensity steps beside it, on the edges of the picture, by observations of the cue edges."""
    others: Mapping[str, Observations] = field(default_factory=dict)
    """The same frames by the captions of poses that belong to another camera or clock: see `applied.seen_as`."""

    @property
    def views(self) -> dict[str, View]:
        """Each pose with what it belongs to, by caption."""
        return {name: View(self.others.get(name, self.observations), T) for name, T in self.poses.items()}

    def write_all(self, folder: Path) -> Iterator[Path]:
        """Write the PNG of every frame into a folder, which is made, and give each path when it is written.

        Raises:
            InputError: the folder cannot be made, or a frame cannot be drawn (see `write`).
        """
        make_folder(folder)
        for frame, path in enumerate(overlay_paths(folder, self.observations.num_frames)):
            self.write(frame, path)
            yield path

    def write(self, frame: int, path: Path) -> None:
        """Write the PNG of a frame, numbered from 0.

        Raises:
            InputError: there is no such frame, its image is wrong, or the file cannot be written.
        """
        camera = self.observations.camera
        images, legend = self.draw(frame)
        images = {self.strip(frame, caption): image for caption, image in images.items()}
        image = before_after(images, stacked=camera.width >= WIDE * camera.height)
        swatches = np.array(list(legend.values()), np.uint8).reshape(-1, 3)
        write_image(np.vstack([image, draw_legend(list(legend), swatches, image.shape[1])]), path)

    @cached_property
    def frame_names(self) -> list[str]:
        """Names of all frames."""
        return frame_names([frame.points for frame in self.drive.frames])

    def strip(self, frame: int, caption: str) -> str:
        """Name a frame, how many of its points agree at the pose of a caption, and the pose."""
        observations, words = self.observations, [self.frame_names[frame]]
        if observations.point_class_names and observations.image_class_names:
            seen = self.views[caption].seen_in_frame(frame)
            kinds = kinds_of(observations, frame, seen, self.together)
            agreeing, judged = (kinds == AGREES).sum(), (kinds <= DISAGREES).sum()
            words += [f"{100.0 * agreeing / judged:.1f} % agree"] if judged else []
        return "   ".join([*words, caption])

    def draw(self, frame: int) -> tuple[dict[str, Image], Legend]:
        """Draw the points of a frame, numbered from 0, at each pose: images by caption, and the legend of the colours.

        Raises:
            InputError: there is no such frame, or its image is wrong.
        """
        observations = self.observations
        if not 0 <= frame < observations.num_frames:
            raise InputError(
                f"{self.drive.path}: found {observations.num_frames} frames, needed one numbered {frame}"
            )
        background = self._background(frame)
        images: dict[str, Image] = {}
        legend: Legend = {}
        for caption, view in self.views.items():
            seen = view.seen_in_frame(frame)
            pixels, colors, named = self._colored(frame, seen)
            images[caption] = _draw_dots(background, pixels, colors)
            legend |= named
        return images, legend

    def _colored(self, frame: int, seen: Seen) -> tuple[npt.NDArray[np.intp], Colors, Legend]:
        """Pixels (M, 2) and colours (M, 3) of the dots, with their legend."""
        if self.by == "segment":
            shown = ~seen.is_hidden
            colors, legend = segment_colors(self._segmented[frame])
            return seen.pixels[shown], colors[seen.indices[shown]], legend
        numbers, drawn = self._numbers(frame, seen)
        palette = palette_of(self.observations, self.by)
        pixels, numbers = seen.pixels[drawn], numbers[drawn]
        return pixels, palette.colors[numbers], palette.legend(None if self.by in WHOLE_LEGEND else numbers)

    def _numbers(self, frame: int, seen: Seen) -> tuple[npt.NDArray[np.integer], npt.NDArray[np.intp]]:
        """Number (M,) of each point in the palette, and the points (K,) that are drawn, in their order."""
        if self.by == "depth":
            return depth_levels(seen.ranges_m), np.flatnonzero(~seen.is_hidden)
        if self.by == "agreement":
            kinds = kinds_of(self.observations, frame, seen, self.together)
            return kinds, np.flatnonzero(kinds != NO_PAIR)
        classes = self.observations.clouds[frame].classes[seen.indices]
        drawn = np.flatnonzero(~seen.is_hidden & (classes != NO_CLASS))
        return classes, drawn[edges_by_strength(classes[drawn])] if self.by == "edge" else drawn

    def _background(self, frame: int) -> Image:
        """The image of a frame, dimmed, or its edges; without an image, its label image at half strength."""
        if self.by == "edge":
            return edge_picture(self.drive, self.drive.frames[frame])
        image, is_photograph = picture_of(self.drive, self.observations, frame)
        return _dim(image) if is_photograph else (LABEL_STRENGTH * image).astype(np.uint8)

    @cached_property
    def _segmented(self) -> list[_core.SegmentedSweep]:
        clouds = [cloud.points for cloud in self.observations.clouds]
        return _core.segment_sweeps(clouds, SegmentationConfig())

    @cached_property
    def together(self) -> npt.NDArray[np.bool_]:
        """Classes of points and of pixels that go together at the last pose."""
        return goes_together(*list(self.views.values())[-1])


def kinds_of(
    observations: Observations, frame: int, seen: Seen, together: npt.NDArray[np.bool_]
) -> npt.NDArray[np.intp]:
    """Index in `AGREEMENT_COLORS` of each point (M,); `NO_PAIR` if it or its pixel has no label."""
    point = observations.clouds[frame].classes[seen.indices]
    pixel = at_pixels(observations.images[frame].classes, seen.pixels)
    labelled = (point != NO_CLASS) & (pixel != NO_CLASS)
    kinds = np.full(len(point), NO_PAIR, np.intp)
    kinds[labelled] = np.where(seen.is_hidden[labelled], HIDDEN, ~together[point[labelled], pixel[labelled]])
    return kinds


def goes_together(observations: Observations, T_camera_lidar: Pose) -> npt.NDArray[np.bool_]:
    """Mask of the classes of points (rows) and of pixels found together more often than by chance over all frames."""
    agreement = _core.agreement(unrolled(observations, T_camera_lidar).core, T_camera_lidar)
    return over_chance(agreement.joint) > 1.0


def over_chance(joint: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Ratio of each pair's frequency to its frequency by chance, p(x, y) / (p(x) p(y)); 0 for a pair never seen."""
    by_chance = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0) / max(joint.sum(), 1.0)
    return np.asarray(joint / np.where(by_chance > 0.0, by_chance, 1.0))


def at_pixels(image: npt.NDArray[np.uint8], pixels: npt.NDArray[np.intp]) -> npt.NDArray[np.uint8]:
    """Values of an image at the pixels (M, 2), (u, v), or at the nearest ones inside."""
    u, v = pixels.T
    return np.asarray(image[v.clip(0, image.shape[0] - 1), u.clip(0, image.shape[1] - 1)])


def _draw_dots(background: Image, pixels: npt.NDArray[np.intp], colors: Colors) -> Image:
    """Draw dots in order; where they overlap, the last is seen."""
    canvas = background.copy()
    height, width = canvas.shape[:2]
    radius = max(1, round(width / COLUMNS_PER_DOT_RADIUS))
    span = np.arange(-radius, radius + 1)
    du, dv = (grid.ravel() for grid in np.meshgrid(span, span))
    is_disk = du**2 + dv**2 <= (radius + 0.5) ** 2
    u, v = pixels[:, :1] + du[is_disk], pixels[:, 1:] + dv[is_disk]
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    # Dots are assigned in the order of the points, so that the last one on a pixel stays.
    canvas[v[inside], u[inside]] = np.broadcast_to(colors[:, None], (*u.shape, 3))[inside]
    return canvas


def picture_of(drive: Drive, observations: Observations, frame: int) -> tuple[Image, bool]:
    """Read the image of a frame, and tell whether it is a photograph: without one, it is the label image in colours.

    Raises:
        InputError: the frame has neither, or its image is wrong.
    """
    image = read_frame_image(drive, drive.frames[frame])
    if image is not None:
        return image, True
    if not observations.image_class_names:
        key = drive.frames[frame].key("image")
        raise InputError(f"{drive.path}: {key}: found nothing, needed a picture, or labels to show instead")
    _, colors = palettes(observations)
    table = np.zeros((256, 3), dtype=np.uint8)
    table[: len(colors)] = colors
    return table[observations.images[frame].classes], False


def _dim(image: Image) -> Image:
    """Darken an image and take colour out of it."""
    gray = image.mean(axis=2, keepdims=True)
    mixed = BACKGROUND_GRAY * gray + (1.0 - BACKGROUND_GRAY) * image
    dimmed: Image = (BACKGROUND_STRENGTH * mixed).astype(np.uint8)
    return dimmed


def _text_size(width: int) -> tuple[float, int]:
    """Scale of the font, and height of a line, for an image of a given width."""
    line = max(16, width // 40)
    return 0.45 * line / FONT_HEIGHT, line


def _filled(height: int, width: int) -> Image:
    return np.full((height, width, 3), MARGIN_COLOR, dtype=np.uint8)


def _write(strip: Image, text: str, corner: tuple[int, int], scale: float, line: int) -> None:
    """Write text into the line whose upper left corner is given."""
    x, y = corner
    thickness = max(1, round(line / 24))
    cv2.putText(strip, text, (x, y + round(0.7 * line)), FONT, scale, TEXT_COLOR, thickness, cv2.LINE_AA)
