"""Controllers that Perron-Frobenius rejects and a diagonal multiplier accepts, drawn or built by hand."""

from __future__ import annotations

import numpy as np

from inc_casadi import INC, Plant, Saturation

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])


def controller(rng, units, p=3, m=2, kind="symmetric"):
    """A law with W = I - (positive definite), or a large skew part, in random scales of the hidden units."""
    q = len(units)
    H = rng.normal(size=(q, q))
    W = 0.5 * np.eye(q) - H @ H.T if kind == "symmetric" else 0.3 * np.eye(q) + 2.0 * (H - H.T)
    scale = 10.0 ** rng.uniform(-0.5, 0.5, size=q)
    W = scale[:, None] * W / scale[None, :]
    return INC(W, rng.normal(size=(q, p)), rng.normal(size=(m, q)), rng.normal(size=(m, p)), rng.normal(size=q),
               rng.normal(size=m), units)


def condensed(plant, Q, R, horizon):
    """H and F of the program min U'HU/2 + (F x)'U over inputs U, with the Riccati matrix as its last weight."""
    A, B, n, m = plant.A, plant.B, plant.n, plant.m
    P = Q.copy()
    for _ in range(2000):
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P = Q + A.T @ P @ (A - B @ K)
    powers = [np.linalg.matrix_power(A, k) for k in range(horizon + 1)]
    G = np.zeros((horizon * n, horizon * m))
    for i in range(horizon):
        for j in range(i + 1):
            G[i * n:(i + 1) * n, j * m:(j + 1) * m] = powers[i - j] @ B
    weights = np.kron(np.eye(horizon), Q)
    weights[-n:, -n:] = P
    H = G.T @ weights @ G + np.kron(np.eye(horizon), R)
    return (H + H.T) / 2, G.T @ weights @ np.vstack(powers[1:])


def mpc_law(plant=PLANT, horizon=4, step=0.05):
    """The law u = first input of the box-constrained program, |U| <= 1, as eta = sat((I - step H) eta - step F x)."""
    H, F = condensed(plant, np.eye(plant.n), 0.05 * np.eye(plant.m), horizon)
    q = len(H)
    return INC(np.eye(q) - step * H, -step * F, np.eye(plant.m, q), np.zeros((plant.m, plant.n)), activation=Saturation())
