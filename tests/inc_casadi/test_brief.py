"""A noun's repr is one line that tells which it is, however large its arrays are."""

from dataclasses import dataclass

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    DiscountedCost,
    Ellipsoid,
    Empirical,
    Gaussian,
    LeakyReLU,
    Moments,
    Plant,
    Polytope,
    Regional,
    ReLU,
    Spec,
    Stability,
    Uniform,
    bounds,
    close_loop,
    simulate,
)
from inc_casadi.brief import Brief, shown
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.dynamic import DynamicINC
from inc_casadi.linear import LinearController, linear_cost

n = 12
LARGE, UNIT = Plant(np.eye(n) / 2, np.ones((n, 2)) / 50, dt=0.1), Box(-np.ones(n), np.ones(n))
LAW = INC.saturated(-np.ones((2, n)) / 9, 1.0)
COST = DiscountedCost(np.eye(n), np.eye(2), 0.9, UNIT)


def large_nouns():
    spec = Spec(np.eye(n), np.eye(2), 0.9, UNIT, Box([-1, -1], [1, 1]))
    return [
        LARGE, LAW, UNIT, spec, COST, Polytope(np.vstack([np.eye(n), -np.eye(n)]), np.ones(2 * n)), Uniform(UNIT),
        Ellipsoid(np.eye(n)), Gaussian(np.zeros(n), np.eye(n)), Moments(UNIT, np.zeros(n), np.eye(n) / 9),
        Empirical(np.ones((n, 40))), close_loop(LARGE, LAW), simulate(LARGE, LAW, np.ones(n)), LAW.well_posedness(),
        LAW.solve(np.ones((n, 30))), DynamicINC(INC.linear(np.ones((6, 16)) / 90), np.zeros(4)),
        Regional(UNIT, Box([-1, -1], [1, 1]), np.eye(n), np.eye(2), 0.9), LinearController.static(np.zeros((2, n))),
        MatrixCertificate(LARGE, LAW, Stability(0.9), "sector", {"P": np.eye(n), "Lambda": [1.0, 1.0]}, "a note " * 40),
        linear_cost(LARGE, spec, LinearController.static(np.zeros((2, n)))), bounds.first_move(LARGE, spec),
    ]


@pytest.mark.parametrize("noun", large_nouns(), ids=lambda noun: type(noun).__name__)
def test_a_noun_of_twelve_states_prints_one_line(noun):
    text = repr(noun)
    assert text.startswith(type(noun).__name__ + "(") and text.endswith(")")
    assert "\n" not in text and len(text) < 400 and len(text) > len(type(noun).__name__) + 2


def test_a_controller_says_its_sizes_units_and_structure():
    loops = INC(np.full((3, 3), 0.3), np.ones((3, 2)), np.ones((1, 3)), np.zeros((1, 2)), d=[0.5],
                activation=[ReLU(), LeakyReLU(0.1), ReLU()])
    permuted = INC([[0.0, 2.0], [0.0, 0.0]], np.ones((2, 1)), np.ones((1, 2)), [[0.0]])
    assert repr(loops) == "INC(q=3, p=2, m=1, 2 ReLU, 1 LeakyReLU(slope=0.1), biased, loops with lambda_pf(S|W|) = 0.9)"
    assert repr(permuted) == "INC(q=2, p=1, m=1, ReLU, feedforward)"
    assert repr(INC.linear([[1.0, 2.0]])) == "INC(q=0, p=2, m=1, linear)"
    assert repr(INC.saturated(np.eye(2), 1.0)) == "INC(q=2, p=2, m=2, Saturation, feedforward)"


def test_a_plant_says_what_is_measured_only_where_it_is_not_the_state():
    assert repr(Plant(np.eye(2), np.eye(2)[:, :1])) == "Plant(n=2, m=1, dt=1)"
    assert repr(Plant(np.eye(2), np.eye(2)[:, :1], [[1.0, 0.0]], dt=0)) == "Plant(n=2, m=1, p=1, dt=0)"


def test_small_arrays_are_shown_in_full_and_large_ones_by_their_shape():
    assert repr(Box([-1.0, 0.1 + 0.2], [1, 2])) == "Box(lower=[-1, 0.3], upper=[1, 2])"
    assert repr(UNIT) == "Box(lower=<12 array>, upper=<12 array>)"


def test_what_is_none_or_empty_is_left_out():
    assert repr(Stability()) == "Stability()"
    assert repr(Stability(0.9)) == "Stability(rate=0.9)"


def test_a_repr_of_its_own_is_kept_and_inherited():
    class Own(Brief):
        def __repr__(self):
            return "own"

    @dataclass(frozen=True, eq=False)
    class Child(Own):
        value: float = 1.0

    assert repr(Own()) == repr(Child()) == "own"


@pytest.mark.parametrize(("value", "text"), [
    ([1.0, 2.0], "[1, 2]"), ((1.0,), "(1,)"), ([1.0] * 9, "<9 of float>"), ([np.eye(9)], "<1 of ndarray>"),
    ("x" * 99, "'" + "x" * 68 + "..."), (UNIT, "Box(lower=<12 array>, upper=<12 array>)"), (COST, "<DiscountedCost>"),
    (np.array([None]), "<1 array>"), (np.array([1 + 2j]), "[1+2j]"), (np.array([True]), "<1 array>"),
])
def test_values_of_each_kind(value, text):
    assert shown(value) == text
