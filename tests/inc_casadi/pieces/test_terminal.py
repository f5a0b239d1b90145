"""The ellipsoid where the loop is affine for ever: sampled, pushed beyond its edge, and refused for its reasons."""

from dataclasses import replace

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Plant, Polytope, ReLU, Saturation
from inc_casadi.claims.regional import Regional
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.terminal import find, in_fractions, refusal, with_ellipsoid

PLANT = Plant([[0.9, 0.4, 0.0], [-0.2, 0.7, 0.3], [0.1, 0.0, 0.5]], [[0.3, 0.0], [0.1, 0.5], [0.2, -0.4]],
              [[1.0, 0.0, 0.5], [0.0, 1.0, 0.2]])


def biased(seed=0):
    rng = np.random.default_rng(seed)
    units = (ReLU(), Saturation(), ReLU())
    W = 0.2 * rng.uniform(-1, 1, (3, 3))
    return INC(W, rng.standard_normal((3, 2)), 0.1 * rng.standard_normal((2, 3)), -0.05 * np.eye(2), [0.7, 0.2, -0.6],
               [0.3, -0.2], units)


def claim(discount=0.8, inputs=None, n=3, m=2):
    rng = np.random.default_rng(9)
    G = rng.standard_normal((n, n))
    return Regional(Box(-np.ones(n), np.arange(1.0, n + 1)), inputs, G @ G.T, 0.3 * np.eye(m), discount)


def on_the_ellipsoid(terminal, N=400, size=1.0):
    directions = np.random.default_rng(3).standard_normal((N, len(terminal.x)))
    lengths = np.sqrt(np.einsum("ki,ij,kj->k", directions, terminal.P, directions) / terminal.level)
    return terminal.x[:, None] + size * (directions / lengths[:, None]).T


def test_it_is_invariant_affine_and_within_the_limits():
    limits = Polytope([[1.0, 0.5], [-1.0, 0.0], [0.0, 1.0], [0.3, -1.0]], [1.0, 0.8, 0.9, 1.1])
    task, inc = claim(inputs=limits), biased()
    terminal, why = find(PiecewiseLoop(PLANT, inc), task)
    assert terminal is not None, why
    points = on_the_ellipsoid(terminal)
    assert np.all(terminal.contains(on_the_ellipsoid(terminal, size=1 - 1e-9).T))
    assert not np.any(terminal.contains(on_the_ellipsoid(terminal, size=1 + 1e-9).T))
    x, u = oracles.roll_out(PLANT, inc, points, 80)
    levels = oracles.quadratic(terminal.P, x - terminal.x[:, None, None])
    assert np.all(np.diff(levels, axis=-1) <= 1e-12) and levels[:, -1].max() < 1e-6 * terminal.level
    law = PiecewiseLoop(PLANT, inc).laws(terminal.pattern[None])
    np.testing.assert_allclose(u[:, :, 0], law.Gx[0] @ points + law.g[0][:, None], atol=1e-9)
    assert np.all(limits.contains(u.reshape(2, -1), tol=1e-9))


def test_the_level_is_the_largest():
    loop = PiecewiseLoop(PLANT, biased())
    terminal, _ = find(loop, claim())
    assert refusal(loop, claim(), terminal) is None
    assert "crosses a kink of hidden unit" in refusal(loop, claim(), replace(terminal, level=1.001 * terminal.level))
    # At the level some point really is on a kink: far outside it the affine law is wrong.
    law = loop.laws(terminal.pattern[None])
    x = on_the_ellipsoid(terminal, 20_000)
    z = law.Zx[0] @ x + law.z0[0][:, None]
    room = np.minimum(z - law.low[0][:, None], law.high[0][:, None] - z).min()
    assert 0 <= room + 1e-9 < 0.01


def test_an_input_limit_stops_the_level_too():
    task = claim(inputs=Box([-0.5, -0.6], [0.5, 0.6]))
    loop = PiecewiseLoop(PLANT, INC.linear([[-0.3, 0.1], [0.2, -0.4]]))
    terminal, _ = find(loop, task)
    x, u = oracles.roll_out(PLANT, loop.inc, on_the_ellipsoid(terminal, 20_000), 0)
    assert 0.98 < np.max(np.abs(u[:, :, 0]) / [[0.5], [0.6]]) <= 1 + 1e-9
    assert "crosses input limit" in refusal(loop, task, replace(terminal, level=1.001 * terminal.level))


@pytest.mark.parametrize("discount", [0.8, 0.3])
def test_the_tail_is_the_cost_from_there_on_also_around_a_nonzero_rest(discount):
    inc, task = biased(), claim(discount)
    terminal, _ = find(PiecewiseLoop(PLANT, inc), task)
    assert np.linalg.norm(terminal.x) > 0.1
    vertices = on_the_ellipsoid(terminal, 4)
    form = terminal.tail_form(vertices.T[None])[0]
    l = np.random.default_rng(0).dirichlet(np.ones(4), size=30)
    x, u = oracles.roll_out(PLANT, inc, vertices @ l.T, 200)
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", l, form, l),
                               oracles.discounted_cost(x, u, task.Q, task.R, discount), rtol=1e-9)


