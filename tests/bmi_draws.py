"""Stable plants with implicit laws and a cost claim: all sizes different, no symmetry."""

from __future__ import annotations

import numpy as np

from inc_casadi import INC, DiscountedCost, Gaussian, Plant


def draw(n, m, p, q, unit, size=0.05, seed=0, discount=0.95):
    """A plant of spectral radius 0.9, a law with ||W||_inf = 0.5 and readout of that size, K = 0, and a discounted cost."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    plant = Plant(0.9 * A / np.max(np.abs(np.linalg.eigvals(A))), rng.normal(size=(n, m)), rng.normal(size=(p, n)))
    W = rng.normal(size=(q, q))
    W *= 0.5 / np.max(np.abs(W).sum(axis=1), initial=1e-300)
    inc = INC(W, rng.normal(size=(q, p)), size * rng.normal(size=(m, q)), np.zeros((m, p)), activation=unit)
    spread = rng.normal(size=(n, n))
    claim = DiscountedCost(np.diag(rng.uniform(0.5, 2.0, n)), np.diag(rng.uniform(0.05, 0.3, m)), discount,
                           Gaussian(np.zeros(n), np.eye(n) + 0.3 * spread @ spread.T))
    return plant, inc, claim


def moved(inc, direction, step):
    """The law with step * direction added to W, U, V, K; direction: a dict of matrices."""
    parts = [getattr(inc, name) + step * direction[name] for name in ("W", "U", "V", "K")]
    return INC(*parts, inc.b, inc.d, inc.activation)


def direction_of(inc, seed=1):
    """A random direction in W, U, V, K."""
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=getattr(inc, name).shape) for name in ("W", "U", "V", "K")}


def along(gradient, direction):
    """The inner product of a gradient with a direction."""
    return sum(float(np.vdot(getattr(gradient, name), part)) for name, part in direction.items())
