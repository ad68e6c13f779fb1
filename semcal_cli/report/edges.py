"""Edges of sweeps drawn on the edges of pictures, as the cue compares them: see `semcal_cli.drive.cues.edges`."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.cues.edges import EDGES, NO_EDGE, gradients
from semcal_cli.drive.cues.intensity import grey_values, lens_mask
from semcal_cli.drive.document import Drive, Frame
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.report.colors import NO_EDGE_NAME, STEP_COLORS

GREY_STRENGTH = 0.25
"""Strength of the picture beneath its edges, which is there to find one's way."""
BLUR_PX = 1.0
"""Blur of the picture, pixels: an eye wants sharper edges than sparse rays do."""
EDGE_STRENGTH = 170.0
"""Grey value that the strongest edges add: bright, but not so bright that dots on them are lost."""
STRONGEST = 0.99
"""Quantile of the gradients of a picture from which an edge is drawn at full strength."""
EDGE_LEGEND = {"edge in the picture": (210, 210, 210)}
"""Blue, green and red of what is drawn into the picture."""


def coloring_of(observations: Observations) -> Literal["class", "edge"]:
    """Choose what colours say of points with classes: steps, as the cue edges finds them, or any other classes."""
    names = set(observations.point_class_names)
    return "edge" if names and names <= {NO_EDGE_NAME, *STEP_COLORS} else "class"


def is_edge(classes: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
    """Mask (N,) of the points beside which range or intensity steps, by their classes (N,)."""
    return np.asarray((classes != NO_EDGE) & (classes != NO_CLASS))


def edges_by_strength(classes: npt.NDArray[np.uint8]) -> npt.NDArray[np.intp]:
    """Indices of the points with an edge: steps in intensity, then steps in range, the strongest of either last."""
    found = np.flatnonzero(is_edge(classes))
    return found[np.argsort(classes[found], kind="stable")]


def edge_picture(drive: Drive, frame: Frame) -> npt.NDArray[np.uint8]:
    """Draw the edges of a frame's picture in white on the picture, which is dark and grey: (H, W, 3).

    Raises:
        InputError: the frame has no picture, or it is wrong.
    """
    grey = grey_values(drive, frame)
    strength, is_inside = gradients(drive.camera, grey, lens_mask(drive.camera), BLUR_PX, EDGES)
    full = max(float(np.quantile(strength[is_inside], STRONGEST)), float(np.finfo(np.float32).tiny))
    drawn = GREY_STRENGTH * grey + EDGE_STRENGTH * np.minimum(strength / full, 1.0)
    return np.asarray(np.repeat(drawn.astype(np.uint8)[..., None], 3, axis=2))
