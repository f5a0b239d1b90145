"""The closed forms against the machinery for any plant, the paper's own formulas, and brute force that knows neither."""

from __future__ import annotations

from fractions import Fraction as F
from itertools import product

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Regional, Spec, certify
from inc_casadi.bounds import affine_moves, any_controller, first_move
from inc_casadi.bounds.scalar import ScalarSeparation
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear.static_gain import best_static_gain

GRID = [(beta, r, a) for a in (F(3, 2), F(6, 5), F(8, 5)) for beta, r in
        ((F(1), F(0)), (F(1), F(1, 3)), (F(1), F(11, 4)), (F(7, 10), F(1, 20)), (F(7, 10), F(9, 10)), (F(1, 8), F(2)))]
IDS = [f"a={a}, beta={beta}, r={r}" for beta, r, a in GRID]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)


def posed(beta, r, a):
    """The scalar problem for the general machinery."""
    return Plant(float(a), 1.0), Spec(1.0, float(r), float(beta), Box(-1, 1), Box(-1, 1))


def simulated_cost(beta, r, a, law, kinks, steps):
    """E J of a law by Gauss-Legendre between the kinks in x_0, where the cost is a polynomial of degree 2."""
    total, ends = 0.0, [-1.0, *kinks, 1.0]
    for low, high in zip(ends[:-1], ends[1:], strict=True):
        x = (low + high) / 2 + (high - low) / 2 * NODES
        for k in range(steps):
            u = law(x)
            total += beta**k * (high - low) / 4 * WEIGHTS @ (x**2 + r * u**2)
            x = a * x + u
    return total


def test_the_paper_s_example_to_the_last_digit():
    for beta, r in product((F(1), F(9, 10), F(1, 20)), (F(0), F(1, 100), F(1, 50))):
        one = ScalarSeparation(beta, r)
        assert one.relu_law == F(1, 3) + beta / 36 + r * (F(5, 9) + beta / 16)  # eq:nn_input_penalty_cost
        assert one.dynamic_linear == F(1, 3) + r / 3 + beta / 12  # eq:dyn_input_penalty_lower
        assert one.threshold == 8 * beta / (32 + 9 * beta)  # eq:r_threshold
        if r == 0:
            assert one.static_linear == 1 / (3 * (1 - beta / 4))  # eq:lsof_optimal_cost
            assert one.static_linear - one.relu_law == beta * (8 + beta) / (144 * (1 - beta / 4))
            assert one.gap == beta / 18


@pytest.mark.parametrize(("beta", "r", "a"), GRID, ids=IDS)
def test_the_first_move_is_that_of_the_quadratic_program(beta, r, a):
    one, bound = ScalarSeparation(beta, r, a), first_move(*posed(beta, r, a))
    assert bound.value <= one.dynamic_linear
    assert bound.value == pytest.approx(float(one.dynamic_linear), abs=1e-7)
    assert bound.moves[0, 0] == pytest.approx([float(one.first_gain), 0.0], abs=1e-3)


@pytest.mark.parametrize(("beta", "r", "a"), GRID, ids=IDS)
def test_no_first_move_on_a_fine_grid_is_better(beta, r, a):
    kappa, d = np.meshgrid(np.linspace(-1, 1, 2001), np.linspace(-1, 1, 41))
    x = NODES[:, None, None]
    u = kappa * x + d
    costs = np.tensordot(WEIGHTS / 2, x**2 + float(r) * u**2 + float(beta) * (float(a) * x + u) ** 2, axes=1)
    best = np.min(costs[np.abs(kappa) + np.abs(d) <= 1 + 1e-12])
    assert 0 <= best - float(ScalarSeparation(beta, r, a).dynamic_linear) + 1e-14 < 1e-5


@pytest.mark.parametrize(("beta", "r", "a"), GRID, ids=IDS)
def test_the_law_costs_what_exact_pieces_and_its_motions_say(beta, r, a):
    plant, spec = posed(beta, r, a)
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    cost = float(ScalarSeparation(beta, r, a).relu_law)
    assert 0 <= certify(plant, INC.saturated([[-float(a)]], 1.0), claim).require().bound / cost - 1 + 1e-14 < 1e-8
    b, r, a = float(beta), float(r), float(a)
    assert simulated_cost(b, r, a, lambda x: -np.clip(a * x, -1, 1), (-1 / a, 1 / a), 4) == pytest.approx(cost, rel=1e-13)


@pytest.mark.parametrize(("beta", "r", "a"), GRID, ids=IDS)
def test_the_best_static_gain_is_that_of_the_local_search(beta, r, a):
    one, found = ScalarSeparation(beta, r, a), best_static_gain(*posed(beta, r, a))
    assert found.cost == pytest.approx(float(one.static_linear), rel=1e-8)
    assert found.F[0, 0] == pytest.approx(float(one.static_gain), abs=1e-4)


@pytest.mark.parametrize(("beta", "r", "a"), GRID, ids=IDS)
def test_no_static_gain_on_a_fine_grid_is_better(beta, r, a):
    one = ScalarSeparation(beta, r, a)
    costs = [float(one.static_cost(gain)) for gain in np.linspace(-1, 1, 4001)]
    assert 0 <= min(costs) - float(one.static_linear) + 1e-14 < 1e-6


