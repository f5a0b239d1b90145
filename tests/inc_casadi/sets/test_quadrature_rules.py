"""Every rule integrates every monomial of degree 2 order - 1 exactly, and not always the next one."""

from itertools import product
from math import factorial, gamma, pi, prod

import numpy as np
import pytest

from inc_casadi.errors import InvalidInputError
from inc_casadi.sets import rules


def exponents(n, degree):
    return [powers for powers in product(range(degree + 1), repeat=n) if sum(powers) <= degree]


def cube_mean(powers):
    return prod(0.0 if k % 2 else 1 / (k + 1) for k in powers)


def normal_mean(powers):
    return prod(0.0 if k % 2 else factorial(k) / (2 ** (k // 2) * factorial(k // 2)) for k in powers)


def simplex_mean(powers):
    return factorial(len(powers)) * prod(map(factorial, powers)) / factorial(len(powers) + sum(powers))


def ball_mean(powers):
    if any(k % 2 for k in powers):
        return 0.0
    n = len(powers)
    moments = prod(gamma((k + 1) / 2) for k in powers) / gamma((n + sum(powers)) / 2 + 1)
    return moments * gamma(n / 2 + 1) / pi ** (n / 2)


def sphere_mean(powers):
    return ball_mean(powers) * (len(powers) + sum(powers)) / len(powers)


RULES = {
    "cube": (lambda n, order: rules.tensor([rules.legendre(order)] * n), cube_mean),
    "normal": (lambda n, order: rules.tensor([rules.hermite(order)] * n), normal_mean),
    "simplex": (lambda n, order: (rules.simplex(n, order)[0][:n], rules.simplex(n, order)[1]), simplex_mean),
    "ball": (rules.ball, ball_mean),
    "sphere": (rules.sphere, sphere_mean),
}


def value(nodes, weights, powers):
    return float(weights @ np.prod(nodes ** np.array(powers)[:, None], axis=0))


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize(("n", "order"), [(1, 1), (1, 4), (2, 1), (2, 3), (2, 4), (3, 2), (3, 3), (4, 2), (5, 2)])
def test_exact_to_degree_twice_the_order_less_one(name, n, order):
    rule, mean = RULES[name]
    nodes, weights = rule(n, order)
    assert weights.sum() == pytest.approx(1.0) and np.all(weights > 0)
    for powers in exponents(n, 2 * order - 1):
        assert value(nodes, weights, powers) == pytest.approx(mean(powers), rel=1e-11, abs=1e-13), powers


@pytest.mark.parametrize(("name", "powers"), [
    ("cube", (6, 0)), ("normal", (0, 6)), ("simplex", (6, 0)), ("ball", (6, 0)), ("sphere", (6, 0)),
])
def test_the_degree_is_not_understated_by_much(name, powers):
    rule, mean = RULES[name]
    assert value(*rule(2, 3), powers) != pytest.approx(mean(powers), rel=1e-6)


def test_the_nodes_stay_inside():
    assert np.all(rules.simplex(3, 4)[0] > 0) and np.allclose(rules.simplex(3, 4)[0].sum(axis=0), 1)
    assert np.all(np.linalg.norm(rules.ball(3, 4)[0], axis=0) < 1)
    np.testing.assert_allclose(np.linalg.norm(rules.sphere(4, 3)[0], axis=0), 1)


def test_the_number_of_nodes():
    assert rules.ball(2, 5)[0].shape == (2, 3 * 10)
    assert rules.ball(4, 3)[0].shape == (4, 2 * 6 * 3 * 3)
    assert rules.simplex(3, 2)[0].shape == (4, 8)


@pytest.mark.parametrize("order", [0, -1, 2.5, "3", None, np.nan])
@pytest.mark.parametrize("name", RULES)
def test_a_bad_order_is_refused(name, order):
    with pytest.raises(InvalidInputError, match="order"):
        RULES[name][0](2, order)


def test_a_huge_product_is_refused_before_it_is_built():
    for rule in (rules.ball, rules.sphere, rules.simplex):
        with pytest.raises(InvalidInputError, match="too large"):
            rule(30, 10)
