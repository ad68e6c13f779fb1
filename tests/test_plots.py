"""The plots of the experiments: ticks that a person reads, single points where there are few, and the same bytes."""

import math

import matplotlib as mpl
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from semcal_cli.experiments.plots import (
    ACCENT,
    MAX_FOR_DOTS,
    WRONG,
    draw_groups,
    make_logarithmic,
    plain_number,
    plot_png,
)


def axes_with(values: list[float]) -> Axes:
    """Axes with a column of values."""
    axes = Figure().subplots()
    draw_groups(axes, [[values]], {"a": ACCENT})
    return axes


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.004, 3.0], ["0.01", "0.1", "1"]),
        ([0.002, 0.08], ["0.002", "0.005", "0.01", "0.02", "0.05"]),
        ([2.5, 5.2], ["3", "4", "5"]),
        ([20.0, 300_000.0], ["100", "1000", "10000", "100000"]),
    ],
)
def test_ticks_of_logarithms_are_plain_numbers(values: list[float], expected: list[str]) -> None:
    axes = axes_with(values)
    make_logarithmic(axes)
    low, high = axes.get_ylim()
    axes.figure.draw_without_rendering()
    ticks = zip(axes.yaxis.get_majorticklocs(), axes.yaxis.get_majorticklabels(), strict=True)
    assert not any(label.get_text() for label in axes.yaxis.get_minorticklabels())
    assert [label.get_text() for place, label in ticks if low <= place <= high] == expected


def test_numbers_without_exponents() -> None:
    numbers = (0.00001, 0.05, 1.0, 30.000000000000004, 1e6)
    assert [plain_number(number) for number in numbers] == ["0.00001", "0.05", "1", "30", "1000000"]


def test_few_values_are_dots_with_a_tick_at_their_median() -> None:
    values = [5.0, 1.0, 2.0, 9.0, math.inf]
    dots, tick, _ = axes_with(values).lines
    assert sorted(dots.get_ydata()) == [1.0, 2.0, 5.0, 9.0]
    assert len(set(dots.get_xdata())) == 4
    assert max(map(abs, dots.get_xdata())) <= 0.4
    assert list(tick.get_ydata()) == [5.0, 5.0]  # of all five, the failed one among them
    assert len(axes_with([float(number) for number in range(MAX_FOR_DOTS + 1)]).patches) == 1
    dots, _ = axes_with([1.0, math.inf, math.inf]).lines  # most failed: no median
    assert list(dots.get_ydata()) == [1.0]
    assert all(len(line.get_ydata()) == 0 for line in axes_with([]).lines)


def test_groups_stand_side_by_side() -> None:
    axes = Figure().subplots()
    columns = draw_groups(axes, [[[1.0], [2.0]], [[3.0], []]], {"a": ACCENT, "b": WRONG})
    assert [place for place, _ in columns] == pytest.approx([-0.2, 0.8, 0.2, 1.2])
    points = [(*line.get_xdata(), *line.get_ydata()) for line in axes.lines if len(line.get_xdata()) == 1]
    assert points == [pytest.approx(point) for point in [(-0.2, 1.0), (0.8, 2.0), (0.2, 3.0)]]
    assert axes.get_legend_handles_labels()[1] == ["a", "b"]


def test_the_user_s_settings_do_not_change_a_plot() -> None:
    def draw() -> Figure:
        return axes_with([1.0, 2.0]).figure

    before = plot_png(draw)
    with mpl.rc_context({"axes.facecolor": "red", "font.size": 30.0, "lines.linewidth": 9.0}):
        assert plot_png(draw) == before
        assert mpl.rcParams["font.size"] == 30.0
    assert (ACCENT, WRONG) == ("#0072b2", "#d55e00")
