"""The cost claim in continuous time: its condition by hand, trajectories, Lyapunov equations; its readings stand beside."""

from dataclasses import replace
from fractions import Fraction

import draws
import numpy as np
import oracles
import pytest
from scipy.linalg import solve_continuous_lyapunov

from inc_casadi import INC, Box, Gaussian, LeakyReLU, Plant, ReLU, Saturation, Tanh, certify, close_loop
from inc_casadi.claims import DeviationCost, DiscountedCost, Stability, Together
from inc_casadi.claims.performance import decay

SPRING = Plant([[0.0, 1.0], [-1.0, -0.3]], [[0.0], [1.0]], dt=0)
CLAIM = DiscountedCost(np.diag([1.0, 0.3]), [[0.1]], 0.8, Box([-1.0, -1.0], [1.0, 2.0]))


def integral(plant, inc, claim, x0, duration=10.0, steps=150):
    """The discounted integral of x'Qx + u'Ru from each x0, by Simpson's rule on a Runge-Kutta motion."""
    x = oracles.flow(plant, inc, x0, duration, steps)
    u = np.stack([oracles.control(inc, plant.C @ x[..., k]) for k in range(steps + 1)], axis=-1)
    rate = np.einsum("int,ij,jnt->nt", x, claim.Q, x) + np.einsum("int,ij,jnt->nt", u, claim.R, u)
    t = np.linspace(0.0, duration, steps + 1)
    weights = np.where(np.arange(steps + 1) % 2 == 1, 4.0, 2.0)
    weights[[0, -1]] = 1.0
    return (rate * claim.discount**t) @ weights * (duration / steps / 3)


def test_condition_by_hand():
    # dx/dt = 0.6 x - 0.3 eta, u = 0.1 x - 0.3 eta; P = 2, Q = 3, R = 4, gamma = log 2.
    loop = close_loop(Plant([[0.5]], [[1.0]], dt=0), INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU()))
    claim = DiscountedCost([[3.0]], [[4.0]], 0.5, Box([-1.0], [1.0]))
    M = np.diag([0.2, 0.5])
    found = claim.conditions({"decrease": loop}, {"P": np.array([[2.0]])}, {"decrease": M})
    corner = 0.6 + 0.12
    np.testing.assert_allclose(found["decrease"], [[2 * np.log(2) - 2.4 - 3 - 0.04 - 0.2, corner], [corner, -0.36 - 0.5]])
    np.testing.assert_array_equal(found["P"], [[2.0]])


@pytest.mark.parametrize("discount", [1.0, 0.6])
def test_a_linear_loop_reaches_its_lyapunov_equation(discount):
    claim = replace(CLAIM, discount=discount)
    inc = INC.linear([[-0.4, -0.9]])
    F = SPRING.A + SPRING.B @ inc.K + np.log(discount) / 2 * np.eye(2)
    P = solve_continuous_lyapunov(F.T, -(claim.Q + inc.K.T @ claim.R @ inc.K))
    found = certify(SPRING, inc, claim).require()
    expected = np.trace(P @ claim.initial.second_moment)
    assert expected <= found.bound <= expected * (1 + 1e-7)
    assert found.prove("exact")


def test_an_unstable_loop_has_a_finite_cost_if_the_discount_outruns_it():
    plant, claim = Plant([[0.2]], [[1.0]], dt=0), DiscountedCost([[1.0]], [[0.0]], 0.5, Box([-1.0], [1.0]))
    found = certify(plant, INC.linear([[0.0]]), claim).require()
    assert found.bound == pytest.approx(1 / 3 / (np.log(2) - 0.4), rel=1e-7)  # int exp((0.4 - log 2) t) dt
    assert not certify(plant, INC.linear([[0.0]]), replace(claim, discount=0.7)).holds()  # log 0.7 = -0.357


@pytest.mark.parametrize(("unit", "multiplier", "discount"), [
    (ReLU(), "relu", 1.0), (Tanh(), "slope", 0.8), (LeakyReLU(0.2), "relu", 0.8), (Saturation(), "sector", 1.0)])