def test_a_static_gain_costs_what_its_motions_do():
    one = ScalarSeparation(F(9, 10), F(1, 3))
    summed = simulated_cost(0.9, 1 / 3, 1.5, lambda x: -0.7 * x, (), 300)
    assert float(one.static_cost(F(-7, 10))) == pytest.approx(summed, rel=1e-12)
    assert one.static_cost(F(-1, 10)) == np.inf  # 0.9 (1.5 - 0.1)^2 > 1


def test_a_rational_regulator_gain_stays_exact():
    one = ScalarSeparation(F(1, 2), F(5, 3))
    assert one.static_gain == F(-2, 3)
    assert all(one.static_cost(F(-2, 3) + step) > one.static_linear for step in (F(-1, 10**9), F(1, 10**9)))


def test_the_bound_for_no_input_cost_is_met_by_more_moves_and_the_law_by_any_controller():
    plant, spec = posed(F(9, 10), F(0), F(8, 5))
    one = ScalarSeparation(F(9, 10), 0, F(8, 5))
    assert affine_moves(plant, spec, 12).value == pytest.approx(float(one.dynamic_linear), abs=1e-7)
    assert any_controller(plant, spec).value == pytest.approx(float(one.relu_law), rel=1e-3)


@pytest.mark.parametrize("a", [F(3, 2), F(8, 5)])
def test_separation_ends_at_the_threshold_exactly(a):
    threshold = ScalarSeparation(F(9, 10), 0, a).threshold
    below, at, above = (ScalarSeparation(F(9, 10), threshold + step, a) for step in (-F(1, 10**20), 0, F(1, 10**20)))
    assert below.separated and not at.separated and not above.separated
    assert below.gap > 0 == at.gap > above.gap
    assert "beats them all" in below.statement and "does not separate" in at.statement
    assert all(ScalarSeparation(F(9, 10), threshold * factor, a).gap < 0 for factor in (2, 5, 100))


def test_floats_are_judged_as_the_numbers_that_they_are():
    threshold = float(ScalarSeparation(1.0).threshold)
    truth = [F(r) < F(8, 41) for r in (np.nextafter(threshold, 0), threshold, np.nextafter(threshold, 1))]
    assert [ScalarSeparation(1.0, r).separated for r in (np.nextafter(threshold, 0), threshold,
                                                         np.nextafter(threshold, 1))] == truth
    assert ScalarSeparation(0.9, 0.1).relu_law == pytest.approx(float(ScalarSeparation(F(9, 10), F(1, 10)).relu_law))


def test_the_second_state_adds_the_same_to_every_cost():
    alpha, weight, one = F(-7, 10), F(3, 10), ScalarSeparation(F(9, 10), F(1, 20), F(3, 2), F(-7, 10), F(3, 10))
    plant = Plant(np.diag([1.5, float(alpha)]), [[1.0], [0.0]], [[1.0, 0.0]])
    spec = Spec(np.diag([1.0, float(weight)]), 0.05, 0.9, Box([-1, -1], [1, 1]), Box(-1, 1))
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)
    law = certify(plant, INC.saturated([[-1.5]], 1.0), claim).require().bound
    assert law == pytest.approx(float(one.relu_law), rel=1e-8)
    assert best_static_gain(plant, spec).cost == pytest.approx(float(one.static_linear), rel=1e-7)
    dynamic = affine_moves(plant, spec, 15).value
    assert first_move(plant, spec).value < float(one.dynamic_linear) <= dynamic + 1e-7
    assert one.gap == ScalarSeparation(F(9, 10), F(1, 20)).gap


def test_the_sentence_rounds_to_the_side_where_it_stays_true():
    sentence = ScalarSeparation(F(1, 3)).statement
    law, linear = (F(word.strip(",")) for word in (sentence.split("at most ")[1].split()[0],
                                                   sentence.split("at least ")[1].split()[0]))
    assert F(1, 3) + F(1, 108) < law < F(1, 3) + F(1, 108) + F(1, 10**6)
    assert F(1, 3) + F(1, 36) - F(1, 10**6) < linear < F(1, 3) + F(1, 36)


def test_not_even_a_float_s_rounding_turns_the_sentence_false():
    hair = F(1, 10**20)
    assert "at least 0.3999999 " in ScalarSeparation(F(4, 5) - 12 * hair).statement  # the bound is 0.4 - hair
    assert "at most 0.3600001," in ScalarSeparation(F(24, 25) + 36 * hair).statement  # the cost is 0.36 + hair


@pytest.mark.parametrize(("numbers", "culprit"), [
    ((0,), "discount"), ((F(11, 10),), "discount"), ((np.nan,), "discount"), (("high",), "discount"), ((1, F(-1, 9)), "r ="),
    ((1, 0, 1), "a = 1"), ((1, 0, 1.62), "a = 1.62"), ((1, 0, 1.5, -1), "alpha"), ((1, 0, 1.5, 0.5, -0.1), "weight"),
])
def test_numbers_outside_their_range_are_refused(numbers, culprit):
    with pytest.raises(InvalidInputError, match=culprit):
        ScalarSeparation(*numbers)


def test_the_pole_may_be_as_large_as_two_steps_allow():
    assert ScalarSeparation(1, 0, 1.618).separated
    with pytest.raises(InvalidInputError, match="two steps"):
        ScalarSeparation(1, 0, 1.6181)
    with pytest.raises(InvalidInputError, match="F = "):
        ScalarSeparation(1).static_cost(F(-11, 10))
