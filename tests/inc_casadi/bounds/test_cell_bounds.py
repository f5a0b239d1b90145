"""What is said of a cell is below the mean of the least cost over it, and equal where one set of limits is met."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from inc_casadi import Box, Empirical, Plant, Polytope, Spec, Uniform
from inc_casadi.bounds.cell_bounds import Trials, cell_bounds
from inc_casadi.bounds.exact_cells import Scaled, exact_bounds
from inc_casadi.bounds.partition import partition
from inc_casadi.bounds.proposals import propose

N, M, T = 3, 2, 4
START = Box([-0.9, -0.5, -0.7], [0.6, 1.1, 0.4])
PRISM = Polytope.from_vertices([[-1, 1, 0.2, -0.8], [-0.6, -0.4, 1.1, 0.3], [0.1, -0.5, 0.2, 1.0]])
LIMITS = Box([-0.3, -0.5], [0.4, 0.2])
TRIANGLE = Polytope.from_vertices([[-0.5, 0.6, 0.1], [-0.3, -0.2, 0.5]])


def draw(seed, initial=START, inputs=LIMITS, discount=0.9, R=(0.1, 0.3)):
    rng = np.random.default_rng(seed)
    A, root, last = rng.standard_normal((N, N)), rng.standard_normal((N, N)), rng.standard_normal((N, N))
    A *= 1.1 / np.max(np.abs(np.linalg.eigvals(A)))
    spec = Spec(root @ root.T, np.diag(R), discount, initial, inputs)
    return Plant(A, rng.standard_normal((N, M))), spec, last @ last.T, rng


def least_squares(plant, spec, P, x0):
    """F, g with cost |F u + g|^2 for u stacked by time."""
    roots = [np.linalg.cholesky(X).T for X in (spec.Q, P)]
    rows, right = [], []
    for k in range(T + 1):
        moves = np.zeros((N, T * M))
        for j in range(k):
            moves[:, j * M:(j + 1) * M] = np.linalg.matrix_power(plant.A, k - 1 - j) @ plant.B
        root = spec.discount ** (k / 2) * roots[k == T]
        rows.append(root @ moves)
        right.append(root @ np.linalg.matrix_power(plant.A, k) @ x0)
    weights = np.concatenate([spec.discount ** (k / 2) * np.sqrt(np.diag(spec.R)) for k in range(T)])
    return np.vstack([*rows, np.diag(weights)]), np.concatenate([*right, np.zeros(T * M)])


def least_cost(plant, spec, P, x0):
    """V(x0) by bounded least squares; on the triangle by the mixing weights of its vertices, nonnegative and of sum 1."""
    F, g = least_squares(plant, spec, P, x0)
    if isinstance(spec.inputs, Box):
        ends = np.tile(spec.inputs.lower, T), np.tile(spec.inputs.upper, T)
        return 2 * lsq_linear(F, -g, ends, method="bvls", tol=1e-14).cost
    mix = np.kron(np.eye(T), spec.inputs.vertices)
    sums = 1e5 * np.kron(np.eye(T), np.ones((1, 3)))
    return 2 * lsq_linear(np.vstack([F @ mix, sums]), np.append(-g, 1e5 * np.ones(T)), (0, np.inf), method="bvls").cost


def means(plant, spec, P, shapes, i):
    """Below and above the mean over cell i of the convex V: at the middles and at the corners of smaller cells."""
    if shapes.symmetric:
        grid = [np.stack(np.meshgrid(*[axis] * N)).reshape(N, -1) for axis in ([-0.5, 0.5], [-1, 0, 1])]
        weights = np.full(8, 1 / 8), np.prod(np.where(grid[1] == 0, 0.5, 0.25), axis=0)
    else:
        grid, weights = [np.zeros((N + 1, 1)), np.eye(N + 1)], (np.ones(1), np.full(N + 1, 1 / (N + 1)))
    out = []
    for xi, weight in zip(grid, weights, strict=True):
        states = shapes.centers[:, i:i + 1] + shapes.spans[:, :, i] @ xi
        out.append(weight @ [least_cost(plant, spec, P, x) for x in states.T])
    return out


@pytest.mark.parametrize("initial, inputs, discount, R", [
    (START, LIMITS, 0.9, (0.1, 0.3)), (START, TRIANGLE, 1.0, (0.1, 0.3)), (PRISM, LIMITS, 1.0, (0.0, 0.0)),
    (PRISM, TRIANGLE, 0.8, (0.2, 0.0)), (START, Box([0.1, -0.5], [0.4, -0.2]), 0.9, (0.0, 0.3)),
], ids=["box-box", "box-triangle", "simplex-box", "simplex-triangle", "biased"])
def test_cell_by_cell_it_is_below_the_mean_of_the_least_cost_and_near_it(initial, inputs, discount, R):
    plant, spec, P, _ = draw(3, initial, inputs, discount, R)
    shapes = partition(spec.initial, 64).shapes
    found = propose(plant, spec, P, np.arange(shapes.probabilities.size), shapes, T)
    values = cell_bounds(plant, spec, P, shapes, found.trials)
    np.testing.assert_allclose(values, found.values, rtol=1e-12)
    above = 0
    for i in range(0, 64, 9):
        low, high = means(plant, spec, P, shapes, i)
        assert values[i] <= high * (1 + 1e-7)
        assert values[i] >= least_cost(plant, spec, P, shapes.centers[:, i]) * (1 - 1e-7)  # Jensen's inequality for V
        above += values[i] > low  # and that in eight parts of the cell
    assert above >= 4


@pytest.mark.parametrize("inputs", [LIMITS, TRIANGLE], ids=["box", "triangle"])
def test_where_the_same_limits_are_met_all_over_the_cell_nothing_is_lost(inputs):
    plant, spec, P, rng = draw(5, inputs=inputs)
    tiny = 0
    for center in rng.uniform(-2, 2, (12, N)):
        cell = Uniform(Box(center - 1e-3, center + 1e-3))
        shapes = partition(cell, 1).shapes
        found = propose(plant, spec, P, np.array([0]), shapes, T)
        # V is quadratic there: three terms of its series are exact, and differences give the second.
        steps = np.eye(N) * 1e-3
        at = least_cost(plant, spec, P, center)
        bent = sum(least_cost(plant, spec, P, center + s) + least_cost(plant, spec, P, center - s) - 2 * at for s in steps)
        tiny += abs(found.values[0] - (at + bent / 6)) < 3e-10 * at
    assert tiny >= 9  # some cells are cut through by a change, however small they are


def test_any_trial_inputs_prove_something_lower():
    plant, spec, P, rng = draw(1)
    shapes = partition(spec.initial, 8).shapes
    good = propose(plant, spec, P, np.arange(8), shapes, T)
    for size in (1e-2, 1.0, 30.0):
        u, G = rng.standard_normal(good.trials.u.shape), rng.standard_normal(good.trials.G.shape)
        worse = replace(good.trials, u=good.trials.u + size * u, G=good.trials.G + size * G)
        values = cell_bounds(plant, spec, P, shapes, worse)
        assert np.all(values < good.values + 2e-2)
        for i in (0, 5):
            assert values[i] <= means(plant, spec, P, shapes, i)[1]


def test_responses_to_the_state_prove_more_than_constant_inputs():
    plant, spec, P, _ = draw(2)
    shapes = partition(spec.initial, 8).shapes
    found = propose(plant, spec, P, np.arange(8), shapes, T)
    constant = cell_bounds(plant, spec, P, shapes, replace(found.trials, G=0 * found.trials.G))
    assert np.all(constant < 0.99 * found.values)


def test_large_groups_are_done_in_parts_with_the_same_result(monkeypatch):
    plant, spec, P, _ = draw(2)
    shapes = partition(spec.initial, 8).shapes
    trials = propose(plant, spec, P, np.arange(8), shapes, T).trials
    whole = cell_bounds(plant, spec, P, shapes, trials)
    monkeypatch.setitem(cell_bounds.__globals__, "_NUMBERS", 50)
    np.testing.assert_allclose(cell_bounds(plant, spec, P, shapes, trials), whole, rtol=1e-13)


@pytest.mark.parametrize("initial, inputs, discount", [(START, LIMITS, 0.9), (PRISM, LIMITS, 1.0), (START, TRIANGLE, 0.8),
                                                       (PRISM, TRIANGLE, 0.9)])
def test_the_exact_bounds_are_those_of_the_floats_before_rounding_is_subtracted(initial, inputs, discount):
    plant, spec, P, _ = draw(4, initial, inputs, discount)
    cells = partition(spec.initial, 8)
    trials = propose(plant, spec, P, cells.leaves, cells.shapes, T).trials
    values = cell_bounds(plant, spec, P, cells.shapes, trials)
    exact = exact_bounds(plant, spec, P, cells.shapes, cells.exact(), trials)
    assert all(isinstance(value, Fraction) for value in exact)
    difference = exact.astype(float) - values
    assert np.all(difference > 0) and np.all(difference < 3e-10 * values)


def test_the_exact_bound_of_a_point_by_hand():
    # V(3) = 9 + 25 for x+ = 2 x + u, |u| <= 1, no cost of u and P = 1; the tangent at u = -1 has the slope 2 * 5 at x_1 = 5
    plant, spec = Plant(2.0, 1.0), Spec(1.0, 0.0, 1.0, Empirical([[3.0]]), Box(-1, 1))
    cells = partition(spec.initial, 1)
    for u, true in ((-1.0, 34), (-0.5, 9 + Fraction(11, 2) * (10 - Fraction(11, 2)) + 0), (1.0, 9 + 7 * 3)):
        trials = Trials(np.array([0]), np.full((1, 1, 1), u), np.zeros((1, 1, 1, 1)))
        exact = exact_bounds(plant, spec, np.eye(1), cells.shapes, cells.exact(), trials)[0]
        assert 0 <= true - exact < Fraction(1, 10**15)
        assert cell_bounds(plant, spec, np.eye(1), cells.shapes, trials)[0] == pytest.approx(float(true))


def test_numbers_on_a_scale():
    assert Scaled.of(np.array([0.1])).fractions()[0] == Fraction(0.1)
    near = Scaled.near(np.array([1e-30, 3.0, -1e3]))
    assert np.all(np.abs(near.fractions().astype(float) - [1e-30, 3.0, -1e3]) < 1e-15)
    assert Scaled.near(np.zeros(2)).fractions().tolist() == [0, 0]


def test_trial_inputs_that_are_not_finite_are_refused_in_words():
    plant, spec, P, _ = draw(0)
    cells = partition(spec.initial, 1)
    trials = propose(plant, spec, P, cells.leaves, cells.shapes, T).trials
    found = exact_bounds(plant, spec, P, cells.shapes, cells.exact(), replace(trials, u=np.nan * trials.u))
    assert "not finite" in found


@pytest.mark.parametrize("seed, R", [(6, 0.0), (2, 0.2)])
def test_the_estimated_gains_are_about_what_finer_cells_gain(seed, R):
    rng = np.random.default_rng(seed)
    A, root = rng.standard_normal((2, 2)), rng.standard_normal((2, 2))
    A *= 1.05 / np.max(np.abs(np.linalg.eigvals(A)))
    spec = Spec(root @ root.T, R * np.eye(2), 0.9, Box([-1.0, -2.0], [1.2, 1.8]), Box([-0.5, -1.0], [0.4, 0.9]))
    plant, P = Plant(A, rng.standard_normal((2, 2))), np.eye(2)
    totals = []
    for number in (64, 4096):
        cells = partition(spec.initial, number, np.eye(2))
        found = propose(plant, spec, P, cells.leaves, cells.shapes, 6)
        totals.append((cells.probabilities @ found.values, cells.probabilities @ found.gains.sum(axis=0)))
    gained = totals[1][0] - totals[0][0]
    assert 0.4 * gained < totals[0][1] < 2.5 * gained and totals[1][1] < 0.1 * totals[0][1]