def test_the_exact_tail_bounds_the_cost_from_above_by_very_little():
    inc, task = biased(), claim()
    floats, _ = find(PiecewiseLoop(PLANT, inc), task)
    loop = PiecewiseLoop(PLANT, inc, "exact")
    terminal = in_fractions(loop, task, floats)
    assert refusal(loop, task, terminal) is None
    assert abs(terminal.x.astype(float) - floats.x).max() < 1e-12
    np.testing.assert_allclose(terminal.tail.astype(float), floats.tail, rtol=1e-8, atol=1e-9)


def test_corrupted_sets_are_refused():
    inc, task = biased(), claim()
    for rational in (False, True):
        loop = PiecewiseLoop(PLANT, inc, "exact" if rational else "float")
        terminal, _ = find(PiecewiseLoop(PLANT, inc), task)
        good = in_fractions(loop, task, terminal) if rational else terminal
        number = loop.numbers
        rotated = number(np.diag([1.0, 1e-3, 1.0]))
        assert refusal(loop, task, good) is None
        assert "not invariant" in refusal(loop, task, replace(good, P=-good.P))
        assert "not invariant" in refusal(loop, task, replace(good, P=rotated))
        assert "not invariant" in refusal(loop, task, replace(good, P=good.P * 0))
        assert "crosses" in refusal(loop, task, replace(good, level=good.level * 2))
        other = 1 - good.pattern if good.pattern.max() <= 1 else np.zeros(3, int)
        assert refusal(loop, task, replace(good, pattern=other)) is not None
    low = good.tail.copy()
    low[0, 0] -= number(np.array(1e-3)).item()
    assert "tail cost is not bounded" in refusal(loop, task, replace(good, tail=low))
    rest_for_less = good.tail.copy()
    rest_for_less[3, 3] -= number(np.array(1e-3)).item()
    assert "tail cost is not bounded" in refusal(loop, task, replace(good, tail=rest_for_less))


def test_a_small_tail_slack_is_needed_for_nothing_when_nothing_costs():
    task = Regional(Box([-1.0], [1.0]), None, [[0.0]], [[0.0]], 0.9)
    loop = PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC.saturated([[-0.2]], 1.0))
    terminal, why = find(loop, task)
    assert terminal is not None and not terminal.tail.any(), why
    rational = PiecewiseLoop(loop.plant, loop.inc, "exact")
    assert refusal(rational, task, in_fractions(rational, task, terminal)) is None


@pytest.mark.parametrize("size", [1e-4, 1e3, 1e6])
def test_a_far_rest_point_is_proved_in_any_units(size):
    # The resting cost is size^2 and more: the slack of the tail must grow with it.
    loop = PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[0.1]], [[-1.0]], [[0.0]], [0.3 * size], [size]), "exact")
    task = Regional(Box([-size], [size]), None, [[1.0]], [[0.1]], 0.9)
    floats, why = find(PiecewiseLoop(loop.plant, loop.inc), task)
    assert floats is not None, why
    assert refusal(loop, task, in_fractions(loop, task, floats)) is None


ONE = Plant([[0.5]], [[1.0]])


@pytest.mark.parametrize("plant, inc, discount, reason", [
    (ONE, INC([[0.0]], [[1.0]], [[-0.1]], [[0.0]]), 0.9, "lies on or beyond a kink of hidden unit 0"),
    (Plant([[1.5]], [[1.0]]), INC.saturated([[-0.2]], 1.0), 0.9, "does not stabilize: its spectral radius is 1.3"),
    (ONE, INC([[0.0]], [[1.0]], [[-0.1]], [[0.0]], [1.0], [2.0]), 1.0, "costs something at every step, and discount = 1"),
    (Plant([[1.0]], [[1.0]]), INC([[0.0]], [[0.1]], [[1.0]], [[0.0]], [1.0], [1.0], Saturation()), 0.9, "no equilibrium"),
    (Plant([[1.0]], [[1.0]]), INC.linear([[0.0]]), 0.9, "is not isolated"),
])
def test_reasons_for_having_none(plant, inc, discount, reason):
    task = Regional(Box([-1.0], [1.0]), None, [[1.0]], [[0.1]], discount)
    terminal, why = find(PiecewiseLoop(plant, inc), task)
    assert terminal is None and reason in why
    assert with_ellipsoid(PiecewiseLoop(plant, inc), task, np.eye(1), 1.0) is None or "kink" in reason


def test_a_rest_beyond_the_input_limit_is_a_reason():
    inc = INC([[0.0]], [[1.0]], [[-0.1]], [[0.0]], [1.0], [2.0])
    task = Regional(Box([-1.0], [1.0]), Box([-1.0], [1.0]), [[1.0]], [[0.1]], 0.9)
    terminal, why = find(PiecewiseLoop(ONE, inc), task)
    assert terminal is None and "lies on or beyond input limit 0" in why
