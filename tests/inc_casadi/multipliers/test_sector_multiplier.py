"""The sector multiplier, sampled on graphs and against the paper's other form of it."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, Logistic, Plant, close_loop
from inc_casadi.multipliers import Sector


def stacked(loop, x):
    """s = (x, eta) on the graph, eta by an independent iteration."""
    return np.vstack([x, oracles.hidden(loop.inc, loop.plant.C @ x)])


def test_nonnegative_on_the_graph_for_mixed_activations():
    rng = np.random.default_rng(1)
    plant, units = draws.plant(rng), (*draws.MIXED, CenteredLogistic())
    loop = close_loop(plant, draws.controller(rng, units=units, gain=1.0))
    s = stacked(loop, draws.points(rng, loop.n, 4000))
    for _ in range(5):
        M = Sector().matrix(loop, {"Lambda": rng.exponential(size=loop.q)})
        assert oracles.quadratic(M, s).min() >= -1e-9 * np.abs(M).max()


def test_nonnegative_on_differences_of_two_motions_when_biased():
    rng = np.random.default_rng(2)
    plant, units = draws.plant(rng), (*draws.MIXED, Logistic())
    loop = close_loop(plant, draws.controller(rng, units=units, gain=1.0, bias=1.0))
    x, other = draws.points(rng, loop.n, 3000), draws.points(rng, loop.n, 3000)
    M = Sector().matrix(loop, {"Lambda": rng.exponential(size=loop.q)})
    assert oracles.quadratic(M, stacked(loop, x) - stacked(loop, other)).min() >= -1e-9 * np.abs(M).max()


def test_some_point_off_the_graph_is_negative():
    rng = np.random.default_rng(3)
    loop = close_loop(draws.plant(rng), draws.controller(rng))
    M = Sector().matrix(loop, {"Lambda": np.ones(loop.q)})
    assert np.linalg.eigvalsh(M)[0] < -0.1


def test_equals_the_matrix_form_of_the_appendix():
    rng = np.random.default_rng(4)
    loop = close_loop(draws.plant(rng), draws.controller(rng))
    Lambda, D0, D1 = np.diag(rng.exponential(size=loop.q)), np.diag(loop.lower), np.diag(loop.upper)
    middle = np.block([[-2 * D0 @ Lambda @ D1, D0 @ Lambda + Lambda @ D1],
                       [Lambda @ D1 + D0 @ Lambda, -2 * Lambda]])
    ZH = np.vstack([loop.Z, loop.H])
    M = Sector().matrix(loop, {"Lambda": np.diag(Lambda)})
    np.testing.assert_allclose(M, ZH.T @ middle @ ZH, atol=1e-12)


@pytest.mark.parametrize("activation", draws.MIXED)
def test_zero_at_the_ends_of_the_sector(activation):
    low, high = activation.sector
    loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]], activation=activation))
    M = Sector().matrix(loop, {"Lambda": np.array([1.5])})
    for slope in (low, high):
        assert oracles.quadratic(M, np.array([1.0, 2.0 * slope])) == pytest.approx(0.0, abs=1e-14)


def test_no_hidden_unit_gives_a_zero_matrix():
    loop = close_loop(Plant(0.5 * np.eye(3), np.ones((3, 2))), INC.linear(np.zeros((2, 3))))
    assert Sector().matrix(loop, {"Lambda": np.zeros(0)}).tolist() == np.zeros((3, 3)).tolist()
    assert Sector().refusal(loop) is None
