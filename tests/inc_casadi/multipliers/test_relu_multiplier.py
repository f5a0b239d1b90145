"""The relu multiplier, sampled on graphs, by hand for one unit, and as a superset of the sector multiplier."""

from dataclasses import dataclass

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, Identity, LeakyReLU, Plant, ReLU, Tanh, close_loop
from inc_casadi.activations import Activation, Pieces
from inc_casadi.multipliers import Relu, Sector


@dataclass(frozen=True)
class Concave(Activation):
    """min(z, 0.3 z): steeper on the left, so that the two slopes come in the other order."""

    def formula(self, z, ops):
        return ops.fmin(z, 0.3 * z)

    def derivative(self, z):
        return self._slope_of_piece(z)

    @property
    def slopes(self):
        return (0.3, 1.0)

    @property
    def pieces(self):
        return Pieces(np.array([0.0]), np.array([1.0, 0.3]), np.zeros(2))


UNITS = (ReLU(), Tanh(), LeakyReLU(0.3), Identity(), Concave(), ReLU(), LeakyReLU(1.0), CenteredLogistic())


def random_values(rng, loop):
    values = {}
    for unknown in Relu().unknowns(loop):
        value = rng.normal(size=unknown.shape)
        value = value + value.T if unknown.is_symmetric else value
        values[unknown.name] = np.where(unknown.signed, np.abs(value), value)
    return values


def drawn_loop(rng, units=UNITS):
    return close_loop(draws.plant(rng), draws.controller(rng, units=units, gain=1.0))


def test_nonnegative_on_the_graph_for_mixed_units():
    rng = np.random.default_rng(11)
    loop = drawn_loop(rng)
    x = draws.points(rng, loop.n, 3000)
    s = np.vstack([x, oracles.hidden(loop.inc, loop.plant.C @ x)])
    size = np.sum(s * s, axis=0)
    for _ in range(6):
        M = Relu().matrix(loop, random_values(rng, loop))
        assert np.all(oracles.quadratic(M, s) >= -1e-11 * np.abs(M).max() * (1 + size))


def test_nonnegative_at_the_kinks():
    # Feedforward units and states on which single pre-activations vanish exactly.
    rng = np.random.default_rng(12)
    plant = Plant(np.diag([0.5, 0.2, 0.1]), np.ones((3, 2)))
    inc = INC(np.zeros((3, 3)), np.eye(3), np.ones((2, 3)), np.zeros((2, 3)), activation=(ReLU(), LeakyReLU(0.5), Concave()))
    loop = close_loop(plant, inc)
    grid = np.array(np.meshgrid(*[[-2.0, -1e-9, 0.0, 1e-9, 3.0]] * 3)).reshape(3, -1)
    s = np.vstack([grid, oracles.hidden(inc, grid)])
    for _ in range(6):
        assert oracles.quadratic(Relu().matrix(loop, random_values(rng, loop)), s).min() >= -1e-13


@pytest.mark.parametrize(("unit", "low", "high"), [(ReLU(), 0.0, 1.0), (LeakyReLU(0.25), 0.25, 1.0), (Concave(), 1.0, 0.3)])
def test_one_unit_by_hand(unit, low, high):
    loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.5]], [[2.0]], [[1.0]], [[0.0]], activation=unit))
    values = {"N_sigma": np.array([[3.0]]), "N_nu": np.array([[5.0]]), "N_cross": np.array([[-7.0]])}
    x, eta = 0.6, -1.1
    z = 2.0 * x + 0.5 * eta
    on_left, on_right = eta - low * z, eta - high * z
    expected = 3.0 * on_left**2 + 5.0 * on_right**2 - 14.0 * on_left * on_right
    assert oracles.quadratic(Relu().matrix(loop, values), np.array([x, eta])) == pytest.approx(expected)


def test_products_of_different_units_are_nonnegative_only_with_the_right_sign():
    # sigma_1 nu_2 >= 0 on the graph, so N_cross[0, 1] > 0 is sound and < 0 must be caught by the sign condition.
    inc = INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[1.0, 1.0]], [[0.0]])
    loop = close_loop(Plant([[0.5]], [[1.0]]), inc)
    values = {"N_sigma": np.zeros((2, 2)), "N_nu": np.zeros((2, 2)), "N_cross": np.array([[0.0, 1.0], [0.0, 0.0]])}
    assert oracles.quadratic(Relu().matrix(loop, values), np.array([2.0, 2.0, 0.0])) == pytest.approx(8.0)
    signed = {u.name: u.signed for u in Relu().unknowns(loop)}
    assert signed["N_cross"].tolist() == [[False, True], [True, False]]


def test_contains_the_sector_multiplier():
    rng = np.random.default_rng(13)
    loop = drawn_loop(rng, (ReLU(), ReLU(), ReLU(), ReLU(), ReLU()))
    Lambda = rng.exponential(size=loop.q)
    zero = np.zeros((loop.q, loop.q))
    inside = Relu().matrix(loop, {"N_sigma": zero, "N_nu": zero, "N_cross": -np.diag(Lambda)})
    np.testing.assert_allclose(inside, Sector().matrix(loop, {"Lambda": Lambda}), atol=1e-12)


def test_refused_without_a_cone():
    rng = np.random.default_rng(14)
    assert "linear on each half line" in Relu().refusal(drawn_loop(rng, (Tanh(), CenteredLogistic())))
    biased = close_loop(draws.plant(rng), draws.controller(rng, units=(ReLU(), ReLU()), bias=1.0))
    assert Relu().refusal(biased) is not None
    assert Relu().refusal(drawn_loop(rng)) is None
