"""thm:performance: x0'P x0 bounds the discounted cost of every motion, and tr(P S0) its expectation."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, DiscountedCost, Gaussian, LeakyReLU, Plant, ReLU, Uniform, certify
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.sets import Box

ROOM = 1 + 1e-9


@pytest.mark.parametrize(("discount", "r"), [(1.0, 0.0), (0.9, 0.3), (0.5, 2.0)])
def test_for_a_linear_law_the_bound_is_the_cost(discount, r):
    # x+ = a x, u = k x: sum of (1 + r k^2) a^(2k) discount^k, a geometric series.
    a, k = 0.4, -0.8
    claim = DiscountedCost(1.0, r, discount, Gaussian([0.0], [[2.0]]))
    certificate = certify(Plant(a - k, 1.0), INC.linear([[k]]), claim).require()
    assert certificate.bound == pytest.approx(2 * (1 + r * k**2) / (1 - discount * a**2), rel=1e-5)
    assert certificate.bound >= 2 * (1 + r * k**2) / (1 - discount * a**2)


def test_on_both_half_lines_the_worse_one_decides():
    # x+ = 0.5 x for x < 0 and 0.8 x for x > 0: P = 1 / (1 - 0.64), which no smaller P can be.
    inc, claim = INC([[0.0]], [[1.0]], [[0.3]], [[0.0]], activation=ReLU()), DiscountedCost(1.0, 0.0, 1.0, Box(-1, 1))
    plant = Plant(0.5, 1.0)
    found = certify(plant, inc, claim, multiplier="relu").require()
    assert found.values["P"].item() == pytest.approx(1 / 0.36, rel=1e-5)
    paid = oracles.discounted_cost(*oracles.roll_out(plant, inc, np.array([[-1.0, 1.0]]), 300), claim.Q, claim.R, 1.0)
    np.testing.assert_allclose(paid, [1 / 0.75, 1 / 0.36], rtol=1e-9)


def test_a_p_below_the_cost_is_refused_with_any_multiplier():
    inc, claim = INC([[0.0]], [[1.0]], [[0.3]], [[0.0]], activation=ReLU()), DiscountedCost(1.0, 0.0, 1.0, Box(-1, 1))
    for Lambda in np.linspace(0, 3, 31):
        values = {"P": [[2.7]], "Lambda": [Lambda]}  # the motion from x0 = 1 costs 1 / 0.36 = 2.78
        assert not MatrixCertificate(Plant(0.5, 1.0), inc, claim, "sector", values).holds()


def test_the_mean_counts_as_the_covariance_does():
    # tr(P S0) = tr(P Sigma0) + mu0'P mu0, here P = 1 / (1 - 0.25): mean 3, variance 2 cost 11 P.
    claim = DiscountedCost(1.0, 0.0, 1.0, Gaussian([3.0], [[2.0]]))
    assert certify(Plant(0.5, 1.0), INC.linear([[0.0]]), claim).bound == pytest.approx(11 / 0.75, rel=1e-5)
    uniform = DiscountedCost(1.0, 0.0, 1.0, Uniform(Box([1.0], [5.0])))  # mean 3, variance 16 / 12
    assert certify(Plant(0.5, 1.0), INC.linear([[0.0]]), uniform).bound == pytest.approx((9 + 16 / 12) / 0.75, rel=1e-5)


def test_with_discount_a_growing_motion_may_have_a_bounded_cost():
    # a = 1.2, discount 0.5: the state grows, the cost is 1 / (1 - 0.5 * 1.44). Stability is another claim.
    claim = DiscountedCost(1.0, 0.0, 0.5, Gaussian([0.0], [[1.0]]))
    assert certify(Plant(1.2, 1.0), INC.linear([[0.0]]), claim).require().bound == pytest.approx(1 / 0.28, rel=1e-5)


def test_the_bound_is_only_sufficient():
    # sec:numerics_implicit: the sector multiplier certifies 1.3006, while no motion costs more than 1.0745 x0^2.
    plant = Plant(1.2, 1.0)
    inc = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]],
              activation=LeakyReLU(0.5))
    claim = DiscountedCost(1.0, 0.05, 0.98, Box(-1, 1))
    x0 = np.linspace(-3, 3, 60)[None]
    paid = oracles.discounted_cost(*oracles.roll_out(plant, inc, x0, 300), claim.Q, claim.R, claim.discount)
    sector = certify(plant, inc, claim, multiplier="sector").require()
    assert np.max(paid / x0[0] ** 2) == pytest.approx(1.0744, abs=1e-4)
    assert sector.values["P"].item() == pytest.approx(1.3006, abs=2e-4)
    assert np.all(paid <= sector.values["P"].item() * x0[0] ** 2 * ROOM)
