"""A convex core of a region of attraction: a polytope that grows as long as its motions provably reach a smaller one."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..sets import Box, Polytope
from .cells import volumes, whole
from .follow import Goal, follow
from .laws import PiecewiseLoop
from .terminal import TerminalSet
from .walk import Budget

MOTIONS, STEPS = 4000, 400
FINEST, FIRST = 0.01, 0.5  # by how much a half-space is moved at least and at first, as a share of its distance
SHRINK = 0.999
STAGE = Budget(pieces=10_000, steps=150, seconds=10.0)


def grow(loop: PiecewiseLoop, region: Box | Polytope, inputs: Box | Polytope | None, terminal: TerminalSet, budget: Budget,
         seed: int) -> Polytope | None:
    """Return a polytope from which every motion converges within the limits, or None when none was certified.

    Its shape is the hull, by a few dozen half-spaces, of sampled starting points whose motions converge: {H e <= h},
    e = x - x*. If all motions from Y' reach Y or the terminal ellipsoid, and all motions from Y converge, then so do
    those from Y'. So the half-spaces are moved outward step by step, each step certified by `follow`; where motions do not
    arrive, those half-spaces that their starting points are beyond are moved less from then on. The first Y lies in the
    ellipsoid. The samples only propose.
    """
    H, h = _shape(loop, region, inputs, terminal, np.random.default_rng(seed))
    if H.size == 0:
        return None
    clock, best = time.monotonic(), None
    corners = Polytope(H, h).vertices.T
    scale = SHRINK * float(np.min(np.sqrt(terminal.level / ((corners @ terminal.P) * corners).sum(axis=1))))
    level, stride = min(scale, 1.0) * h, np.full(len(h), FIRST)
    while np.any((stride > FINEST) & (level < h)) and time.monotonic() - clock < budget.seconds:
        wanted = np.minimum(level * (1 + np.where(stride > FINEST, stride, 0.0)), h)
        larger = Polytope(H, wanted + H @ terminal.x)
        failed = _fails(loop, larger, inputs, Goal(terminal, best), budget.seconds - (time.monotonic() - clock))
        if not len(failed):
            level, best, stride = wanted, larger, np.minimum(1.3 * stride, FIRST)
        else:
            blamed = np.any((failed - terminal.x) @ H.T > level * (1 + 1e-9), axis=0)
            stride = np.where(blamed if blamed.any() else True, stride / 3, stride)
    return best


def _fails(loop: PiecewiseLoop, larger: Polytope, inputs: Box | Polytope | None, goal: Goal, seconds: float) -> Array:
    """Starting points (k, n) of a larger polytope that were not seen to reach the goal; none when all of them do."""
    cells = whole(larger)
    patience = replace(STAGE, seconds=min(STAGE.seconds, seconds))
    found = follow(loop, cells, inputs, goal, patience, 1e-9 * float(volumes(cells).sum()), patient=False)
    return found.failed


def _shape(loop: PiecewiseLoop, region: Box | Polytope, inputs: Box | Polytope | None, terminal: TerminalSet,
           rng: np.random.Generator) -> tuple[Array, Array]:
    """Half-spaces H e <= h around the sampled points that converge; none when these are too few."""
    n = len(terminal.x)
    points = region.sample(MOTIONS, rng)
    good = points[:, converges(loop, points, inputs, terminal)] - terminal.x[:, None]
    if good.shape[1] < 10 * n:
        return np.zeros((0, n)), np.zeros(0)
    H = _directions(n, good, rng)
    return H, np.maximum((H @ good).max(axis=1), 1e-3 * np.abs(H @ good).max(axis=1))


def converges(loop: PiecewiseLoop, x: Array, inputs: Box | Polytope | None, terminal: TerminalSet) -> np.ndarray:
    """Which simulated motions from x (n, N) keep the input limits and end in the terminal set: no proof of anything."""
    plant, inc = loop.plant, loop.inc
    limit, kept = 1e3 * float(np.max(np.abs(x))), np.ones(x.shape[1], dtype=bool)
    for _ in range(STEPS):
        u = inc(plant.C @ x)
        if inputs is not None:
            kept &= np.all(inputs.H @ u <= inputs.h[:, None] * (1 + 1e-9), axis=0)
        x = np.clip(plant.A @ x + plant.B @ u, -limit, limit)
    return kept & terminal.contains(x.T)


def _directions(n: int, points: Array, rng: np.random.Generator) -> Array:
    """Directions evenly spread in coordinates in which the points are round: in the plane 24, else 2n + 8 n."""
    root = np.linalg.cholesky(points @ points.T / points.shape[1] + 1e-12 * np.trace(points @ points.T) * np.eye(n))
    if n == 1:
        spread = np.array([[1.0], [-1.0]])
    elif n == 2:
        angle = 2 * np.pi * np.arange(24) / 24
        spread = np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        half = rng.standard_normal((4 * n, n))
        spread = np.vstack([np.eye(n), -np.eye(n), half, -half])
    return spread / np.linalg.norm(spread, axis=1, keepdims=True) @ np.linalg.inv(root)
