"""Colours of points and pixels by their meaning: class, edge, depth, agreement or segment."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.geometry.arrays import Colors
from semcal_cli.observations.cues.edges import NO_EDGE
from semcal_cli.observations.observations import NO_CLASS, Observations

Legend: TypeAlias = dict[str, tuple[int, ...]]
"""Blue, green and red of each named entry."""
ColorMeaning: TypeAlias = Literal["class", "depth", "agreement", "segment", "edge"]
"""Meaning of the colours of points."""

# Red, green, blue. CARLA's palette, with those colours lightened that are too dark for dots on an image.
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
# Red, green, blue of the classes of the cue edges. Larger steps are brighter; the hue separates range from intensity.
NO_EDGE_NAME = "no edge"
STEP_COLORS = {
    "intensity step 1": (0, 85, 140),
    "intensity step 2": (0, 130, 205),
    "intensity step 3": (70, 190, 255),
    "range step 1": (150, 65, 0),
    "range step 2": (205, 90, 0),
    "range step 3": (255, 120, 10),
}
GRADIENT_COLORS = {f"gradient {level}": (28 * level, 40 + 30 * level, 60 + 22 * level) for level in range(8)}
KNOWN_COLORS = {**CARLA_COLORS, NO_EDGE_NAME: (110, 110, 110), **STEP_COLORS, **GRADIENT_COLORS}
# Red, green, blue. Okabe and Ito's colours without black, then some of Tol's, which the colour-blind can distinguish.
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
GOLDEN_RATIO = 0.618034
SATURATION = 0.65
# Red, green, blue.
GROUND_COLORS = ((150, 150, 150), (185, 185, 185), (220, 220, 220))
NO_SEGMENT_COLOR = (70, 70, 70)
EDGE_LEGEND: Legend = {"edge in the image": (210, 210, 210)}
"""What is drawn in the image below the edges of sweeps."""
# Red, green, blue, of Okabe and Ito's.
AGREEMENT_COLORS = {
    "agree": (0, 158, 115),
    "disagree": (213, 94, 0),
    "hidden from the camera": (120, 120, 120),
}
AGREES, DISAGREES, HIDDEN, NO_PAIR = range(4)
"""Indices in `AGREEMENT_COLORS`, and that of points without a label on either side."""
DEPTHS_M = (2.0, 100.0)
"""Depths at the ends of the colour scale, which is logarithmic; the legend names some in between."""
DEPTH_STEPS_M = (2, 5, 10, 20, 50, 100)


def class_colors(names: Sequence[str]) -> Colors:
    """Choose the colour of each class: that of its name in CARLA, else the next of a list, then of the hues."""
    unknown = [name for name in names if name not in KNOWN_COLORS]
    colors = KNOWN_COLORS | {name: _rgb(number) for number, name in enumerate(unknown)}
    return np.array([colors[name] for name in names], np.uint8).reshape(-1, 3)[:, ::-1]


def _rgb(number: int) -> tuple[int, int, int]:
    if number < len(QUALITATIVE_COLORS):
        return QUALITATIVE_COLORS[number]
    hue = number * GOLDEN_RATIO % 1.0
    red, green, blue = colorsys.hsv_to_rgb(hue, SATURATION, 1.0 - 0.3 * (number % 2))
    return round(255 * red), round(255 * green), round(255 * blue)


def palettes(observations: Observations) -> tuple[Colors, Colors]:
    """Choose the colours of the classes of points and of pixels; classes of one name have one colour."""
    points, image = observations.point_class_names, observations.image_class_names
    names = list(dict.fromkeys([*points, *image]))
    colors = class_colors(names)
    return colors[[names.index(name) for name in points]], colors[[names.index(name) for name in image]]


def paint(
    classes: npt.NDArray[np.uint8], palette: Colors, empty: tuple[int, int, int] = (0, 0, 0)
) -> npt.NDArray[np.uint8]:
    """Colour classes (...) by a palette: (..., 3); entries without a class get the colour `empty`."""
    table = np.full((NO_CLASS + 1, 3), empty, np.uint8)
    table[: len(palette)] = palette
    return table[classes]


def hex_color(blue_green_red: Sequence[int]) -> str:
    """Write a colour as #rrggbb."""
    return "#{2:02x}{1:02x}{0:02x}".format(*blue_green_red)


def hex_legend(legend: Legend) -> dict[str, str]:
    """Write the colours of a legend as #rrggbb."""
    return {name: hex_color(color) for name, color in legend.items()}


