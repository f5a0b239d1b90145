"""Random problems with all sizes different and no symmetry; every draw takes its generator."""

from __future__ import annotations

import numpy as np

from inc_casadi import INC, Identity, LeakyReLU, Plant, ReLU, Saturation, Tanh

MIXED = (ReLU(), LeakyReLU(0.3), Tanh(), Saturation(), ReLU(), Identity())


def plant(rng, n=3, m=2, p=4, radius=0.8, dt=1.0):
    """A plant with spectral radius `radius`, or with spectral abscissa -radius when dt is 0."""
    A = rng.normal(size=(n, n))
    modes = np.linalg.eigvals(A)
    A = A * (radius / np.max(np.abs(modes))) if dt > 0 else A - (np.max(modes.real) + radius) * np.eye(n)
    return Plant(A, rng.normal(size=(n, m)), rng.normal(size=(p, n)), dt)


def controller(rng, m=2, p=4, units=MIXED, gain=0.1, norm=0.6, bias=0.0):
    """A controller with ||W||_inf = norm and an output of size about `gain`."""
    q = len(units)
    W = rng.normal(size=(q, q))
    W = W * (norm / np.max(np.abs(W).sum(axis=1))) if q else W
    U, V = rng.normal(size=(q, p)) / np.sqrt(max(p, 1)), gain * rng.normal(size=(m, q))
    return INC(W, U, V, 0.1 * gain * rng.normal(size=(m, p)), bias * rng.normal(size=q), bias * rng.normal(size=m), units)


def points(rng, n, N, size=1.0):
    """Points (n, N) of several magnitudes, the origin among them."""
    x = size * rng.normal(size=(n, N)) * 10.0 ** rng.uniform(-2, 1, size=N)
    x[:, 0] = 0.0
    return x


def regular_simplex(n):
    """The n + 1 corners (n, n + 1) of a regular simplex about the origin: few pieces where a box takes n! simplices."""
    return np.linalg.svd(np.eye(n + 1) - 1 / (n + 1))[0][:, :n].T
