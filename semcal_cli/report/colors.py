"""Colours of classes and of segments, in every picture and page."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.observations import Observations

Colors: TypeAlias = npt.NDArray[np.uint8]
"""(C, 3) blue, green, red of each class, or of each point."""
Legend: TypeAlias = dict[str, tuple[int, ...]]
"""Blue, green and red of each named entry."""

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
# Red, green, blue, of the classes of the cue edges. Larger steps are brighter; range is told from intensity by the hue.
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

GOLDEN_RATIO = 0.618034
SATURATION = 0.65

# Red, green, blue.
GROUND_COLORS = ((150, 150, 150), (185, 185, 185), (220, 220, 220))
NO_SEGMENT_COLOR = (70, 70, 70)


def class_colors(names: Sequence[str]) -> Colors:
    """Choose the colour of each class: that of its name, as of CARLA's, else the next of a list, then of the hues."""
    unknown = [name for name in names if name not in KNOWN_COLORS]
    colors = {name: _rgb(number) for number, name in enumerate(unknown)}
    rgb = [(KNOWN_COLORS | colors)[name] for name in names]
    return np.array(rgb, dtype=np.uint8).reshape(-1, 3)[:, ::-1]


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


def hex_color(blue_green_red: tuple[int, ...]) -> str:
    """Write a colour as #rrggbb."""
    return "#{2:02x}{1:02x}{0:02x}".format(*blue_green_red)


def segment_colors(segmented: _core.SegmentedSweep) -> tuple[Colors, Legend]:
    """Choose the colour of each point of a sweep (N, 3) by its segment, and the legend.

    Each object has a colour of its own, as far as the eye tells them apart. Cells of the ground are grey.
    """
    rgb = [
        GROUND_COLORS[index % len(GROUND_COLORS)] if kind == _core.GROUND else _rgb(index)
        for index, kind in enumerate(segmented.kinds.tolist())
    ]
    palette = np.array([*rgb, NO_SEGMENT_COLOR], np.uint8)[:, ::-1]
    legend = {"ground": GROUND_COLORS[1], "objects, a colour each": _rgb(0), "no segment": NO_SEGMENT_COLOR}
    colors = palette[np.minimum(segmented.ids, segmented.num_segments)]
    return colors, {name: (blue, green, red) for name, (red, green, blue) in legend.items()}
