"""The gradient of the certified cost against differences of inequalities solved anew by the general search, and by hand."""

import numpy as np
import pytest
from bmi_draws import along, direction_of, draw, moved

from inc_casadi import INC, DiscountedCost, Gaussian, LeakyReLU, Plant, ReLU, Saturation, Stability, Tanh, certify
from inc_casadi.claims import Together
from inc_casadi.errors import InvalidInputError, NotCertifiedError
from synthesis.certified_cost import certified_cost
from synthesis.law_family import family, flat


def difference(plant, inc, claim, multiplier, direction, step=3e-4):
    ahead, behind = (certify(plant, moved(inc, direction, sign * step), claim, multiplier=multiplier) for sign in (1, -1))
    assert ahead.holds() and behind.holds()
    return (ahead.bound - behind.bound) / (2 * step)


@pytest.mark.parametrize("unit, multiplier, shape", [
    (Tanh(), "sector", (3, 2, 2, 5)), (ReLU(), "slope", (2, 1, 1, 4)), (LeakyReLU(0.3), "relu", (3, 1, 2, 4)),
    (Saturation(), "relu", (2, 1, 1, 3)), (ReLU(), "lifted", (2, 1, 1, 2))])
def test_gradient_is_that_of_the_bound_that_certify_finds(unit, multiplier, shape):
    plant, inc, claim = draw(*shape, unit, 0.1, seed=1)
    cost, direction = certified_cost(plant, inc, claim, multiplier), direction_of(inc)
    assert cost.certificate.holds()
    assert along(cost.gradient, direction) == pytest.approx(difference(plant, inc, claim, multiplier, direction), rel=5e-3)


def test_cost_and_gradient_of_a_linear_law_by_hand():
    a, b, c, q, r, beta, s, k = 0.9, 0.5, 2.0, 1.5, 0.2, 0.95, 3.0, -0.3
    plant, claim = Plant(a, b, c), DiscountedCost(q, r, beta, Gaussian([0.0], [[s]]))
    closed = a + b * k * c
    P = (q + r * (k * c) ** 2) / (1 - beta * closed**2)
    dP = (2 * r * k * c**2 + 2 * beta * P * closed * b * c) / (1 - beta * closed**2)
    found = certified_cost(plant, INC.linear([[k]]), claim)
    assert found.value == pytest.approx(P * s, rel=1e-7)
    assert found.gradient.K.item() == pytest.approx(dP * s, rel=1e-5)


def test_gradient_of_a_biased_law_lets_the_biases_follow():
    plant, inc, claim = draw(3, 1, 2, 4, Tanh(), 0.05, seed=1)
    b = np.array([0.3, -0.2, 0.1, 0.4])
    biased = INC(inc.W, inc.U, inc.V, inc.K, b, activation=Tanh())
    biased = INC(inc.W, inc.U, inc.V, inc.K, b, -inc.V @ biased.hidden(np.zeros(2)), Tanh())
    laws = family(plant, biased)
    direction = np.random.default_rng(2).normal(size=flat(inc).size)
    bounds = [certify(plant, laws.inc(laws.theta + step * direction), claim, multiplier="sector").bound
              for step in (3e-4, -3e-4)]
    slope = certified_cost(plant, biased, claim).slope @ direction
    assert slope == pytest.approx((bounds[0] - bounds[1]) / 6e-4, rel=1e-3)


def test_bound_is_no_looser_than_that_of_certify():
    plant, inc, claim = draw(3, 2, 2, 5, ReLU(), seed=1)
    for multiplier in ("sector", "slope", "relu"):
        known = certify(plant, inc, claim, multiplier=multiplier).bound
        assert certified_cost(plant, inc, claim, multiplier).certificate.bound <= known * (1 + 1e-6)


def test_together_with_a_rate_costs_more():
    plant, inc, claim = draw(2, 1, 1, 3, ReLU(), seed=1)
    both = Together((claim, Stability(0.905)))
    found, direction = certified_cost(plant, inc, both), direction_of(inc)
    assert found.value > certified_cost(plant, inc, claim).value * (1 + 1e-4)
    assert along(found.gradient, direction) == pytest.approx(difference(plant, inc, both, "sector", direction), rel=5e-3)


def test_a_law_without_certificate_is_refused():
    plant, inc, claim = draw(2, 1, 1, 3, ReLU(), size=30.0)
    with pytest.raises(NotCertifiedError):
        certified_cost(plant, inc, claim)


def test_claims_without_a_cost_are_refused():
    plant, inc, _ = draw(2, 1, 1, 3, ReLU())
    with pytest.raises(InvalidInputError, match="minimizes nothing"):
        certified_cost(plant, inc, Stability(0.99))
    with pytest.raises(InvalidInputError, match="name the rate"):
        certified_cost(plant, inc, Stability())
