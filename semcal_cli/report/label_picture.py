"""A picture under its labels, to see at a glance whether a network was understood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from semcal_cli.report.colors import class_colors
from semcal_cli.report.overlay import before_after, draw_legend

SHARE = 0.55
"""Share of the labels' colours in the drawn picture."""


def draw_labels(
    picture: npt.NDArray[np.uint8],
    ids: npt.NDArray[np.uint16],
    classes: Mapping[str, Sequence[int]],
    ignored: Sequence[int],
) -> npt.NDArray[np.uint8]:
    """Draw a picture beside itself under the colours of its labels, with a legend of the classes that it shows.

    Args:
        picture: (H, W, 3) blue, green, red.
        ids: (H, W) ids of the pixels.
        classes: Ids of each name; empty without names.
        ignored: Ids that carry no information, which get no colour.

    Returns:
        (H', W', 3) blue, green, red.
    """
    found, counts = np.unique(ids, return_counts=True)
    names = {value: name for name, values in classes.items() for value in values}
    shown = [value for value in found.tolist() if value not in ignored and (value in names or not names)]
    # Colours of all classes, so that they do not depend on what a picture shows.
    every = list(classes) or [str(value) for value in shown]
    colors = dict(zip(every, class_colors(every), strict=True))
    drawn = picture.copy()
    for value in shown:
        here = ids == value
        mixed = (1.0 - SHARE) * picture[here] + SHARE * colors[names.get(value, str(value))]
        drawn[here] = mixed.round().astype(np.uint8)
    most = sorted(shown, key=lambda value: -counts[found.tolist().index(value)])
    legend = list(dict.fromkeys(names.get(value, str(value)) for value in most))
    both = before_after(
        {"picture": picture, "labels": drawn}, stacked=picture.shape[1] > 2 * picture.shape[0]
    )
    swatches = np.array([colors[name] for name in legend], np.uint8).reshape(-1, 3)
    return np.vstack([both, draw_legend(legend, swatches, both.shape[1])])
