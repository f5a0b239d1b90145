"""The invariance of a region by exact pieces: where the law is affine, its half-spaces are extreme at vertices."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..arrays import Array
from ..claims.invariance import Invariance, Slacks
from .covering import covering
from .laws import Laws, PiecewiseLoop, heights
from .simplices import Simplices, begin
from .walk import Budget, one_pattern_each


def slacks_by_pieces(loop: PiecewiseLoop, claim: Invariance, budget: Budget | None = None) -> Slacks:
    """Return the slack of every half-space over the region, and the points where it is smallest.

    Simplices that cover the region (`covering`) are cut until each carries one pattern. There u is affine in x, so each
    t - E x - G u is smallest at a vertex. In Fractions nothing is rounded: `least` is exact for the simplices, which
    are the region itself or larger by 1e-11 at most. That each piece lies within its pattern's bounds is checked once
    more at the end, however the pieces were made; if not, or when no cover was found, `least` is -inf and `ended` says why.

    `least` and `reached` are in the loop's numbers.

    >>> from inc_casadi import INC, Box, Plant
    >>> loop = PiecewiseLoop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0))
    >>> slacks_by_pieces(loop, Invariance(Box([-1.0], [1.0]), Box([-2.0], [2.0]))).least.tolist()
    [1.0, 1.0, 0.5, 0.5]
    """
    budget, start = budget or Budget(), time.perf_counter()
    rows = claim.rows(loop.plant, loop.numbers)
    corners = covering(claim.region)
    if corners is None:
        return _unknown(rows.t.size, loop.plant.n, "no simplices were proved to cover the region", 0, start)
    whole, patterns = _one_law_each(loop, loop.numbers(corners), budget)
    distinct, which = loop.distinct(patterns)
    laws = loop.laws(distinct)
    if np.any(heights(laws, which, whole.now) > _allowed(loop, laws, whole.now)):
        why = f"the budget of {budget.pieces} pieces and {budget.seconds:g} s ended the cutting"
        return _unknown(rows.t.size, loop.plant.n, why, len(whole), start)
    u = whole.now @ np.swapaxes(laws.Gx[which], 1, 2) + laws.g[which][:, None, :]
    slack = rows.t - whole.now @ rows.E.T - u @ rows.G.T
    flat = slack.reshape(-1, rows.t.size)
    at = np.array([int(np.argmin(flat[:, i])) for i in range(rows.t.size)])
    least = flat[at, np.arange(rows.t.size)]
    points = whole.now.reshape(-1, loop.plant.n)[at].astype(float)
    return Slacks(least, least, points, "", len(whole), time.perf_counter() - start)


def _one_law_each(loop: PiecewiseLoop, corners: Array, budget: Budget) -> tuple[Simplices, np.ndarray]:
    """Cut simplices given by their corners until each carries one pattern, or the budget ends."""
    shares = loop.numbers(np.ones(len(corners)))
    alive = begin(corners, shares / len(corners))
    patterns = loop.patterns_at(alive.centroids())
    laws = loop.laws(loop.distinct(patterns)[0])
    size = np.zeros(loop.inc.q)
    if loop.arithmetic == "float":
        size = (np.abs(laws.Zx) @ np.abs(corners).max(axis=(0, 1)) + np.abs(laws.z0)).max(axis=0, initial=0.0)
    tags = np.zeros(len(alive), int)
    whole, _, patterns, _ = one_pattern_each(loop, alive, tags, patterns, size, budget, time.monotonic())
    gap = abs(whole.weight.sum() - loop.numbers(np.ones(1))[0])
    assert gap <= (0 if loop.arithmetic == "exact" else 1e-9), f"cutting lost or doubled {float(gap):.3g} of the region"
    return whole, patterns


def _allowed(loop: PiecewiseLoop, laws: Laws, points: Array) -> Any:
    """How far beyond a bound counts as on it: nothing in Fractions, in floats ten times what the cutting takes for it."""
    if loop.arithmetic != "float" or loop.inc.q == 0:
        return 0
    size = (np.abs(laws.Zx) @ np.abs(points).max(axis=(0, 1)) + np.abs(laws.z0)).max(axis=0, initial=0.0)
    return 10 * points.shape[1] * loop.kink_tolerance * np.tile(size, 2)


def _unknown(k: int, n: int, why: str, work: int, start: float) -> Slacks:
    return Slacks(np.full(k, -np.inf), np.full(k, np.inf), np.full((k, n), np.nan), why, work, time.perf_counter() - start)
