"""Small stable loops with biases, mixed units and W != 0, and their trajectories: what walks are tried on."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, Polytope, ReLU, Saturation
from inc_casadi.claims.regional import Regional

STEPS = 130  # 0.8^130 is 3e-13
USABLE = [1, 2, 3, 5, 7, 8, 10, 11, 12, 13, 16]
EACH_WALK = pytest.mark.parametrize("seed", [pytest.param(seed, marks=[pytest.mark.slow] * (seed >= 10)) for seed in USABLE])


def draw(seed):
    """A small stable loop with biases, mixed units and W != 0, and a claim about it; sizes differ with the seed."""
    rng = np.random.default_rng(seed)
    n, m, p, q = [(1, 1, 1, 3), (2, 1, 2, 4), (2, 2, 1, 3), (3, 1, 2, 2), (3, 2, 4, 2), (2, 1, 3, 5)][seed % 6]
    A = rng.standard_normal((n, n))
    A *= 0.5 / np.max(np.abs(np.linalg.eigvals(A)))
    plant = Plant(A, rng.standard_normal((n, m)), rng.standard_normal((p, n)))
    units = tuple(rng.permutation([ReLU(), LeakyReLU(0.3), Saturation(), ReLU(), LeakyReLU(0.6)])[:q])
    W = rng.standard_normal((q, q))
    W *= 0.7 / np.abs(W).sum(axis=1).max()
    inc = INC(W, rng.standard_normal((q, p)), 0.12 * rng.standard_normal((m, q)), 0.02 * rng.standard_normal((m, p)),
              rng.uniform(0.2, 0.8, q) * rng.choice([-1, 1], q), 0.1 * rng.standard_normal(m), units)
    lower = -rng.uniform(0.5, 2.0, n)
    region = Box(lower, lower + rng.uniform(1.0, 3.0 if n < 3 else 2.0, n))
    if seed % 2:
        tip = region.center + 0.7 * (region.upper - lower)
        region = Polytope.from_vertices(np.hstack([region.vertices, tip[:, None]]))
    G, g = rng.standard_normal((n, n)), rng.standard_normal((m, m))
    limits = Polytope(np.vstack([np.eye(m), -np.eye(m), np.ones((1, m))]), np.full(2 * m + 1, 9.0))
    return plant, inc, Regional(region, limits, G @ G.T, g @ g.T, (0.8, 0.6)[seed % 2])


def motions(plant, inc, claim, points):
    x, u = oracles.roll_out(plant, inc, points, STEPS)
    return x, u, oracles.discounted_cost(x, u, claim.Q, claim.R, claim.discount)
