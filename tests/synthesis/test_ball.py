"""The projection on ||W||_inf <= kappa: against a quadratic program, and by the conditions that make it one."""

import cvxpy
import numpy as np
import pytest

from synthesis.ball import project_rows


def rows(seed=0, shape=(5, 7), size=1.0):
    rng = np.random.default_rng(seed)
    return size * rng.normal(size=shape) * rng.uniform(0.05, 2.0, (shape[0], 1))


@pytest.mark.parametrize("radius", [0.3, 0.95, 4.0])
def test_it_is_the_solution_of_the_quadratic_program(radius):
    W = rows()
    near = cvxpy.Variable(W.shape)
    within = [cvxpy.norm(near[i], 1) <= radius for i in range(W.shape[0])]
    cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(near - W)), within).solve(solver=cvxpy.CLARABEL)
    np.testing.assert_allclose(project_rows(W, radius), near.value, atol=1e-6)


def test_the_conditions_of_optimality_hold():
    # <W - X, Z - X> <= 0 for every Z of the ball; per row it is enough to take the ball's vertices +-radius e_j.
    for seed in range(30):
        W, radius = rows(seed, (9, 4)), 0.7
        X = project_rows(W, radius)
        steepest = radius * np.max(np.abs(W - X), axis=1)
        assert np.all(steepest - np.sum((W - X) * X, axis=1) <= 1e-12)


def test_no_row_ever_exceeds_the_radius_by_a_bit():
    for seed in range(200):
        W = rows(seed, (20, 3 + seed % 60), size=10.0 ** (seed % 7 - 2))
        for radius in (0.95, 1 / 3):
            assert np.max(np.abs(project_rows(W, radius)).sum(axis=1)) <= radius


def test_a_row_inside_or_on_the_edge_stays():
    W = np.array([[0.25, -0.5], [0.5, 0.5], [2.0, 0.0]])
    X = project_rows(W, 1.0)
    assert np.array_equal(X[:2], W[:2]) and X[2].tolist() == [1.0, 0.0]
    assert project_rows(X, 1.0) is X or np.array_equal(project_rows(X, 1.0), X)


def test_ties_signs_and_empty_matrices():
    assert project_rows(np.array([[1.0, -1.0, 1.0]]), 1.5).tolist() == [[0.5, -0.5, 0.5]]
    assert project_rows(np.zeros((0, 0)), 0.9).shape == (0, 0)
    assert not np.any(project_rows(np.zeros((2, 2)), 0.9))
