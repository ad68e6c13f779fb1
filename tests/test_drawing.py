"""Drawings of pages and plots: names that do not run together, ranges that fit, and colours of the page."""

import re
from dataclasses import replace
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from fleets import SIGMAS, TRUTH, series_of
from matplotlib.figure import Figure

from semcal_cli.config import Limits
from semcal_cli.fleet.combination import combine_drives
from semcal_cli.fleet.fleet_drives import FleetDrive
from semcal_cli.fleet.fleet_result import Fleet
from semcal_cli.fleet.timeline import SIZE, TOP, make_timeline, plot_fleet, timeline_plots
from semcal_cli.geometry.twists import local_coordinates, pose_at
from semcal_cli.report.drawing import BOTTOM, POINTS_PER_INCH, VARIABLES, name_places

NARROWEST_LETTER_PX = 6.0
"""Less than the width of a digit."""


def fleet_of(drives: list[FleetDrive]) -> Fleet:
    return combine_drives(drives, Limits())


@pytest.mark.parametrize("count", [2, 3, 7, 12, 24, 400])
@pytest.mark.parametrize("name", [None, "{:014d}", "a_name_that_has_no_room_{:d}", "$x^{:d}$ <b>"])
def test_names_below_a_drawing_do_not_run_together(count: int, name: str | None) -> None:
    """Of dates, of names and of numbers in their place; the first and the last are among them."""
    drives = series_of("nothing", count)
    if name is not None:
        drives = [replace(drive, name=name.format(i), stamp=None) for i, drive in enumerate(drives)]
    timeline = make_timeline(fleet_of(drives))
    svg = timeline_plots(timeline)[0].svg
    texts = re.findall(r'<text style="([^"]*)" x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]*)</text>', svg)
    names_below = [
        (float(x), style, text) for style, x, y, text in texts if SIZE[1] - BOTTOM < float(y) < SIZE[1] - 12.0
    ]
    escaped = [text.replace("&lt;", "<").replace("&gt;", ">") for _, _, text in names_below]
    assert (escaped[0], escaped[-1]) == (timeline.labels[0], timeline.labels[-1])
    ends = []
    for (x, style, _), text in zip(names_below, escaped, strict=True):
        width = NARROWEST_LETTER_PX * len(text)
        begin = x - (width if "text-anchor: end" in style else width / 2.0)
        ends.append((begin, begin + width))
    assert all(end < begin for (_, end), (begin, _) in pairwise(ends))
    assert ends[-1][1] <= SIZE[0]


def test_names_of_places_at_any_distance_stay_apart() -> None:
    """Dates of drives that were made now and then, as wide as they are drawn."""
    rng, dpi = np.random.default_rng(0), POINTS_PER_INCH
    for _ in range(30):
        times = np.sort(rng.uniform(0.0, 10.0, rng.integers(2, 20)))
        figure = Figure((SIZE[0] / dpi, SIZE[1] / dpi), dpi=dpi)
        axes = figure.add_axes((0.14, 0.2, 0.82, 0.7))
        axes.set_xlim(times[0] - 0.1, times[-1] + 0.1)
        name_places(axes, times, [f"2023-11-{day:02d}" for day in range(len(times))])
        figure.draw_without_rendering()
        extents = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert all(right.x0 - left.x1 > 3.0 for left, right in pairwise(extents))


def test_drives_that_agree_much_better_than_they_have_to_are_not_flattened() -> None:
    """Those within a millimetre spread over their drawings, whatever is allowed."""
    drives = series_of("nothing")
    for i, drive in enumerate(drives):
        assert drive.T_camera_lidar is not None
        (off,) = local_coordinates([drive.T_camera_lidar], TRUTH)
        small = {"T_camera_lidar": pose_at(TRUTH, off / 20.0), "covariance": np.diag((SIGMAS / 20.0) ** 2)}
        drives[i] = replace(drive, **small)
    for plot in timeline_plots(make_timeline(fleet_of(drives))):
        y = np.array(re.findall(r'<use [^>]*y="([\d.]+)"', plot.svg), float)
        assert np.ptp(y) > 0.3 * (SIZE[1] - BOTTOM - TOP)


def test_the_axes_hold_the_intervals_of_drives_that_agree_far_better_than_these() -> None:
    """All but one of a hundred times the others, which would flatten them."""
    drives = series_of("nothing")
    wide = [replace(drive, T_camera_lidar=TRUTH, covariance=np.diag(SIGMAS**2)) for drive in drives]
    wide[3] = replace(wide[3], covariance=np.diag((100.0 * SIGMAS) ** 2))
    for plot in timeline_plots(make_timeline(fleet_of(wide))):
        path = max(re.findall(r'<path d="([^"]*)"', plot.svg), key=lambda path: path.count("M"))
        ends = np.array(re.findall(r"[ML] [\d.-]+ ([\d.-]+)", path), float).reshape(-1, 2)
        is_inside = ((ends > TOP) & (ends < SIZE[1] - BOTTOM)).all(axis=1)
        assert is_inside.sum() == len(drives) - 1
        assert np.ptp(ends, axis=1)[is_inside].min() > 10.0


def test_a_drawing_takes_the_colours_of_the_page() -> None:
    """And has nothing that would hold for the rest of the page."""
    svg = "".join(plot.svg for plot in timeline_plots(make_timeline(fleet_of(series_of("outlier")))))
    assert not [color for color in VARIABLES if color in svg]
    assert {"var(--accent)", "var(--ink)", "var(--line)"} <= set(re.findall(r"var\([^)]*\)", svg))
    assert "<style" not in svg
    ids = re.findall(r' id="([^"]*)"', svg)
    assert len(ids) == len(set(ids))


def test_the_user_s_settings_do_not_change_a_plot() -> None:
    fleet = fleet_of(series_of("change"))
    before = plot_fleet(fleet, "svg")
    with mpl.rc_context({"font.size": 20.0, "axes.facecolor": "red"}):
        assert plot_fleet(fleet, "svg") == before
