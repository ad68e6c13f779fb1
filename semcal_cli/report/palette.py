"""Meaning of the colours of points: class, edge, depth or agreement, as a number of each point and a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.drive.cues.edges import NO_EDGE
from semcal_cli.drive.observations import Observations
from semcal_cli.report.colors import Colors, Legend, hex_color, palettes
from semcal_cli.report.edges import EDGE_LEGEND, coloring_of

Coloring: TypeAlias = Literal["class", "depth", "agreement", "segment", "edge"]
# Red, green, blue, of Okabe and Ito's.
AGREEMENT_COLORS = {
    "agree": (0, 158, 115),
    "disagree": (213, 94, 0),
    "hidden from the camera": (120, 120, 120),
}
AGREES, DISAGREES, HIDDEN, NO_PAIR = range(4)
"""Indices in `AGREEMENT_COLORS`, and that of points without a label on either side."""
DEPTHS_M = (2.0, 100.0)
"""Depths at which the colours begin and end, on a logarithmic scale; the legend names some between."""
DEPTH_STEPS_M = (2, 5, 10, 20, 50, 100)


class Palette(NamedTuple):
    """Colours of points by their numbers."""

    colors: Colors
    """(C, 3) blue, green, red of each number."""
    numbers: Mapping[str, int]
    """Numbers with a name."""
    others: Mapping[str, tuple[int, ...]]
    """Colours of what else is drawn."""

    def legend(self, present: npt.NDArray[np.integer] | None = None) -> Legend:
        """Colours of the named numbers, of those that occur (N,) if they are given, and of what else is drawn."""
        shown = self.numbers.values() if present is None else set(np.unique(present).tolist())
        named = {name: number for name, number in self.numbers.items() if number in shown}
        return {name: tuple(self.colors[number].tolist()) for name, number in named.items()} | dict(
            self.others
        )


def palette_of(observations: Observations, by: Coloring) -> Palette:
    """Choose the colours of points by what they say; segments have none of their own."""
    if by == "depth":
        levels = depth_levels(np.array(DEPTH_STEPS_M, np.float64)).tolist()
        numbers = {f"{step} m": level for step, level in zip(DEPTH_STEPS_M, levels, strict=True)}
        return Palette(level_colors(np.arange(256, dtype=np.uint8)), numbers, {})
    if by == "agreement":
        colors = np.array(list(AGREEMENT_COLORS.values()), np.uint8)[:, ::-1]
        return Palette(colors, {name: number for number, name in enumerate(AGREEMENT_COLORS)}, {})
    of_points, _ = palettes(observations)
    numbers = {name: number for number, name in enumerate(observations.point_class_names)}
    return Palette(of_points, numbers, EDGE_LEGEND if by == "edge" else {})


def page_palettes(observations: Observations) -> dict[Coloring, Palette]:
    """Palettes between which a page can choose, by what colours say."""
    return {by: palette_of(observations, by) for by in (coloring_of(observations), "depth", "agreement")}


def color_tables(observations: Observations) -> dict[str, list[list[int] | None]]:
    """List red, green and blue by class or edge, by level of depth, and by agreement; None where there is no edge."""
    tables: dict[str, list[list[int] | None]] = {
        by: palette.colors[:, ::-1].tolist() for by, palette in page_palettes(observations).items()
    }
    if "edge" in tables:
        tables["edge"][NO_EDGE] = None
    return tables


def legends(observations: Observations, classes: npt.NDArray[np.uint8]) -> dict[str, dict[str, str]]:
    """List the colours, #rrggbb, of the classes or edges that occur, of depths, and of agreement, by their names."""
    coloring, found = coloring_of(observations), dict[str, dict[str, str]]()
    present = classes[classes != NO_EDGE] if coloring == "edge" else classes
    for by, palette in page_palettes(observations).items():
        legend = palette.legend(present if by == coloring else None)
        found[by] = {name: hex_color(color) for name, color in legend.items()}
    return found


def depth_levels(ranges_m: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
    """Level (N,) of each distance from the camera, on a logarithmic scale: 255 near by, 0 far away."""
    near, far = np.log(DEPTHS_M)
    share = (np.log(np.clip(ranges_m, *DEPTHS_M)) - near) / (far - near)
    return np.asarray(np.rint(255.0 * (1.0 - share)), np.uint8)


def level_colors(levels: npt.NDArray[np.uint8]) -> Colors:
    """Colours (N, 3) of levels (N,): blue, green, red; red near by, blue far away."""
    return np.asarray(cv2.applyColorMap(levels.reshape(-1, 1), cv2.COLORMAP_TURBO), np.uint8).reshape(-1, 3)
