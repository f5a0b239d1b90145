"""Convex starts: the LQR cost where nothing is nonlinear, and certificates that the general search confirms."""

import numpy as np
import oracles
import pytest
from bmi_draws import draw

from inc_casadi import Box, LeakyReLU, Logistic, Plant, ReLU, Spec, Tanh, certify
from inc_casadi.errors import DimensionError, InvalidInputError, SolverError
from inc_casadi.linear.regulator import discounted_lqr
from synthesis.starts.lure import saturated_feedback, state_feedback


@pytest.fixture
def stable():
    return draw(3, 2, 3, 5, ReLU(), seed=1)


def lqr_cost(plant, claim):
    _, P = discounted_lqr(plant, Spec(claim.Q, claim.R, claim.discount, claim.initial))
    return float(np.trace(P @ claim.initial.second_moment))


def test_state_feedback_is_the_regulator(stable):
    plant, inc, claim = stable
    K, _ = discounted_lqr(plant, Spec(claim.Q, claim.R, claim.discount, claim.initial))
    assert state_feedback(plant, claim).K @ plant.C == pytest.approx(K, abs=1e-4)


@pytest.mark.parametrize("unit", [ReLU(), Tanh(), LeakyReLU(0.2)])
def test_hidden_units_of_state_feedback_are_certified_at_the_regulators_cost(stable, unit):
    plant, inc, claim = stable
    law = state_feedback(plant, claim, inc.U @ plant.C, unit)
    certificate = certify(plant, law, claim, multiplier="sector")
    assert law.q == 5 and certificate.prove()
    assert certificate.bound == pytest.approx(lqr_cost(plant, claim), rel=1e-4)


def test_state_feedback_stabilizes_an_unstable_plant():
    plant, inc, claim = draw(3, 2, 3, 5, ReLU(), seed=1)
    plant = Plant(1.4 * plant.A, plant.B, plant.C)
    assert certify(plant, state_feedback(plant, claim, inc.U @ plant.C), claim, multiplier="sector").prove()


def test_saturated_feedback_keeps_its_limits_and_is_certified(stable):
    plant, inc, claim = stable
    limits = Box([-0.3, -0.5], [0.3, 0.5])
    law = saturated_feedback(plant, claim, limits)
    assert certify(plant, law, claim, multiplier="sector").prove()
    u = oracles.control(law, 1e6 * np.random.default_rng(0).normal(size=(3, 50)))
    assert np.all(np.abs(u) <= limits.upper[:, None]) and law.q == 2


def test_what_is_not_convex_is_refused(stable):
    plant, inc, claim = stable
    with pytest.raises(InvalidInputError, match="state feedback only"):
        state_feedback(Plant(plant.A, plant.B, plant.C[:2]), claim)
    with pytest.raises(InvalidInputError, match="about 0"):
        saturated_feedback(plant, claim, Box([-0.3, -0.5], [0.3, 0.7]))
    with pytest.raises(InvalidInputError, match="negative"):
        state_feedback(plant, claim, inc.U @ plant.C, Logistic())
    with pytest.raises(SolverError, match="no feedback"):
        saturated_feedback(Plant(1.5 * plant.A, plant.B, plant.C), claim, Box([-1, -1], [1, 1]))
    with pytest.raises(DimensionError):
        state_feedback(plant, claim, np.ones((2, 2)))
