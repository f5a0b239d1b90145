"""Convex hulls: the largest interval of one state, two inputs, biases, limits on parts of the input, and continuous time."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from attraction_draws import TWO_STATES, falls, lqr, rim, unstable

from inc_casadi import INC, Box, Plant, ReLU, Saturation
from inc_casadi.claims import Attraction
from inc_casadi.local.certify import certify_attraction


def hull(plant, inc, claim=None):
    return certify_attraction(plant, inc, claim or Attraction(), "convex hull")


@pytest.mark.parametrize("gain", [-0.6, -1.2, -2.4])
def test_one_state_reaches_the_last_point_that_can_be_steered(gain):
    # |u| <= 1 holds x+ = 1.5 x + u back for |x| < 2 and no further; the saturated law does from all of it.
    found = hull(Plant([[1.5]], [[1.0]]), INC.saturated([[gain]], 1.0))
    assert 4 * (1 - 1e-4) < found.volume < 4.0


def test_one_state_in_continuous_time():
    found = hull(Plant([[1.0]], [[1.0]], dt=0.0), INC.saturated([[-3.0]], 1.0))
    assert 2 * (1 - 1e-4) < found.volume < 2.0


def test_a_biased_law_counts_from_its_own_equilibrium():
    # x+ = 1.5 x + sat(-x + 1/4) rests where x/2 = x - 1/4, at x* = 1/2 with z* = -1/4.
    inc = INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], b=[0.25], activation=Saturation())
    found = hull(Plant([[1.5]], [[1.0]]), inc)
    assert found.ellipsoid.center.tolist() == [0.5]
    # The interval that can be steered is (-2, 2), so 1.5 is left on the nearer side.
    assert 2 * 1.5 * (1 - 1e-4) < found.volume < 2 * 1.5


def test_units_that_rest_saturated_or_have_two_other_slopes_take_part():
    inc = INC(np.zeros((2, 2)), [[-1.0], [0.5]], [[1.0, 0.05]], [[0.0]], b=[0.0, -1.0], activation=(Saturation(), ReLU()))
    found = hull(Plant([[1.5]], [[1.0]]), inc)
    assert found.holds() and found.prove("exact") and found.volume > 3.0


def test_two_inputs_beat_one_weight_for_each():
    rng = np.random.default_rng(5)
    plant = unstable(rng)
    law = INC.saturated(lqr(plant), [0.5, 2.0])
    found, weaker = hull(plant, law), certify_attraction(plant, law, Attraction(), "dead zone")
    assert found.holds() and weaker.holds()
    assert found.volume > weaker.volume * (1 - 1e-4)
    x, _ = oracles.roll_out(plant, law, rim(found.ellipsoid, 300, rng, 0.9999), 60)
    V = oracles.quadratic(found.values["P"], x)
    assert falls(V)


def test_a_limit_tighter_than_the_saturation_is_kept_by_every_mixture():
    rng = np.random.default_rng(6)
    law, limits = INC.saturated(lqr(TWO_STATES), 1.0), Box([-0.7], [0.9])
    found = hull(TWO_STATES, law, Attraction(limits, states=Box([-1.0, -2.0], [1.0, 2.0])))
    assert found.holds() and found.volume < hull(TWO_STATES, law).volume
    x, u = oracles.roll_out(TWO_STATES, law, rim(found.ellipsoid, 400, rng), 40)
    assert np.all(np.abs(u) <= 0.7) and np.max(np.abs(u)) > 0.69
    assert np.all(np.abs(x[0]) <= 1.0) and np.all(np.abs(x[1]) <= 2.0)


def test_what_it_is_not_written_for_is_refused():
    W = INC([[0.5]], [[1.0]], [[-1.0]], [[0.0]], activation=Saturation())
    assert "W = 0" in hull(Plant([[1.5]], [[1.0]]), W).reason
    many = INC(np.zeros((9, 9)), np.ones((9, 1)), np.ones((1, 9)), [[0.0]], activation=Saturation())
    assert "2^9" in hull(Plant([[1.5]], [[1.0]]), many).reason