def segment_colors(segmented: core.SegmentedSweep) -> tuple[Colors, Legend]:
    """Choose the colour of each point of a sweep (N, 3) by its segment, and the legend.

    Each object has its own colour, as far as the eye can distinguish them. Cells of the ground are grey.
    """
    rgb = [
        GROUND_COLORS[index % len(GROUND_COLORS)] if kind == core.GROUND else _rgb(index)
        for index, kind in enumerate(segmented.kinds.tolist())
    ]
    palette = np.array([*rgb, NO_SEGMENT_COLOR], np.uint8)[:, ::-1]
    legend = {"ground": GROUND_COLORS[1], "objects, one colour each": _rgb(0)}
    if core.GROUND not in segmented.kinds:
        legend = {"segments, one colour each (no ground was found)": _rgb(0)}
    legend["no segment"] = NO_SEGMENT_COLOR
    colors = palette[np.minimum(segmented.ids, segmented.num_segments)]
    return colors, {name: color[::-1] for name, color in legend.items()}


def coloring_of(observations: Observations) -> Literal["class", "edge"]:
    """Choose the meaning of the colours of points with classes: edge for steps of the cue edges, else class."""
    names = set(observations.point_class_names)
    return "edge" if names and names <= {NO_EDGE_NAME, *STEP_COLORS} else "class"


def first_coloring(observations: Observations) -> ColorMeaning:
    """Choose what a page shows first: depth for segments, whose two classes say nothing about a pose."""
    return "depth" if observations.has_partitions else coloring_of(observations)


def is_edge(classes: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
    """Return a mask (N,) of the points next to a step in range or intensity, by their classes (N,)."""
    return np.asarray((classes != NO_EDGE) & (classes != NO_CLASS))


class Palette(NamedTuple):
    """Colours of points by their numbers."""

    colors: Colors
    """(C, 3) blue, green, red of each number."""
    numbers: Mapping[str, int]
    """Numbers with a name."""
    others: Legend
    """Colours of what else is drawn."""

    def legend(self, present: npt.NDArray[np.integer] | None = None) -> Legend:
        """Return the colours of the named numbers, or only of those present (N,), and of what else is drawn."""
        numbers = self.numbers.values() if present is None else set(np.unique(present).tolist())
        numbers_by_name = {name: number for name, number in self.numbers.items() if number in numbers}
        return {
            name: tuple(self.colors[number].tolist()) for name, number in numbers_by_name.items()
        } | self.others


def palette_of(observations: Observations, by: ColorMeaning) -> Palette:
    """Choose the colours of points by their meaning; segments have none of their own."""
    if by == "depth":
        levels = depth_levels(np.array(DEPTH_STEPS_M, np.float64)).tolist()
        numbers = {f"{step} m": level for step, level in zip(DEPTH_STEPS_M, levels, strict=True)}
        return Palette(level_colors(np.arange(256, dtype=np.uint8)), numbers, {})
    names, (colors, _) = list(observations.point_class_names), palettes(observations)
    if by == "agreement":
        names, colors = list(AGREEMENT_COLORS), np.array([*AGREEMENT_COLORS.values()], np.uint8)[:, ::-1]
    return Palette(colors, {name: i for i, name in enumerate(names)}, EDGE_LEGEND if by == "edge" else {})


class PageColors(NamedTuple):
    """Colours that a page offers, by their meaning: class or edge, depth, and agreement."""

    tables: dict[str, list[list[int] | None]]
    """Red, green and blue by number; None for what is not drawn."""
    legends: dict[str, dict[str, str]]
    """Colour of each name, #rrggbb."""


def page_colors(observations: Observations, classes: npt.NDArray[np.uint8]) -> PageColors:
    """List the colours for a page, with legends of the classes or edges that occur (N,)."""
    coloring, page = coloring_of(observations), PageColors({}, {})
    present = classes[classes != NO_EDGE] if coloring == "edge" else classes
    choices: tuple[ColorMeaning, ...] = (coloring, "depth", "agreement")
    if observations.has_partitions:  # the share that agrees falls as the pose improves
        choices = ("depth", coloring)
    for by in choices:
        palette = palette_of(observations, by)
        legend = palette.legend(present if by == coloring else None)
        page.tables[by] = palette.colors[:, ::-1].tolist()
        page.legends[by] = hex_legend(legend)
    if coloring == "edge":
        page.tables["edge"][NO_EDGE] = None
    return page


def depth_levels(ranges_m: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
    """Return the level (N,) of each distance from the camera, on a logarithmic scale: 255 nearby, 0 far away."""
    near, far = np.log(DEPTHS_M)
    share = (np.log(np.clip(ranges_m, *DEPTHS_M)) - near) / (far - near)
    return np.asarray(np.rint(255.0 * (1.0 - share)), np.uint8)


def level_colors(levels: npt.NDArray[np.uint8]) -> Colors:
    """Return the colours (N, 3) of levels (N,): blue, green, red; red nearby, blue far away."""
    return np.asarray(cv2.applyColorMap(levels.reshape(-1, 1), cv2.COLORMAP_TURBO), np.uint8).reshape(-1, 3)
