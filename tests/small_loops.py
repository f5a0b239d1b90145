"""Small loops of every kind that exact pieces claim to treat, and their motions by an oracle of their own.

Kinds: "mixed" (W != 0, biases, units with up to three kinks, fewer measurements than states), "net" (two hidden layers),
"saturated" (an unstable plant under a clipped regulator), "posed" (W that only a multiplier accepts), "mpc" (the law of a
program over moves, likewise), and "ties" (dyadic numbers, a cube and a repeated unit, so that kinks pass through corners,
along facets and through each other).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import oracles
import posed
from attraction_draws import lqr
from multiplier_draws import CONCAVE, DEAD_ZONE, THREE

from inc_casadi import INC, Box, LeakyReLU, Plant, Polytope, ReLU, Saturation
from inc_casadi.claims.regional import Regional

UNITS = [ReLU(), LeakyReLU(0.3), Saturation(), THREE, DEAD_ZONE, CONCAVE]
SIZES = [(2, 3, 1, 4), (3, 2, 1, 3), (1, 2, 1, 4), (2, 2, 3, 3), (4, 1, 2, 2), (3, 1, 2, 3)]  # n, m, p, q


@dataclass(frozen=True, eq=False)
class SmallLoop:
    """A plant, a law and a claim about them; contracts: whether Picard's iteration finds the law's answers;
    steps: after how many a motion stands still, nearly."""

    plant: Plant
    inc: INC
    claim: Regional
    contracts: bool = True
    steps: int = 50

    def control(self, x):
        """Inputs (m, N) at states (n, N)."""
        y = self.plant.C @ x
        return oracles.control(self.inc, y) if self.contracts else by_patterns(self.inc, y)

    def motions(self, points, steps):
        """States (n, N, steps + 1) and inputs (m, N, steps + 1) from columns (n, N)."""
        xs, us, x = [], [], points
        for _ in range(steps + 1):
            xs.append(x)
            us.append(self.control(x))
            x = self.plant.A @ x + self.plant.B @ us[-1]
        return np.stack(xs, axis=-1), np.stack(us, axis=-1)

    def costs(self, points, steps):
        """States, inputs and discounted costs (N,) of the motions from columns (n, N), as if the last step went on."""
        x, u = self.motions(points, steps)
        Q, R, beta = self.claim.Q, self.claim.R, self.claim.discount
        last = oracles.discounted_cost(x[:, :, -1:], u[:, :, -1:], Q, R, beta)
        return x, u, oracles.discounted_cost(x, u, Q, R, beta) + beta ** (steps + 1) / (1 - beta) * last


def by_patterns(inc, y):
    """u at columns y (p, N): every pattern of pieces is tried, and the one whose own z fits best is the answer."""
    tables = [_pieces(unit) for unit in inc.activations]
    c = inc.U @ y + inc.b[:, None]
    best, eta = np.full(y.shape[1], np.inf), np.zeros_like(c)
    for choice in product(*tables):
        slope, intercept, low, high = (np.array(part)[:, None] for part in zip(*choice, strict=True))
        found = np.linalg.solve(np.eye(inc.q) - slope * inc.W, slope * c + intercept)
        z = inc.W @ found + c
        misfit = np.maximum(np.maximum(low - z, z - high), 0.0).max(axis=0)
        better = misfit < best
        best[better], eta[:, better] = misfit[better], found[:, better]
    assert np.max(best) < 1e-9, "no pattern fits"
    return inc.K @ y + inc.V @ eta + inc.d[:, None]


def _pieces(unit):
    """Slope, intercept and ends of each piece, from values of the function between its kinks."""
    kinks = {"ReLU": [0.0], "LeakyReLU": [0.0], "Saturation": [-1.0, 1.0]}.get(type(unit).__name__)
    kinks = list(unit.at) if kinks is None else kinks
    ends = [kinks[0] - 1.0, *kinks, kinks[-1] + 1.0]
    out = []
    for i, (a, b) in enumerate(zip(ends, ends[1:], strict=False)):
        first, second = (float(oracles.phi(unit, np.array(z))) for z in (a, b))
        slope = (second - first) / (b - a)
        low, high = (-np.inf if i == 0 else a), (np.inf if i == len(ends) - 2 else b)
        out.append((slope, first - slope * a, low, high))
    return out


def small_loop(kind, seed):
    """Return the loop of a kind and a seed."""
    rng = np.random.default_rng([seed, len(kind)])
    return {"mixed": _mixed, "net": _net, "saturated": _saturated, "posed": _posed, "mpc": _mpc,
            "ties": _ties}[kind](rng, seed)


def _mixed(rng, seed):
    n, m, p, q = SIZES[seed % len(SIZES)]
    W = rng.standard_normal((q, q))
    W *= 0.7 / np.abs(W).sum(axis=1).max()
    units = tuple(UNITS[i] for i in rng.permutation(len(UNITS))[:q])
    inc = INC(W, rng.standard_normal((q, p)), 0.15 * rng.standard_normal((m, q)) / m, 0.02 * rng.standard_normal((m, p)),
              rng.uniform(0.2, 0.8, q) * rng.choice([-1, 1], q), 0.1 * rng.standard_normal(m), units)
    return _about(rng, _stable(rng, n, m, p), inc, _region(rng, n, polytope=seed % 2))


def _net(rng, seed):
    n, m = 2 + seed % 2, 2 - seed % 2
    widths = (n, 4, 2, m)
    layers = [(rng.standard_normal((b, a)) / np.sqrt(a), 0.4 * rng.standard_normal(b))
              for a, b in zip(widths, widths[1:], strict=False)]
    layers[-1] = (0.3 * layers[-1][0], 0.3 * layers[-1][1])
    return _about(rng, _stable(rng, n, m, n), INC.from_layers(layers, (ReLU(), LeakyReLU(0.2))[seed % 2]),
                  _region(rng, n, polytope=seed % 2), steps=300)


def _saturated(rng, seed):
    n, m = [(2, 1), (3, 2), (2, 2), (3, 1)][seed % 4]
    A = rng.standard_normal((n, n))
    plant = Plant(A * 1.1 / np.max(np.abs(np.linalg.eigvals(A))), rng.standard_normal((n, m)))
    gain, half = lqr(plant), rng.uniform(0.5, 0.9, n)
    limit = 0.75 * np.abs(gain) @ half
    return _about(rng, plant, INC.saturated(gain, limit), Box(-half, half), discount=0.9, steps=150)


def _posed(rng, seed):
    n, m, p = [(2, 2, 1), (2, 1, 2), (3, 2, 2)][seed % 3]
    units = tuple(UNITS[i] for i in rng.integers(0, 3, 3))
    law = posed.controller(rng, units, p, m, ("symmetric", "skew")[seed % 2])
    law = INC(law.W, law.U, 0.1 * law.V, 0.05 * law.K, law.b, 0.1 * law.d, units)
    return _about(rng, _stable(rng, n, m, p), law, _region(rng, n, polytope=seed % 2), contracts=False)


def _mpc(rng, seed):
    shift, half = rng.uniform(-0.1, 0.1, 2), rng.uniform(0.5, 0.7, 2)
    law = posed.mpc_law(horizon=2 + seed % 2, step=0.05)
    return _about(rng, posed.PLANT, law, Box(shift - half, shift + half), discount=0.9, contracts=False)


def _ties(rng, seed):
    n, m = [(2, 1), (3, 1), (2, 2)][seed % 3]
    A, B = np.triu(rng.integers(-2, 3, (n, n)) / 4, 1) + np.diag(rng.choice([0.25, 0.5], n)), rng.integers(-2, 3, (n, m)) / 2
    U = np.array([np.eye(n)[0], *rng.choice([-1, 1], (2, n)), np.eye(n)[0]])
    units, b = (Saturation(), ReLU(), DEAD_ZONE, Saturation()), np.array([0.0, rng.choice([0.5, 1.0]), 0.25, 0.0])
    inc = INC(np.triu(rng.integers(-2, 3, (4, 4)) / 16, 2), U, rng.integers(-2, 3, (m, 4)) / 16, np.zeros((m, n)), b,
              np.zeros(m), units)
    return _about(rng, Plant(A, B), inc, Box(-np.ones(n), np.ones(n)))


def _stable(rng, n, m, p):
    A = rng.standard_normal((n, n))
    return Plant(A * 0.5 / np.max(np.abs(np.linalg.eigvals(A))), rng.standard_normal((n, m)), rng.standard_normal((p, n)))


def _region(rng, n, polytope):
    lower = -rng.uniform(0.5, 2.0, n)
    box = Box(lower, lower + rng.uniform(1.0, 3.0 if n < 3 else 1.5, n))
    if not polytope:
        return box
    tip = box.center + 0.7 * (box.upper - lower)
    return Polytope.from_vertices(np.hstack([box.vertices, tip[:, None]]))


def _about(rng, plant, inc, region, discount=0.8, contracts=True, steps=50):
    """The loop with a claim whose limits no input comes near."""
    n, m = plant.n, plant.m
    G, g = rng.standard_normal((n, n)), rng.standard_normal((m, m))
    limits = Polytope(np.vstack([np.eye(m), -np.eye(m), rng.uniform(0.5, 1.5, (1, m))]), np.full(2 * m + 1, 50.0))
    return SmallLoop(plant, inc, Regional(region, limits, G @ G.T, g @ g.T, discount), contracts, steps)
