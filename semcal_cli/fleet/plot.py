"""The drives of a fleet over time, axis by axis."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from semcal_cli.fleet.fleet import Fleet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLES = (
    *("camera centre x, cm", "camera centre y, cm", "camera centre z, cm"),
    *("rotation about x, deg", "rotation about y, deg", "rotation about z, deg"),
)
UNITS = np.array([100.0] * 3 + [1.0] * 3)
"""Factors from metres and degrees to the drawn units, centimetres and degrees."""
AGREES, DISAGREES, EXPECTED = "#0072b2", "#d55e00", "#444444"


def plot_fleet(fleet: Fleet, format: Literal["png", "svg"]) -> bytes:
    """Draw the drives and the rig's pose at their times, relative to the pose at the last drive; 95 % intervals."""
    import matplotlib as mpl

    # The drawing must not depend on the user's settings, on chance (ids in the drawing) or on the clock.
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
    for index, title in enumerate(TITLES):
        axes = all_axes[index % 3][index // 3]
        _draw_expected(axes, fleet, index)
        _draw_drives(axes, fleet, index)
        axes.set_title(title, fontsize=10, loc="left")
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in all_axes[-1]:
        axes.set_xlabel("days since the first" if fleet.order == "stamp" else "drives, by name")
    handles, labels = all_axes[0][0].get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once.keys(), loc="outside upper right", ncols=4, frameon=False)
    return figure


def _draw_expected(axes: Axes, fleet: Fleet, index: int) -> None:
    """Draw the rig's pose at each time, part by part, with the allowed range about it."""
    times, expected = _times(fleet), _expected(fleet)[:, index]
    reach = 100.0 * fleet.limits.translation_m if index < 3 else fleet.limits.rotation_deg
    for part in range(len(fleet.parts)):
        mine = np.array([drive.part == part for drive in fleet.drives])
        axes.plot(times[mine], expected[mine], color=EXPECTED, label="holds then")
        axes.fill_between(
            times[mine],
            expected[mine] - reach,
            expected[mine] + reach,
            color=EXPECTED,
            alpha=0.08,
            linewidth=0.0,
            label="allowed",
        )


def _draw_drives(axes: Axes, fleet: Fleet, index: int) -> None:
    """Draw the pose of each drive, with its 95 % interval."""
    times, disagrees = _times(fleet), np.array([drive.disagrees for drive in fleet.drives])
    offsets = np.array([np.concatenate([d.offset.center_m, d.offset.rotation_deg]) for d in fleet.drives])
    found = (_expected(fleet) + UNITS * offsets)[:, index]
    halves = (UNITS * np.array([drive.offset.half_widths for drive in fleet.drives]))[:, index]
    for chosen, color, label in (
        (~disagrees, AGREES, "drives, 95 %"),
        (disagrees, DISAGREES, "drives that disagree"),
    ):
        if chosen.any():
            axes.errorbar(
                times[chosen],
                found[chosen],
                halves[chosen],
                fmt="o",
                markersize=4,
                linewidth=1.0,
                color=color,
                label=label,
            )


def _times(fleet: Fleet) -> npt.NDArray[np.float64]:
    """Times (N,) of the drives."""
    return np.array([drive.time for drive in fleet.drives])


def _expected(fleet: Fleet) -> npt.NDArray[np.float64]:
    """Pose of the rig (N, 6) at the time of each drive, centimetres and degrees."""
    expected: npt.NDArray[np.float64] = UNITS * np.array([drive.expected for drive in fleet.drives])
    return expected
