"""The tangent of the cost lies below the cost, touches it, and says truly how far rounding may have lifted it."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box, Plant, Spec
from inc_casadi.blocks import exact
from inc_casadi.bounds.moves import costates, minorant, reached, rollout, slopes

N, M, T, C = 3, 2, 6, 4


def draw(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((N, N)), rng.standard_normal((N, M))
    root, short, last = (rng.standard_normal(s) for s in ((N, N), (1, M), (N, N)))
    spec = Spec(root @ root.T, short.T @ short, 0.9, Box(-np.ones(N), np.ones(N)))
    return Plant(A, B), spec, last @ last.T, rng


def cost(plant, spec, P, x0, u):
    """The cost of one input sequence (T, m) from x0, step by step."""
    x, total = x0, 0 * spec.Q[0, 0]
    for k, move in enumerate(u):
        total = total + spec.discount**k * (x @ spec.Q @ x + move @ spec.R @ move)
        x = plant.A @ x + plant.B @ move
    return total + spec.discount ** len(u) * (x @ P @ x)


def below(tangent, x0, u):
    return np.sum(tangent.state * x0, axis=0) + np.sum(tangent.inputs * u, axis=(0, 1)) - tangent.offset


@pytest.mark.parametrize("seed", range(5))
def test_it_touches_the_cost_where_it_is_taken(seed):
    plant, spec, P, rng = draw(seed)
    x0, u = rng.standard_normal((N, C)), rng.standard_normal((T, M, C))
    tangent = minorant(plant, spec, P, rollout(plant.A, plant.B, x0, u), u, 5.0)
    true = [cost(plant, spec, P, x0[:, i], u[:, :, i]) for i in range(C)]
    np.testing.assert_allclose(below(tangent, x0, u), true, rtol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_it_lies_below_the_cost_everywhere_even_when_taken_at_numbers_that_are_no_trajectory(seed):
    plant, spec, P, rng = draw(seed)
    x, u = 3 * rng.standard_normal((T + 1, N, C)), rng.standard_normal((T, M, C))
    tangent = minorant(plant, spec, P, x, u, 5.0)
    for _ in range(50):
        other, v = rng.standard_normal((N, C)), rng.standard_normal((T, M, C))
        true = np.array([cost(plant, spec, P, other[:, i], v[:, :, i]) for i in range(C)])
        assert np.all(below(tangent, other, v) <= true)


def test_the_slopes_are_the_derivatives_of_the_cost():
    plant, spec, P, rng = draw(7)
    x0, u = rng.standard_normal((N, 1)), rng.standard_normal((T, M, 1))
    p = costates(plant.A, spec.Q, P, spec.discount, rollout(plant.A, plant.B, x0, u))
    g = slopes(plant.B, spec.R, spec.discount, u, p)
    for k in range(T):
        for i in range(M):
            step = np.zeros_like(u)
            step[k, i] = 1e-5
            ends = [cost(plant, spec, P, x0[:, 0], (u + sign * step)[:, :, 0]) for sign in (1, -1)]
            assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(g[k, i, 0], rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("radius", [0.6, 1.0, 1.4])
def test_the_slack_covers_the_rounding(radius):
    plant, spec, P, rng = draw(3)
    plant = Plant(plant.A * radius / np.max(np.abs(np.linalg.eigvals(plant.A))), plant.B)
    spec = Spec(spec.Q, spec.R, 0.75, spec.initial)  # a discount whose powers are exact
    x0, u = rng.standard_normal((N, 1)), rng.uniform(-1, 1, (40, M, 1))
    tangent = minorant(plant, spec, P, rollout(plant.A, plant.B, x0, u), u, 1.0)

    class Exact:
        A, B = exact(plant.A), exact(plant.B)
        Q, R, discount = exact(spec.Q), exact(spec.R), Fraction(3, 4)

    true = cost(Exact, Exact, exact(P), exact(x0[:, 0]), exact(u[:, :, 0]))
    line = np.sum(exact(tangent.state) * exact(x0)) + np.sum(exact(tangent.inputs) * exact(u))
    error = abs(float(line - exact(tangent.offset)[0] - true))
    assert 0 < error <= tangent.slack[0] <= 1e-6 * float(true)


@pytest.mark.parametrize("radius", [0.6, 1.3])
def test_no_trajectory_leaves_what_is_said_to_be_reached(radius):
    plant, _, _, rng = draw(4)
    A = plant.A * radius / np.max(np.abs(np.linalg.eigvals(plant.A)))
    start, reach = rng.random((N, C)), rng.random((T, M, C))
    limits = reached(A, plant.B, start, reach)
    for _ in range(200):
        x = rollout(A, plant.B, start * rng.choice([-1, 1], start.shape), reach * rng.choice([-1, 1], reach.shape))
        assert np.all(np.abs(x) <= limits * (1 + 1e-12))
    same = reached(A, plant.B, start, np.broadcast_to(reach.max(axis=0), reach.shape))
    push = np.sign(np.stack([np.linalg.matrix_power(A, T - 1 - k) @ plant.B for k in range(T)])[:, 0])  # for x_T, row 0
    first = np.sign(np.linalg.matrix_power(A, T)[0])
    x = rollout(A, plant.B, start * first[:, None], reach.max(axis=0) * push[:, :, None])
    np.testing.assert_allclose(x[-1, 0], same[-1, 0], rtol=1e-12)


def test_the_slack_is_for_all_states_that_one_may_start_from():
    plant, spec, P, rng = draw(6)
    x0, u = rng.standard_normal((N, 1)), rng.uniform(-1, 1, (T, M, 1))
    x = rollout(plant.A, plant.B, x0, u)
    alone, far = minorant(plant, spec, P, x, u, 1.0), minorant(plant, spec, P, x, u, 1.0, 100 * np.abs(x0))
    assert minorant(plant, spec, P, x, u, 1.0, np.abs(x0)).slack == alone.slack
    assert 10 * alone.slack < far.slack and np.array_equal(alone.inputs, far.inputs)
