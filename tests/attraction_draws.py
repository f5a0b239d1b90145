"""Loops with regions of attraction, drawn or published, and points on the rims of ellipsoids."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from inc_casadi import INC, LeakyReLU, Plant, ReLU, Saturation

TWO_STATES = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])


def lqr(plant, discount=1.0, r=1.0):
    """The gain of the (discounted) linear-quadratic regulator for Q = I, R = r I, u = K x."""
    root, R = np.sqrt(discount), r * np.eye(plant.m)
    P = solve_discrete_are(root * plant.A, root * plant.B, np.eye(plant.n), R)
    return -np.linalg.solve(R + discount * plant.B.T @ P @ plant.B, discount * plant.B.T @ P @ plant.A)


def unstable(rng, n=3, m=2, radius=1.1):
    """A plant that no bounded input stabilizes globally, measured in full."""
    A = rng.normal(size=(n, n))
    return Plant(A * (radius / np.max(np.abs(np.linalg.eigvals(A)))), rng.normal(size=(n, m)))


def mixed(rng, plant, bias=0.1, feedback=0.15):
    """A law of two saturated LQR channels that further units of other kinds, W and biases disturb."""
    q = plant.m + 2
    U = np.vstack([lqr(plant), 0.3 * rng.normal(size=(2, plant.n))])
    V = np.hstack([np.eye(plant.m), 0.1 * rng.normal(size=(plant.m, 2))])
    units = (*(Saturation(),) * plant.m, ReLU(), LeakyReLU(0.2))
    return INC(feedback * rng.normal(size=(q, q)), U, V, np.zeros((plant.m, plant.n)), bias * rng.normal(size=q),
               activation=units)


def rim(ellipsoid, N, rng, scale=1.0):
    """Points (n, N) with (x - c)'P (x - c) = scale^2."""
    draws = rng.normal(size=(ellipsoid.dimension, N))
    L = np.linalg.cholesky(ellipsoid.P)
    return ellipsoid.center[:, None] + scale * np.linalg.solve(L.T, draws / np.linalg.norm(draws, axis=0))


def falls(V, factor=1.0):
    """Whether V (N, T + 1) shrinks at least by a factor in every step, down to where rounding takes over."""
    return bool(np.all(V[:, 1:] < factor * V[:, :-1] + 1e-24))
