"""thm:incremental_certificate: the same inequalities, about the equilibrium of a biased loop, on deviations from it."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, DeviationCost, Gaussian, Logistic, Plant, ReLU, Saturation, Stability, Tanh, certify

ROOM = 1 + 1e-9
UNITS = (ReLU(), Logistic(), Tanh(), Saturation(), ReLU())


def biased_loop(seed=31):
    rng = np.random.default_rng(seed)
    plant, inc = draws.plant(rng), draws.controller(rng, units=UNITS, gain=0.04, bias=1.0)
    rest = oracles.roll_out(plant, inc, np.zeros((plant.n, 1)), 400)[0][:, 0, -1]
    return plant, inc, rest, rng


def test_the_deviations_shrink_at_the_certified_rate():
    plant, inc, rest, rng = biased_loop()
    assert np.linalg.norm(rest) > 0.1  # the equilibrium is not the origin
    certificate = certify(plant, inc, Stability(0.9)).require()
    x, _ = oracles.roll_out(plant, inc, rest[:, None] + draws.points(rng, plant.n, 200), 25)
    V = oracles.quadratic(certificate.values["P"], x - rest[:, None, None])
    assert np.all(V[:, 1:] <= 0.81 * V[:, :-1] * ROOM + 1e-18)


def test_the_cost_of_deviations_is_bounded():
    plant, inc, rest, rng = biased_loop()
    Q, R = np.diag([1.0, 0.0, 2.0]), np.diag([0.3, 0.1])
    start = Gaussian([0.5, -1.0, 0.2], np.diag([1.0, 2.0, 0.5]))
    claim = DeviationCost(Q, R, 0.95, start)
    certificate = certify(plant, inc, claim, multiplier="sector").require()
    np.testing.assert_allclose(claim.at_rest(plant, inc), rest, atol=1e-8)
    x, u = oracles.roll_out(plant, inc, rest[:, None] + draws.points(rng, plant.n, 200), 150)
    u_rest = oracles.control(inc, plant.C @ rest[:, None])
    paid = oracles.discounted_cost(x - rest[:, None, None], u - u_rest[..., None], Q, R, 0.95)
    assert np.all(paid <= oracles.quadratic(certificate.values["P"], x[..., 0] - rest[:, None]) * ROOM + 1e-12)
    # eq:incremental_cost_bound in expectation: tr(P Sigma0) + (mu0 - x*)'P (mu0 - x*).
    P, away = certificate.values["P"], start.mean - rest
    assert certificate.bound == pytest.approx(np.trace(P @ np.diag([1.0, 2.0, 0.5])) + away @ P @ away, rel=1e-6)


def test_a_bias_that_only_shifts_the_loop_changes_no_deviation():
    # u = sat(K (x - x*)) + u* rests at x*; its deviations are those of u = sat(K x), so both have one deviation cost.
    plant, K, rest, hold = Plant(0.9, 1.0), -0.5, 2.0, 0.2  # x* = 0.9 x* + u*
    shifted = INC([[0.0]], [[K]], [[1.0]], [[0.0]], b=[-K * rest], d=[hold], activation=Saturation())
    plain = INC([[0.0]], [[K]], [[1.0]], [[0.0]], activation=Saturation())
    claims = [DeviationCost(1.0, 0.1, 1.0, Gaussian([mean], [[1.0]])) for mean in (rest, 0.0)]
    costs = [certify(plant, law, claim, multiplier="sector").require().bound
             for law, claim in zip((shifted, plain), claims, strict=True)]
    assert costs[0] == pytest.approx(costs[1], rel=1e-6)


def test_deviations_need_slopes_where_the_origin_needs_sectors():
    # x+ = -0.5 x + v tanh(x + b) with v = 1.4: slope at the rest up to 0.9, fine; v = 1.6 reaches slope 1.1 near z = 0.
    def law(v):
        return INC([[0.0]], [[1.0]], [[v]], [[0.0]], b=[0.3], activation=Tanh())
    assert certify(Plant(-0.5, 1.0), law(1.4), Stability(0.9999)).holds()
    refused = certify(Plant(-0.5, 1.0), law(1.6), Stability(0.9999))
    assert not refused.holds()
