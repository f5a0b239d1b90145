"""The minimum over affine moves written on trajectories from states that carry the moments, for CVXPY."""

import cvxpy as cp
import numpy as np


def with_moments(mean, covariance):
    """Points (n, 2n) and weights that have this mean and covariance; they need not lie in any set."""
    n = len(mean)
    steps = np.sqrt(n) * np.linalg.cholesky(covariance + 1e-15 * np.eye(n))
    return mean[:, None] + np.hstack([steps, -steps]), np.full(2 * n, 1 / (2 * n))


def sampled_program(plant, spec, moves, states, weights, corners, kind="free"):
    """min E cost over u_k = D_k x_0 + d_k, D_k any matrix ("free"), sum_j T_kj C A^j ("rows"), sum_j T_{k-j} C A^j ("tied").

    states (n, N), weights (N,): points with the moments of x_0; limits at `corners` (n, c).
    """
    n, m = plant.n, plant.m
    stacks = [np.vstack([plant.C @ np.linalg.matrix_power(plant.A, j) for j in range(k + 1)]) for k in range(moves)]
    rows = [np.eye(n) if kind == "free" else stack for stack in stacks]
    T = [cp.Variable((m, plant.p)) for _ in range(moves)]
    D = [cp.hstack(T[k::-1]) if kind == "tied" else cp.Variable((m, len(row))) for k, row in enumerate(rows)]
    d = [cp.Variable((m, 1)) for _ in range(moves)]
    rootQ, rootR = root(spec.Q), root(spec.R)
    roots, ones = np.sqrt(weights)[None, :], np.ones((1, len(weights)))
    x, total, held = cp.Constant(states), 0, []
    for k in range(moves):
        u = D[k] @ (rows[k] @ states) + d[k] @ ones
        total += spec.discount**k * (cp.sum_squares(cp.multiply(rootQ @ x, np.repeat(roots, n, axis=0)))
                                     + cp.sum_squares(cp.multiply(rootR @ u, np.repeat(roots, m, axis=0))))
        at = D[k] @ (rows[k] @ corners) + d[k] @ np.ones((1, corners.shape[1]))
        held.append(spec.inputs.H @ at <= np.repeat(spec.inputs.h[:, None], corners.shape[1], axis=1))
        x = plant.A @ x + plant.B @ u
    total += spec.discount**moves * cp.sum_squares(cp.multiply(rootQ @ x, np.repeat(roots, n, axis=0)))
    return float(cp.Problem(cp.Minimize(total), held).solve(solver=cp.CLARABEL))


def root(weight):
    """A square root of a semidefinite matrix."""
    eigenvalues, V = np.linalg.eigh(weight)
    return np.sqrt(np.maximum(eigenvalues, 0))[:, None] * V.T