def test_no_motion_costs_more_than_its_bound(unit, multiplier, discount):
    rng = np.random.default_rng(5)
    plant = draws.plant(rng, n=2, m=1, p=2, dt=0.0)
    inc = draws.controller(rng, m=1, p=2, units=(unit, unit, unit), gain=0.6)
    claim = replace(CLAIM, discount=discount)
    found = certify(plant, inc, claim, multiplier=multiplier).require()
    assert found.prove()
    x0 = draws.points(rng, 2, 20)
    paid = integral(plant, inc, claim, x0)
    promised = oracles.quadratic(found.values["P"], x0)
    assert np.all(paid <= promised * (1 + 1e-6)) and np.max(paid[1:] / promised[1:]) > 0.8


@pytest.mark.parametrize("discount", [1.0, 1.0 - 2.0**-53, 1.0 - 1e-9, 0.9, 0.5, 1e-3, 1e-300])
def test_the_rate_in_use_is_never_above_the_true_one(discount):
    # -log(1 - e) = e + e^2 / 2 + ... in fractions, after square roots would round: by its series, for e < 1/2; and
    # exp(-gamma) >= discount in extended precision else.
    gamma = decay(discount)
    e = 1 - Fraction(discount)
    if 0 < e < Fraction(1, 4):
        below = sum(e**k / k for k in range(1, 60))
        assert gamma <= below and float(below) * (1 - 2e-15) <= gamma
    else:
        true = -np.log(np.longdouble(discount))
        assert gamma <= true and (true == 0 or gamma >= true * (1 - 2e-15))


def test_a_corrupted_certificate_is_refused():
    found = certify(SPRING, INC.saturated([[-0.4, -0.5]], 1.0), CLAIM).require()
    assert found.prove("exact")
    low = replace(found, values={**found.values, "P": 0.98 * found.values["P"]})
    assert not low.holds() and not low.prove("exact")
    patient = replace(found, claim=replace(CLAIM, discount=0.81))
    assert not patient.holds() and not patient.prove()


def test_the_lifted_multiplier_is_refused_with_its_reason():
    inc = INC([[0.0]], [[1.0, 0.5]], [[-0.2]], [[0.0, 0.0]], activation=ReLU())
    found = certify(SPRING, inc, CLAIM, multiplier="lifted")
    assert not found.holds() and "needs discrete time" in found.reason


def test_together_with_a_rate():
    inc = INC.saturated([[-0.4, -0.5]], 1.0)
    both = certify(SPRING, inc, Together((Stability(0.05), CLAIM))).require()
    assert both.prove() and both.bound >= certify(SPRING, inc, CLAIM).bound * (1 - 1e-7)


def test_deviations_from_a_moved_equilibrium():
    # dx/dt = -x + relu(-0.5 x + 1): x* = 2/3, u* = 2/3; from x0 > 2 the unit is off and u = 0.
    plant, inc = Plant([[-1.0]], [[1.0]], dt=0), INC([[0.0]], [[-0.5]], [[1.0]], [[0.0]], b=[1.0])
    claim = DeviationCost([[1.0]], [[0.2]], 0.9, Gaussian([1.0], [[0.5]]))
    found = certify(plant, inc, claim).require()
    assert found.prove() and claim.at_rest(plant, inc) == pytest.approx([2 / 3])
    x0 = np.linspace(-4.0, 6.0, 21)[None]
    x = oracles.flow(plant, inc, x0, 15.0, 300)
    u = np.stack([oracles.control(inc, x[..., k]) for k in range(301)], axis=-1)
    rate = ((x - 2 / 3) ** 2 + 0.2 * (u - 2 / 3) ** 2)[0] * 0.9 ** np.linspace(0, 15, 301)
    paid = np.trapezoid(rate, dx=0.05)
    assert np.all(paid <= found.values["P"].item() * (x0[0] - 2 / 3) ** 2 * (1 + 1e-3) + 1e-12)
    assert "deviations from the equilibrium x* = (0.666667)" in found.sentence
