"""The interval chart: ends are bounds and costs, and what is proved, certified, simulated or refuted looks different."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from inc_casadi import INC, Box, Plant, Spec, compare
from inc_casadi.bounds import ScalarSeparation
from inc_casadi.comparison import Comparison
from inc_casadi.plotting import plot_intervals
from inc_casadi.plotting.interval_figure import BREAKS, CHECKED, OPEN, PROVED, SAMPLED, intervals

PLANT, SPEC = Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
EXACT = ScalarSeparation(Fraction(9, 10))


@pytest.fixture(scope="module")
def found() -> Comparison:
    laws = {"gain": [[-0.9]], "sat": INC.saturated([[-1.5]], 1.0), "wild": [[-1.4]], "f": lambda y: np.clip(-1.2 * y, -1, 1)}
    return compare(PLANT, SPEC, laws, bounds=["any", "linear"], cells=100, samples=300)


def bars(axes: Any) -> list[tuple[float, float, float]]:
    """Height, left and right end of each interval."""
    shown = [part for part in axes.patches if isinstance(part, Rectangle)]
    return [(round(part.get_y() + part.get_height() / 2), part.get_x(), part.get_x() + part.get_width()) for part in shown]


def ends(axes: Any) -> dict[int, Any]:
    """The mark of each line of the chart."""
    return {round(float(line.get_ydata()[0])): line for line in axes.lines if line.get_marker() in ("D", "o", "x")}


def test_the_ends_are_the_bounds_and_the_costs(found: Comparison):
    axes = plot_intervals(found).axes[0]
    floor = float(found.floor("any").value)  # type: ignore[union-attr]
    linear = float(found.floor("linear").value)  # type: ignore[union-attr]
    shown = {y: (low, high) for y, low, high in bars(axes)}
    gain, sat = found.cost_of("gain"), found.cost_of("sat")
    assert shown[0] == pytest.approx((floor, gain)) and shown[1] == pytest.approx((floor, sat))
    assert shown[4] == pytest.approx((floor, sat)) and shown[5] == pytest.approx((linear, gain))
    assert shown[6] == pytest.approx((linear, gain))  # no bound of its own was asked for
    assert set(shown) == {0, 1, 4, 5, 6}  # the law that breaks the limits and the simulated one have no interval
    assert linear == pytest.approx(float(EXACT.dynamic_linear))  # the closed form
    assert floor <= float(EXACT.relu_law) + 1e-9 <= sat + 2e-9


def test_how_each_end_is_known_is_seen_from_its_mark(found: Comparison):
    marks = ends(plot_intervals(found).axes[0])
    assert [marks[y].get_marker() for y in range(7)] == ["D", "D", "x", "o", "D", "D", "D"]
    assert marks[0].get_fillstyle() == "left" and marks[3].get_markerfacecolor() == "white"
    proved = ends(plot_intervals(found.proved()).axes[0])
    assert proved[0].get_fillstyle() == "full" == proved[5].get_fillstyle() and proved[0].get_markerfacecolor() == "black"
    known = [(row.low_how, row.high_how) for row in intervals(found.proved())]
    assert known == [(PROVED, how) for how in (PROVED, PROVED, BREAKS, SAMPLED, PROVED, PROVED, PROVED)]


def test_the_legend_lists_what_occurs_and_no_more(found: Comparison):
    words = [text.get_text() for text in plot_intervals(found).legends[0].get_texts()]
    assert words == ["class: static linear gains", "class: any controller", "class: linear controllers",
                     "lower bound, certified in floats", "cost, certified in floats", "cost, simulated, two standard errors",
                     "breaks the input limits"]
    words = [text.get_text() for text in plot_intervals(found.proved()).legends[0].get_texts()]
    assert "cost, proved" in words and "cost, certified in floats" not in words


def test_labels_keep_bounds_true(found: Comparison):
    for row in intervals(found):
        for part in row.label.split("\n")[1].split(", "):
            kind, _, figure = part.rpartition(" ")
            if kind == "at least":
                assert row.of_class and float(figure) <= row.low
            if kind == "at most":
                assert float(figure) >= row.high and row.high_how == CHECKED
    assert intervals(found)[3].label.startswith("f\nabout ") and "at m" not in intervals(found)[2].label


def test_a_class_without_a_certified_member_is_open_to_the_right():
    only = compare(PLANT, SPEC, {"sat": INC.saturated([[-1.5]], 1.0)}, bounds=["linear"])
    figure = plot_intervals(only)
    axes = figure.axes[0]
    [(y, low, right)] = [bar for bar in bars(axes)]
    assert y == 1 and low == pytest.approx(float(only.floor("linear").value))  # type: ignore[union-attr]
    assert right == pytest.approx(axes.get_xlim()[1]) and [line.get_marker() for line in axes.lines].count(">") == 1
    assert intervals(only)[1].label == "best of linear controllers\nat least 0.4083333"
    assert intervals(only)[1].high_how == OPEN and np.isnan(intervals(only)[1].high)


def test_figures_of_different_size_take_a_logarithmic_axis():
    spec = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    laws = {"sat": INC.saturated([[-1.05]], 1.0), "slow": [[-0.0501]]}
    wide = compare(Plant(1.0499, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)), laws, bounds=["any"], cells=20)
    values = [row.high for row in intervals(wide)]
    assert max(values) > 30 * min(values)
    assert plot_intervals(wide).axes[0].get_xscale() == "log"
    close = compare(PLANT, spec, {"sat": laws["sat"]}, bounds=["any"], cells=20)
    assert plot_intervals(close).axes[0].get_xscale() == "linear"


def test_nothing_known_says_so_and_a_result_is_taken_by_its_comparison(found: Comparison, tmp_path: Path):
    empty = Comparison(PLANT, SPEC, (), ())
    assert [text.get_text() for text in plot_intervals(empty).axes[0].texts] == ["neither a cost nor a bound is known"]

    class Result:
        def comparison(self) -> Comparison:
            return found

    figure = plot_intervals(Result(), tmp_path / "chart.pdf")
    assert len(figure.axes[0].get_yticklabels()) == 7 and (tmp_path / "chart.pdf").read_bytes().startswith(b"%PDF")
