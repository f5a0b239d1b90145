"""The interior-point method on many columns finds the optima that other methods find one by one."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from inc_casadi import Box, Plant, Polytope, Spec
from inc_casadi.bounds.moves import rollout
from inc_casadi.bounds.sequences import factor, optimal_sequences

N, M, T, C = 3, 2, 7, 5
STATES = Box(-np.ones(N), np.ones(N))


def draw(seed, limits, radius=1.1):
    rng = np.random.default_rng(seed)
    A, root, last = rng.standard_normal((N, N)), rng.standard_normal((N, N)), rng.standard_normal((N, N))
    A = A * radius / np.max(np.abs(np.linalg.eigvals(A)))
    spec = Spec(root @ root.T, np.diag([0.1, 0.4]), 0.95, STATES, limits)
    return Plant(A, rng.standard_normal((N, M))), spec, last @ last.T, 2 * rng.standard_normal((N, C))


def least_squares(plant, spec, P, x0):
    """F, g with cost |F u + g|^2 for u stacked by time."""
    rootQ, rootP, rootR = (np.linalg.cholesky(X).T for X in (spec.Q, P, spec.R))
    F, g = [], []
    for k in range(T + 1):
        moves = np.zeros((N, T * M))
        for j in range(k):
            moves[:, j * M:(j + 1) * M] = np.linalg.matrix_power(plant.A, k - 1 - j) @ plant.B
        root = spec.discount ** (k / 2) * (rootP if k == T else rootQ)
        F.append(root @ moves)
        g.append(root @ np.linalg.matrix_power(plant.A, k) @ x0)
        if k < T:
            F.append(spec.discount ** (k / 2) * rootR @ np.eye(T * M)[k * M:(k + 1) * M])
            g.append(np.zeros(M))
    return np.vstack(F), np.concatenate(g)


@pytest.mark.parametrize("seed", range(4))
def test_bounded_least_squares_agrees(seed):
    limits = Box([-0.5, -1.0], [0.7, 0.3])
    plant, spec, P, x0 = draw(seed, limits)
    u = optimal_sequences(plant, spec, limits, P, x0, T).u
    assert np.all(limits.contains(u.transpose(1, 0, 2).reshape(M, -1)))
    for i in range(C):
        F, g = least_squares(plant, spec, P, x0[:, i])
        ends = np.tile(limits.lower, T), np.tile(limits.upper, T)
        true = lsq_linear(F, -g, ends, method="bvls", tol=1e-14)
        assert np.sum((F @ u[:, :, i].ravel() + g) ** 2) == pytest.approx(2 * true.cost, rel=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_no_direction_within_a_polytope_leads_downhill(seed):
    limits = Polytope.from_vertices([[-0.5, 0.8, 0.1], [-0.4, -0.2, 0.9]])
    plant, spec, P, x0 = draw(seed, limits)
    u = optimal_sequences(plant, spec, limits, P, x0, T).u
    assert np.all(limits.contains(u.transpose(1, 0, 2).reshape(M, -1)))
    for i in range(C):
        F, g = least_squares(plant, spec, P, x0[:, i])
        value, slope = np.sum((F @ u[:, :, i].ravel() + g) ** 2), 2 * F.T @ (F @ u[:, :, i].ravel() + g)
        best = sum(np.min(limits.vertices.T @ part) for part in slope.reshape(T, M))
        assert 0 <= slope @ u[:, :, i].ravel() - best <= 1e-7 * value


def test_many_columns_and_a_state_at_the_origin():
    limits = Box([-1.0, -1.0], [1.0, 1.0])
    plant, spec, P, _ = draw(9, limits)
    x0 = np.random.default_rng(0).uniform(-3, 3, (N, 500))
    x0[:, 7] = 0.0
    u = optimal_sequences(plant, spec, limits, P, x0, T).u
    assert np.all(np.isfinite(u)) and np.max(np.abs(u[:, :, 7])) < 1e-4
    alone = optimal_sequences(plant, spec, limits, P, x0[:, 3:4], T).u
    np.testing.assert_allclose(u[:, :, 3:4], alone, atol=1e-5)


def test_by_hand_without_cost_of_inputs():
    limits, spec = Box(-1, 1), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1))
    u = optimal_sequences(Plant(1.5, 1.0), spec, limits, np.eye(1), np.array([[0.5, -1.8]]), 3).u
    x = rollout(np.array([[1.5]]), np.array([[1.0]]), np.array([[0.5, -1.8]]), u)
    np.testing.assert_allclose(x[:, 0, 0], [0.5, 0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(x[:, 0, 1], [-1.8, -1.7, -1.55, -1.325], atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_the_multipliers_balance_the_slopes_of_the_cost(seed):
    limits = Polytope.from_vertices([[-0.5, 0.8, 0.1], [-0.4, -0.2, 0.9]])
    plant, spec, P, x0 = draw(seed, limits)
    found = optimal_sequences(plant, spec, limits, P, x0, T)
    for i in range(C):
        F, g = least_squares(plant, spec, P, x0[:, i])
        slope = 2 * F.T @ (F @ found.u[:, :, i].ravel() + g)
        pushed = (limits.H.T @ found.multipliers[:, :, i].T).T.ravel()
        np.testing.assert_allclose(pushed, -slope, atol=1e-5 * np.abs(slope).max())
        distance = limits.h - found.u[:, :, i] @ limits.H.T
        np.testing.assert_allclose(found.slack[:, :, i], distance, atol=1e-9)
        assert np.max(found.multipliers[:, :, i] * distance) < 1e-6 * np.sum((F @ found.u[:, :, i].ravel() + g) ** 2)


def test_the_sweep_knows_the_curvature_of_the_least_cost():
    limits = Box([-50.0, -50.0], [50.0, 50.0])
    plant, spec, P, x0 = draw(4, limits)
    factors = factor(plant, spec, P, limits.H, np.full((T, 4, 1), 1e-13))
    for i in range(2):
        F, g = least_squares(plant, spec, P, x0[:, i])
        free = np.linalg.lstsq(F, -g, rcond=None)[0]
        assert x0[:, i] @ factors.hessian[0] @ x0[:, i] / 2 == pytest.approx(np.sum((F @ free + g) ** 2), rel=1e-9)
        np.testing.assert_allclose(factors.gains[0, 0] @ x0[:, i], free[:M], rtol=1e-7)
