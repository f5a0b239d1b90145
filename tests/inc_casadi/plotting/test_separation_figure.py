"""The picture of the scalar separation: its curves are the theorems' figures, its motions those of the loop."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from inc_casadi.bounds.scalar import ScalarSeparation
from inc_casadi.errors import InvalidInputError
from inc_casadi.plotting import plot_separation
from inc_casadi.plotting.separation_figure import DYNAMIC, LAW, STATIC

MOVES = ([0.25, 1.0], [0.36, 0.42])


def line(axes: Any, words: str) -> Any:
    [found] = [one for one in axes.lines if words in str(one.get_label())]
    return found


@pytest.fixture(scope="module")
def figure() -> Figure:
    return plot_separation(ScalarSeparation(1.0), MOVES)


def test_costs_are_the_theorems(figure: Figure):
    axes = figure.axes[2]
    for words, value in (("law", lambda b: 1 / 3 + b / 36), ("first move", lambda b: 1 / 3 + b / 12),
                         ("static gain", lambda b: 1 / (3 * (1 - b / 4)))):
        beta, cost = line(axes, words).get_data()
        assert cost == pytest.approx(value(beta)) and beta[0] == pytest.approx(0.01) and beta[-1] == 1.0


def test_bounds_of_more_moves_are_drawn_where_they_are_given(figure: Figure):
    assert np.array(line(figure.axes[2], "many moves").get_data()) == pytest.approx(np.array(MOVES))
    labels = [str(one.get_label()) for one in plot_separation(ScalarSeparation(1.0)).axes[2].lines]
    assert not any("many moves" in label for label in labels)


def test_the_law_saturates_at_its_kinks_and_the_first_move_reaches_the_corners(figure: Figure):
    axes = figure.axes[0]
    x, u = line(axes, "law").get_data()
    assert x == pytest.approx([-1, -2 / 3, 2 / 3, 1]) and u == pytest.approx([1, 1, -1, -1])
    x, u = line(axes, "first move").get_data()
    assert u == pytest.approx(-x)


def test_motions_are_those_of_the_two_loops(figure: Figure):
    axes = figure.axes[1]
    law = [one.get_ydata() for one in axes.lines if one.get_color() == LAW]
    linear = [one.get_ydata() for one in axes.lines if one.get_color() == STATIC]
    assert [motion[0] for motion in law] == [motion[0] for motion in linear] == [1.0, 0.85, -0.6]
    assert law[0][:3] == pytest.approx([1.0, 0.5, 0.0]) and law[2][1] == pytest.approx(0.0, abs=1e-15)
    assert all(motion == pytest.approx(motion[0] * 0.5 ** np.arange(7)) for motion in linear)


def test_an_input_cost_moves_the_curves():
    beta, r = Fraction(1, 2), Fraction(3, 10)
    figure = plot_separation(ScalarSeparation(beta, r, Fraction(6, 5)))
    one = ScalarSeparation(beta, r, Fraction(6, 5))
    middle = {words: float(line(figure.axes[2], words).get_ydata()[49]) for words in ("law", "first move", "static gain")}
    assert middle == pytest.approx({"law": float(one.relu_law), "first move": float(one.dynamic_linear),
                                    "static gain": float(one.static_linear)})
    assert figure.axes[2].get_title().endswith("$r = 0.3$")
    gain = -0.6 / 0.8  # -beta a / (r + beta)
    first = next(one for one in figure.axes[0].lines if one.get_color() == DYNAMIC)
    assert first.get_ydata() == pytest.approx(gain * first.get_xdata())


def test_it_is_written_where_asked(tmp_path):
    plot_separation(ScalarSeparation(0.9), path=tmp_path / "separation.png")
    assert (tmp_path / "separation.png").stat().st_size > 20_000


def test_bounds_that_do_not_fit_their_discounts_are_refused():
    with pytest.raises(InvalidInputError):
        plot_separation(ScalarSeparation(1), ([0.5, 1.0], [0.4]))
