"""Profiles of scores along the camera's six axes through a pose, and their image."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import apply_twist

AXES = ("right, cm", "down, cm", "forward, cm", "pitch, deg", "yaw, deg", "roll, deg")
UNITS = np.array([0.01, 0.01, 0.01, *np.radians([1.0, 1.0, 1.0])])
REACH = np.array([40.0, 40.0, 40.0, 2.0, 2.0, 2.0])

Profile = tuple[np.ndarray, np.ndarray]
"""Offsets (2 steps + 1,) along an axis, in its unit, and what was found there."""


def profiles(score: Callable[[Pose], object], T: Pose, steps: int) -> list[Profile]:
    """Compute a score, or several, along each axis through a pose."""
    found = []
    for reach, axis in zip(REACH, np.eye(6), strict=True):
        offsets = np.linspace(-reach, reach, 2 * steps + 1)
        found.append(
            (offsets, np.array([score(apply_twist(T, offset * UNITS * axis)) for offset in offsets]))
        )
    return found


def draw_profiles(
    curves: Mapping[str, Mapping[str, Sequence[Profile]]], path: Path, head: float, linewidth: float
) -> None:
    """Draw a row for each drive and a column for each axis, each curve over its own range.

    Args:
        curves: Profiles along all axes, by drive and by the label of the curve.
        path: File of the image.
        head: Height of the legend in inches.
        linewidth: Width of the curves in points.
    """
    figure = Figure(figsize=(14.0, head + 2.0 * len(curves)), layout="constrained")
    grid = figure.subplots(len(curves), len(AXES), sharex="col", sharey=True, squeeze=False)
    for axes, (name, by_label) in zip(grid, curves.items(), strict=True):
        axes[0].set_ylabel(name)
        for label, along in by_label.items():
            for ax, (offsets, found) in zip(axes, along, strict=True):
                shown = (found - found[len(found) // 2]) / max(np.ptp(found), 1e-12)
                ax.plot(offsets, shown, label=label, linewidth=linewidth)
        for ax in axes:
            ax.axvline(0.0, color="0.7", linewidth=0.8, zorder=0)
    for ax, axis in zip(grid[-1], AXES, strict=True):
        ax.set_xlabel(axis)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4))
    figure.savefig(path, dpi=90)
