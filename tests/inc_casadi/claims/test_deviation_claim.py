"""The cost of deviations from an equilibrium: on trajectories about it, exact or found by Newton's method."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import (
    INC,
    Box,
    DeviationCost,
    DiscountedCost,
    Gaussian,
    LeakyReLU,
    Plant,
    ReLU,
    Saturation,
    Tanh,
    certify,
    close_loop,
)
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.exact_rest import rest_point
from inc_casadi.multipliers import Lifted, Sector

PIECES, CURVED = (ReLU(), LeakyReLU(0.2), Saturation()), (Tanh(), ReLU(), Tanh())
Q, R = np.diag([1.0, 0.4]), np.array([[0.3]])


def test_conditions_are_those_of_the_cost():
    plant, inc = Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], b=[1.0])
    claim, twin = (kind([[3.0]], [[4.0]], 0.5, Box([-1.0], [1.0])) for kind in (DeviationCost, DiscountedCost))
    values, M = {"P": np.array([[2.0]])}, {"decrease": np.diag([0.1, 0.2])}
    graphs = claim.graphs(close_loop(plant, inc), Sector())
    mine, its = claim.conditions(graphs, values, M), twin.conditions(graphs, values, M)
    assert all(np.array_equal(mine[name], its[name]) for name in its)
    assert graphs["decrease"].about == "difference"
    # x* = 0.6 x* - 0.3 (2 x* + 1) = -0.3: E (x0 - x*)^2 = 1/3 + 0.09.
    assert claim.at_rest(plant, inc) == pytest.approx([-0.3])
    assert claim.bound(close_loop(plant, inc), values) == pytest.approx(2 * (1 / 3 + 0.09))
    assert "x* = (-0.3)" in claim.sentence(close_loop(plant, inc), values)


@pytest.mark.parametrize(("units", "multiplier", "discount"), [
    (PIECES, "sector", 0.95), (PIECES, "relu", 1.0), (PIECES, "lifted", 0.95), (CURVED, "sector", 1.0),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        (PIECES, "sector", 1.0), (PIECES, "relu", 0.95), (PIECES, "lifted", 1.0), (CURVED, "sector", 0.95)))])
def test_deviations_cost_at_most_what_is_promised(units, multiplier, discount):
    rng = np.random.default_rng(91)
    plant = draws.plant(rng, n=2, m=1, p=2)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=units, gain=0.15, bias=1.0)
    initial = Gaussian([0.5, -1.0], np.diag([0.3, 2.0]))
    claim = DeviationCost(Q, R, discount, initial)
    found = certify(plant, inc, claim, multiplier=multiplier).require()
    assert found.prove() and found.multiplier.name == multiplier
    x_rest = np.zeros((2, 1))
    for _ in range(300):
        x_rest = plant.A @ x_rest + plant.B @ oracles.control(inc, plant.C @ x_rest)
    u_rest = oracles.control(inc, plant.C @ x_rest)
    np.testing.assert_allclose(claim.at_rest(plant, inc), x_rest[:, 0], atol=1e-9)
    assert np.linalg.norm(x_rest) > 0.05 and (rest_point(plant, inc) is None) == (units is CURVED)
    x0 = x_rest + draws.points(rng, 2, 100)
    x, u = oracles.roll_out(plant, inc, x0, 100)
    paid = oracles.discounted_cost(x - x_rest[..., None], u - u_rest[..., None], Q, R, discount)
    form = found.values.get("P_0", found.values["P"])
    promised = oracles.quadratic(form, x0 - x_rest)
    assert np.all(paid <= promised * (1 + 1e-8) + 1e-18) and np.max(paid[1:] / promised[1:]) > 0.6
    shift = initial.mean - x_rest[:, 0]
    assert found.bound == pytest.approx(np.trace(form @ initial.covariance) + shift @ form @ shift, rel=1e-8)
    x, u = oracles.roll_out(plant, inc, initial.sample(1500, rng), 60)
    mean = oracles.discounted_cost(x - x_rest[..., None], u - u_rest[..., None], Q, R, discount).mean()
    assert mean < 1.1 * found.bound


def test_a_loop_that_rests_at_the_origin_costs_what_it_cost():
    rng = np.random.default_rng(92)
    plant, inc = draws.plant(rng, n=2, m=1, p=2), draws.controller(rng, m=1, p=2, norm=0.3, units=PIECES, gain=0.15)
    mine, its = (certify(plant, inc, kind(Q, R, 0.95, Box([-1, -1], [1, 2])), multiplier="relu").require()
                 for kind in (DeviationCost, DiscountedCost))
    assert mine.bound == pytest.approx(its.bound, rel=1e-6)


def test_a_loop_without_an_equilibrium_is_refused():
    plant, inc = Plant([[1.0]], [[1.0]]), INC(np.zeros((0, 0)), [], [], [[0.0]], d=[1.0])
    claim = DeviationCost([[1.0]], [[1.0]], 0.9, Box([-1.0], [1.0]))
    found = certify(plant, inc, claim)
    assert not found.holds() and "no equilibrium" in found.reason and "no search was made" in found.note
    # The inequality itself has solutions: only the equilibrium is missing.
    stored = MatrixCertificate(plant, inc, claim, "sector", {"P": [[11.0]], "Lambda": []})
    assert min(stored.margins().values()) > -1e-300
    assert "no equilibrium" in stored.reason and "no equilibrium" in stored.prove().reason
    assert "no equilibrium" in stored.prove("exact").reason and stored.sentence.startswith("Not certified: ")


def test_what_it_refuses():
    claim = DeviationCost([[1.0]], [[1.0]], 0.9, Box([-1.0], [1.0]))
    with pytest.raises(DimensionError, match="but the plant has 1 states and 2 inputs"):
        claim.check(Plant([[0.5]], [[1.0, 2.0]]), INC.linear([[0.0], [0.0]]))
    with pytest.raises(InvalidInputError, match="discount = 1.1"):
        DeviationCost([[1.0]], [[1.0]], 1.1, Box([-1.0], [1.0]))
    curved = INC([[0.0]], [[2.0]], [[-0.1]], [[0.1]], b=[1.0], activation=Tanh())
    assert claim.refusal(close_loop(Plant([[0.5]], [[1.0]]), curved), Lifted()) is not None
