"""Points as dots on an image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.geometry.arrays import Colors, Image

COLUMNS_PER_DOT_RADIUS = 640
MAX_SPREAD_RADIUS_PX = 4
"""Radius up to which all pixels of all dots are set at once; larger dots are drawn one by one."""


@dataclass(frozen=True)
class DotStyle:
    """How points are drawn."""

    radius_px: int | None = None
    """Radius of a dot; None depends on the width of the image."""
    opacity: float = 1.0
    """From 0, invisible, to 1."""
    has_outline: bool = False
    """Whether dots have a black outline."""


PLAIN = DotStyle()


def draw_dots(
    background: Image, pixels: npt.NDArray[np.intp], colors: Colors, style: DotStyle = PLAIN
) -> Image:
    """Draw dots on an image (H, W, 3) at pixels (M, 2), (u, v), in their colours (M, 3); later ones are on top."""
    canvas = background.copy()
    radius = style.radius_px or max(1, round(background.shape[1] / COLUMNS_PER_DOT_RADIUS))
    if style.has_outline:
        _fill_disks(canvas, pixels, np.zeros_like(colors), radius + max(1, radius // 2))
    _fill_disks(canvas, pixels, colors, radius)
    if style.opacity == 1.0:
        return canvas
    return np.asarray(cv2.addWeighted(canvas, style.opacity, background, 1.0 - style.opacity, 0.0), np.uint8)


def _fill_disks(canvas: Image, pixels: npt.NDArray[np.intp], colors: Colors, radius: int) -> None:
    if radius > MAX_SPREAD_RADIUS_PX:
        for (u, v), color in zip(pixels.tolist(), colors.tolist(), strict=True):
            cv2.circle(canvas, (u, v), radius, color, cv2.FILLED)
        return
    height, width = canvas.shape[:2]
    span = np.arange(-radius, radius + 1)
    du, dv = (grid.ravel() for grid in np.meshgrid(span, span))
    is_disk = du**2 + dv**2 <= (radius + 0.5) ** 2
    u, v = pixels[:, :1] + du[is_disk], pixels[:, 1:] + dv[is_disk]
    is_inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    # Dots are assigned in the order of the points: the last one on a pixel remains.
    canvas[v[is_inside], u[is_inside]] = np.broadcast_to(colors[:, None], (*u.shape, 3))[is_inside]
