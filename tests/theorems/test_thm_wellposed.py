"""thm:wellposed: lambda_pf(|W|) < 1 gives one hidden vector and componentwise Lipschitz bounds; at 1 it may fail."""

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, ReLU
from inc_casadi.errors import NotWellPosedError

ROOM = 1 + 1e-9


def iterate(inc, y, start, rounds=3000):
    """Picard's iteration from a given eta, typed again."""
    eta = start
    for _ in range(rounds):
        z = inc.W @ eta + inc.U @ y + inc.b
        eta = np.array([oracles.phi(unit, value) for unit, value in zip(inc.activations, z, strict=True)])
    return eta


def example(seed=21):
    """A loop with ||W||_inf > 1 and lambda_pf(|W|) = 0.9: the row sums alone would not do."""
    rng = np.random.default_rng(seed)
    inc = draws.controller(rng, bias=0.5, gain=1.0)
    W = np.abs(inc.W) * np.sign(rng.normal(size=inc.W.shape))
    W = W * 0.9 / np.max(np.abs(np.linalg.eigvals(np.abs(W))))
    scale = np.geomspace(1, 20, inc.q)
    return INC(W * scale / scale[:, None], inc.U, inc.V, inc.K, inc.b, inc.d, inc.activation), rng


def test_every_start_ends_in_the_one_hidden_vector():
    inc, rng = example()
    assert np.abs(inc.W).sum(axis=1).max() > 1 and inc.contraction.radius == pytest.approx(0.9)
    y = rng.normal(size=inc.p)
    ends = [iterate(inc, y, 100 * rng.normal(size=inc.q)) for _ in range(5)]
    for end in ends:
        np.testing.assert_allclose(end, inc.hidden(y), atol=1e-9)


def test_the_lipschitz_bounds_hold_between_any_two_measurements():
    inc, rng = example()
    M = np.abs(inc.W)
    hidden = sum(np.linalg.matrix_power(M, j) for j in range(600)) @ np.abs(inc.U)  # the Neumann series of the proof
    outer = np.abs(inc.K) + np.abs(inc.V) @ hidden
    np.testing.assert_allclose(inc.well_posedness().hidden_lipschitz, hidden, rtol=1e-8)
    np.testing.assert_allclose(inc.well_posedness().lipschitz, outer, rtol=1e-8)
    y1 = rng.normal(size=(inc.p, 400)) * 10.0 ** rng.uniform(-3, 1, size=400)
    y2 = y1 + rng.normal(size=(inc.p, 400)) * 10.0 ** rng.uniform(-6, 1, size=400)
    gap = np.abs(y1 - y2)
    assert np.all(np.abs(oracles.hidden(inc, y1) - oracles.hidden(inc, y2)) <= hidden @ gap * ROOM + 1e-11)
    assert np.all(np.abs(oracles.control(inc, y1) - oracles.control(inc, y2)) <= outer @ gap * ROOM + 1e-11)


def test_the_bounds_are_attained_by_a_positive_loop():
    # All of W, U, V, K positive, ReLU and positive y: eta = (I - W)^-1 U y exactly.
    inc = INC([[0.3, 0.2], [0.4, 0.1]], [[1.0], [2.0]], [[1.0, 3.0]], [[0.5]], activation=ReLU())
    slope = inc([2.0]) - inc([1.0])
    np.testing.assert_allclose(inc.well_posedness().lipschitz[0], slope, rtol=1e-9)


@pytest.mark.parametrize(("c", "solutions"), [(1.0, 0), (0.0, 101), (-1.0, 1)])
def test_at_radius_one_there_may_be_no_solution_or_many(c, solutions):
    # eta = relu(eta + c): none for c > 0, every eta >= 0 for c = 0, eta = 0 for c < 0.
    eta = np.linspace(0, 10, 101)
    assert np.sum(np.abs(np.maximum(eta + c, 0) - eta) < 1e-12) == solutions
    inc = INC([[1.0]], [[1.0]], [[1.0]], [[0.0]], b=[c], activation=ReLU())
    assert not inc.well_posedness().holds
    with pytest.raises(NotWellPosedError, match="thm:wellposed"):
        inc([0.0])


def test_a_strictly_triangular_w_is_well_posed_whatever_its_size():
    layers = [(50 * np.ones((3, 2)), np.zeros(3)), (-70 * np.ones((2, 3)), np.ones(2)), (np.ones((1, 2)), [0.0])]
    deep = INC.from_layers(layers)
    assert deep.contraction.radius == 0.0 and deep.well_posedness().holds
    y = np.array([[0.1, -0.3], [0.2, 0.1]])
    layer = np.maximum(-70 * np.maximum(50 * y.sum(axis=0), 0) * 3 + 1, 0)
    np.testing.assert_allclose(deep(y)[0], 2 * layer, rtol=1e-12)
