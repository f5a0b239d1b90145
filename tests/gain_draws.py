"""Plants without symmetry for bounds on static gains, and admissible gains drawn by brute force."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec


def draw(seed, n=3, m=2, p=1, radius=1.02, discount=0.95):
    """A plant of n states, m inputs and p outputs that is barely unstable, and a spec with lopsided limits."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)))
    root = rng.standard_normal((n, n))
    B, C = rng.standard_normal((n, m)), rng.standard_normal((p, n))
    spec = Spec(root @ root.T, np.diag(0.1 * np.arange(1, m + 1)), discount,
                Box(-np.linspace(0.5, 1, n), np.linspace(1, 0.7, n)), Box(-np.linspace(0.5, 1, m), np.linspace(1, 0.6, m)))
    return Plant(A, B, C=C), spec


def admissible(plant, spec, vertices, lower, upper, count, rng):
    """Gains (N, m, p) drawn from a box of entries of which those are kept that keep the limits at the first move."""
    gains = (lower + (upper - lower) * rng.random((count, lower.size))).reshape(-1, plant.m, plant.p)
    moves = np.einsum("fm,gmp,pv->gfv", spec.inputs.H, gains, plant.C @ vertices)
    return gains[np.all(moves <= spec.inputs.h[:, None], axis=(1, 2))]


def longest(plant, spec, F, start, steps=600):
    """By how much u = F y exceeds the limits along trajectories from columns of start, at most."""
    x, over = start, -np.inf
    for _ in range(steps):
        over = max(over, float(np.max(spec.inputs.H @ F @ plant.C @ x - spec.inputs.h[:, None])))
        x = (plant.A + plant.B @ F @ plant.C) @ x
    return over
