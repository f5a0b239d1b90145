"""The cost claim: its condition by hand, its bound, and when a bias stands in its way."""

from dataclasses import replace

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Empirical, Gaussian, LeakyReLU, Plant, ReLU, Saturation, Tanh, Uniform, certify, close_loop
from inc_casadi.blocks import exact
from inc_casadi.claims import DiscountedCost
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.multipliers import Lifted
from inc_casadi.readings import Rational, Rounded

PLANT = Plant([[0.5]], [[1.0]])
BOX = Box([-1.0], [1.0])


def test_condition_by_hand():
    # x+ = 0.6 x - 0.3 eta, u = 0.1 x - 0.3 eta; P = 2, Q = 3, R = 4, discount 0.5.
    loop = close_loop(PLANT, INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU()))
    claim = DiscountedCost([[3.0]], [[4.0]], 0.5, BOX)
    conditions = claim.conditions({"decrease": loop}, {"P": np.array([[2.0]])}, {"decrease": np.zeros((2, 2))})
    corner = 0.5 * 2 * 0.18 + 4 * 0.03
    np.testing.assert_allclose(conditions["decrease"], [[2 - 0.36 - 3 - 0.04, corner], [corner, -0.09 - 0.36]])


@pytest.mark.parametrize(("initial", "moment"), [
    (Box([-1.0, 0.0], [3.0, 2.0]), [[1 + 4 / 3, 1.0], [1.0, 1 + 1 / 3]]),
    (Gaussian([1.0, 2.0], [[2.0, 0.5], [0.5, 1.0]]), [[3.0, 2.5], [2.5, 5.0]]),
    (Empirical([[1.0], [-2.0]]), [[1.0, -2.0], [-2.0, 4.0]]),
])
def test_bound_is_the_expectation_of_the_quadratic(initial, moment):
    loop = close_loop(Plant(0.5 * np.eye(2), np.ones((2, 1))), INC.linear(np.zeros((1, 2))))
    P = np.array([[2.0, -0.3], [-0.3, 5.0]])
    claim = DiscountedCost(np.eye(2), [[1.0]], 0.9, initial)
    assert claim.bound(loop, {"P": P}) == pytest.approx(np.trace(P @ np.array(moment)))
    assert isinstance(claim.initial, Uniform | Gaussian | Empirical)


@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_fractions_rounding_cvxpy_and_casadi_read_the_same(dt):
    import casadi as ca
    import cvxpy as cp
    rng = np.random.default_rng(31)
    loop = close_loop(draws.plant(rng, dt=dt), draws.controller(rng))
    n, m, size = loop.n, loop.plant.m, loop.n + loop.q
    claim = DiscountedCost(np.diag([1.0, 2.0, 0.3]), np.diag([0.1, 0.7]), 0.9, Box(-np.ones(n), np.ones(n)))
    P, M = rng.normal(size=(n, n)), rng.normal(size=(size, size))
    P, M = P + P.T, M + M.T

    def decrease(loop, P, M):
        return claim.conditions({"decrease": loop}, {"P": P}, {"decrease": M})["decrease"]

    expected = decrease(loop, P, M)
    for fractions in (decrease(loop.read(Rational), Rational.lift(P), Rational.lift(M)).fractions(),
                      decrease(replace(loop, F=exact(loop.F), G=exact(loop.G), X=exact(loop.X)), exact(P), exact(M))):
        assert {type(entry).__name__ for entry in fractions.flat} == {"Fraction"}
        np.testing.assert_allclose(fractions.astype(float), expected, atol=1e-12)
    rounded = decrease(loop.read(Rounded), Rounded.lift(P), Rounded.lift(M))
    assert np.all(np.abs(rounded.value - expected) <= 2 * rounded.error) and np.all(rounded.error < 1e-12)
    np.testing.assert_allclose(decrease(loop, cp.Constant(P), M).value, expected, atol=1e-12)
    F, G = ca.SX.sym("F", n, size), ca.SX.sym("G", m, size)
    read = decrease(replace(loop, F=F, G=G), P, M)
    np.testing.assert_allclose(ca.Function("c", [F, G], [read])(loop.F, loop.G).full(), expected, atol=1e-12)
    # CasADi's derivative of an entry with respect to an entry of F, against a central difference.
    slope = ca.Function("d", [F, G], [ca.jacobian(read[0, 1], F[2, 1])])(loop.F, loop.G).full().item()
    step = np.zeros_like(loop.F)
    step[2, 1] = 1e-5
    high, low = (decrease(replace(loop, F=loop.F + sign * step), P, M)[0, 1] for sign in (1, -1))
    assert slope == pytest.approx((high - low) / 2e-5, rel=1e-7)


def test_refusals_at_the_door():
    with pytest.raises(DimensionError, match="Q is 1 x 1, but initial is a distribution in R\\^2"):
        DiscountedCost([[1.0]], [[1.0]], 0.9, Box([-1, -1], [1, 1]))
    with pytest.raises(InvalidInputError, match="discount = 1.1"):
        DiscountedCost([[1.0]], [[1.0]], 1.1, BOX)
    with pytest.raises(InvalidInputError, match="positive semidefinite"):
        DiscountedCost([[-1.0]], [[1.0]], 0.9, BOX)
    claim = DiscountedCost([[1.0]], [[1.0]], 0.9, BOX)
    with pytest.raises(DimensionError, match="but the plant has 1 states and 2 inputs"):
        claim.check(Plant([[0.5]], [[1.0, 2.0]]), INC.linear([[0.0], [0.0]]))


