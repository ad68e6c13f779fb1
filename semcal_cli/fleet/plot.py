"""The drives of a fleet over time, axis by axis."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Literal

import numpy as np

from semcal_cli.fleet.assessment import Fleet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLES = (
    *("camera centre x, cm", "camera centre y, cm", "camera centre z, cm"),
    *("rotation about x, deg", "rotation about y, deg", "rotation about z, deg"),
)
AGREES, DISAGREES, EXPECTED = "#0072b2", "#d55e00", "#444444"


def plot_fleet(fleet: Fleet, format: Literal["png", "svg"]) -> bytes:
    """Draw the drives beside what holds at their times, relative to what holds at the last; 95 % intervals."""
    import matplotlib as mpl

    # Nothing depends on the user's settings, on chance (ids in the drawing) or on the clock.
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"svg.hashsalt": "semcal", "svg.fonttype": "path"})
        buffer = io.BytesIO()
        _draw(fleet).savefig(
            buffer, format=format, dpi=120, metadata={"Date": None} if format == "svg" else None
        )
    return buffer.getvalue()


def _draw(fleet: Fleet) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    all_axes = figure.subplots(3, 2, sharex=True)
    times = np.array([standing.time for standing in fleet.standings])
    disagrees = np.array([standing.disagrees for standing in fleet.standings])
    units = np.array([100.0] * 3 + [1.0] * 3)
    expected = units * np.array([standing.course for standing in fleet.standings])
    offsets = np.array([np.concatenate([s.offset.center_m, s.offset.rotation_deg]) for s in fleet.standings])
    found = expected + units * offsets
    halves = units * np.array([standing.offset.half_widths for standing in fleet.standings])
    allowed = [100.0 * fleet.limits.translation_m] * 3 + [fleet.limits.rotation_deg] * 3
    for index, title in enumerate(TITLES):
        axes = all_axes[index % 3][index // 3]
        for part in range(len(fleet.parts)):
            mine = np.array([standing.part == part for standing in fleet.standings])
            axes.plot(times[mine], expected[mine, index], color=EXPECTED, label="holds then")
            reach = allowed[index]
            axes.fill_between(
                times[mine],
                expected[mine, index] - reach,
                expected[mine, index] + reach,
                color=EXPECTED,
                alpha=0.08,
                linewidth=0.0,
                label="allowed",
            )
        for chosen, color, label in (
            (~disagrees, AGREES, "drives, 95 %"),
            (disagrees, DISAGREES, "drives that disagree"),
        ):
            if chosen.any():
                axes.errorbar(
                    times[chosen],
                    found[chosen, index],
                    halves[chosen, index],
                    fmt="o",
                    markersize=4,
                    linewidth=1.0,
                    color=color,
                    label=label,
                )
        axes.set_title(title, fontsize=10, loc="left")
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in all_axes[-1]:
        axes.set_xlabel("days since the first" if fleet.order == "stamp" else "drives, by name")
    handles, labels = all_axes[0][0].get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once.keys(), loc="outside upper right", ncols=4, frameon=False)
    return figure
