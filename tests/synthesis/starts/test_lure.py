"""Convex starts: the LQR cost where nothing is nonlinear, and certificates that the general search confirms."""

import numpy as np
import oracles
import pytest
from bmi_draws import draw

from benchmarks.plants.oscillators import masses
from inc_casadi import Box, DiscountedCost, LeakyReLU, Logistic, Plant, ReLU, Spec, Tanh, certify
from inc_casadi.errors import DimensionError, InfeasibleError, InvalidInputError, SolverError
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
    with pytest.raises(InfeasibleError, match="the open loop costs without end"):
        saturated_feedback(Plant(1.5 * plant.A, plant.B, plant.C), claim, Box([-1, -1], [1, 1]))
    with pytest.raises(DimensionError):
        state_feedback(plant, claim, np.ones((2, 2)))


def test_an_unstable_plant_is_refused_just_where_its_open_loop_costs_without_end():
    """x+ = a x with discount b costs x^2 / (1 - b a^2): finite up to a = b^-1/2, where a bounded input may be certified."""
    def law(a):
        claim = DiscountedCost([[1.0]], [[1.0]], 0.81, Box([-1.0], [1.0]))
        return certify(Plant([[a]], [[1.0]]), saturated_feedback(Plant([[a]], [[1.0]]), claim, Box([-1.0], [1.0])), claim)

    assert law(1.1).holds()
    with pytest.raises(InfeasibleError, match="spectral radius 1.0008, not below 1"):
        law(1.112)


@pytest.mark.slow
def test_six_masses_have_a_certified_start_whatever_the_units_of_their_states():
    case = masses(6)
    for decades in (0.0, 3.0):
        T, back = (np.diag(10.0 ** (sign * np.linspace(-decades, decades, 12))) for sign in (1, -1))
        plant = Plant(T @ case.plant.A @ back, T @ case.plant.B, dt=case.plant.dt)
        box = Box(T @ case.spec.initial.support.lower, T @ case.spec.initial.support.upper)
        claim = DiscountedCost(back.T @ case.spec.Q @ back, case.spec.R, case.spec.discount, box)
        certificate = certify(plant, saturated_feedback(plant, claim, case.spec.inputs), claim, multiplier="sector")
        assert certificate.holds() and certificate.bound == pytest.approx(42.55, rel=1e-3)


def test_a_solver_that_gives_up_is_named_in_our_words(stable, monkeypatch):
    import cvxpy

    def gives_up(*_, **__):
        raise cvxpy.error.SolverError("Solver 'CLARABEL' failed. Try another solver, or solve with verbose=True")

    monkeypatch.setattr(cvxpy.Problem, "solve", gives_up)
    plant, _, claim = stable
    with pytest.raises(SolverError, match="gave up on a program of 11 rows for numerical reasons") as error:
        state_feedback(plant, claim)
    assert "Try another solver" not in str(error.value)