def saturation_of_relus(gain=1.5, d=1.0):
    """The saturation of app:saturation_relu: u = 1 - relu(1.5 x + 1) + relu(1.5 x - 1)."""
    return INC(np.zeros((2, 2)), [[gain], [gain]], [[-1.0, 1.0]], [[0.0]], b=[1.0, -1.0], d=[d])


def test_a_bias_that_leaves_the_origin_at_rest_is_no_obstacle():
    for discount in (0.9, 1.0):
        claim = DiscountedCost([[1.0]], [[1.0]], discount, BOX)
        assert claim.obstacle(PLANT, saturation_of_relus()) is None
        assert claim.obstacle(PLANT, saturation_of_relus(), exactly=True) is None


def test_a_bias_that_moves_the_equilibrium_is_one():
    claim = DiscountedCost([[1.0]], [[1.0]], 0.9, BOX)
    reason = claim.obstacle(PLANT, saturation_of_relus(d=1.25))
    assert "|u| = 0.25 at x = 0" in reason and "equilibrium x*" in reason


def test_an_offset_of_rounding_size_counts_exactly_and_without_discount():
    nearly = saturation_of_relus(d=1.0 + 2.0**-50)
    assert DiscountedCost([[1.0]], [[1.0]], 0.9, BOX).obstacle(PLANT, nearly) is None
    assert DiscountedCost([[1.0]], [[1.0]], 0.9, BOX).obstacle(PLANT, nearly, exactly=True) is not None
    assert DiscountedCost([[1.0]], [[1.0]], 1.0, BOX).obstacle(PLANT, nearly) is not None


def test_a_unit_that_is_not_piecewise_affine_cannot_be_verified_exactly():
    inc = INC(np.zeros((2, 2)), [[1.0], [1.0]], [[-1.0, 1.0]], [[0.0]], b=[0.5, 0.5], activation=(Tanh(), Tanh()))
    claim = DiscountedCost([[1.0]], [[1.0]], 0.9, BOX)
    assert claim.obstacle(PLANT, inc) is None
    assert "not piecewise affine" in claim.obstacle(PLANT, inc, exactly=True)
    assert claim.obstacle(PLANT, INC.saturated([[-1.0]], 0.5), exactly=True) is None
    assert Saturation().pieces is not None


def test_lifted_conditions_by_hand():
    # V = v'P v with v = (x, eta_0) is bounded by x'P_0 x, and P_0 gives the figure.
    loop = close_loop(PLANT, INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU()))
    claim = DiscountedCost([[3.0]], [[4.0]], 0.5, BOX)
    graphs = claim.graphs(loop, Lifted())
    assert set(graphs) == {"decrease", "positive", "initial"}
    P, P_0 = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([[6.0]])
    M = {"decrease": np.diag([0.1, 0.2, 0.3]), "positive": np.diag([0.4, 0.5]), "initial": np.diag([0.6, 0.7])}
    found = claim.conditions(graphs, {"P": P, "P_0": P_0}, M)
    ahead, now = np.array([[0.6, -0.3, 0.0], [0.0, 0.0, 1.0]]), np.eye(2, 3)
    u = np.array([[0.1, -0.3, 0.0]])
    stage = np.diag([3.0, 0.0, 0.0]) + 4.0 * u.T @ u
    np.testing.assert_allclose(found["decrease"], now.T @ P @ now - 0.5 * ahead.T @ P @ ahead - stage - M["decrease"])
    np.testing.assert_allclose(found["P"], P - M["positive"])
    np.testing.assert_allclose(found["initial"], np.diag([6.0, 0.0]) - P - M["initial"])
    assert claim.bound(loop, {"P": P, "P_0": P_0}) == pytest.approx(2.0)
    assert "x0'P_0 x0" in claim.sentence(loop, {"P": P, "P_0": P_0})


@pytest.mark.parametrize("discount", [0.95, 1.0])
def test_the_lifted_bound_lies_above_V_and_V_above_the_cost(discount):
    rng = np.random.default_rng(32)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, units=(ReLU(), LeakyReLU(0.2), ReLU()), gain=0.15)
    claim = DiscountedCost(np.diag([1.0, 0.3]), [[0.2]], discount, Box([-1, -1], [1, 2]))
    found = certify(plant, inc, claim, multiplier="lifted").require()
    relu = certify(plant, inc, claim, multiplier="relu").require()
    assert found.prove() and found.bound <= relu.bound * (1 + 1e-6)
    x0 = draws.points(rng, 2, 300)
    x, u = oracles.roll_out(plant, inc, x0, 150)
    paid = oracles.discounted_cost(x, u, claim.Q, claim.R, discount)
    V = oracles.quadratic(found.values["P"], np.vstack([x0, oracles.hidden(inc, plant.C @ x0)]))
    above = oracles.quadratic(found.values["P_0"], x0)
    assert np.all(paid <= V * (1 + 1e-9)) and np.all(V <= above * (1 + 1e-9))
    assert np.max(paid[1:] / above[1:]) > 0.9
    assert found.bound == pytest.approx(np.trace(found.values["P_0"] @ claim.initial.second_moment))


def test_P_0_alone_can_be_wrong():
    """A figure is only as good as P_0: lower it, and nothing but the condition 'initial' objects."""
    inc = INC([[0.0]], [[1.0]], [[-0.2]], [[0.0]], activation=ReLU())
    found = certify(PLANT, inc, DiscountedCost([[1.0]], [[1.0]], 0.9, BOX), multiplier="lifted").require()
    low = replace(found, values={**found.values, "P_0": 0.9 * found.values["P_0"]})
    assert not low.holds() and not low.prove("exact") and "'initial'" in low.prove("exact").reason
    assert {name for name, value in low.margins().items() if value < 0} == {"initial"}
