"""Prove in Fractions that half-spaces imply another one: Farkas' multipliers, found in floats and repaired exactly."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from .arrays import Array
from .blocks import exact
from .exact import solve
from .linear_program import maximum

PUSHES = (0.0, 1e-12, 1e-10)  # how far the multipliers are moved off zero, so that the repair cannot make one negative


def is_implied(G: Array, g: Array, rows: Array, bounds: Array) -> bool:
    """Return whether {x: G x <= g} lies in {x: rows x <= bounds}, proved in exact arithmetic; sufficient.

    For each row a with bound b, y >= 0 with G'y = a and g'y <= b gives a'x = y'G x <= y'g <= b. A linear program
    proposes y; it is moved off zero along a strictly positive y0 with G'y0 = 0 (there is one when the set is bounded), and
    n of its entries, at independent rows, then take up the residual a - G'y exactly. The verdict rests on these
    Fractions alone. False means undecided: a row that only just holds, with more than n half-spaces meeting where it does,
    may leave too little room for the repair.

    G: (k, n) and g: (k,), floats or Fractions, a bounded set with a point; rows: (l, n); bounds: (l,).

    >>> square = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    >>> is_implied(square, np.ones(4), np.array([[0.5, 0.5]]), np.ones(1))
    True
    >>> is_implied(square, np.ones(4), np.array([[0.5, 0.5]]), np.array([1 - 1e-15]))
    False
    """
    return unproved(G, g, rows, bounds) is None


def unproved(G: Array, g: Array, rows: Array, bounds: Array) -> int | None:
    """Return the index of the first row that `is_implied` does not prove, or None.

    >>> unproved(np.array([[1.0], [-1.0]]), np.ones(2), np.array([[1.0], [2.0]]), np.array([1.0, 1.5]))
    1
    """
    positive = _positive_combination(G.astype(float))
    G_exact, g_exact = exact(G), exact(g)
    for i, (row, bound) in enumerate(zip(exact(rows), exact(bounds), strict=True)):
        if not _one_is_implied(G_exact, g_exact, row, bound, positive):
            return i
    return None


def _one_is_implied(G: np.ndarray, g: np.ndarray, row: np.ndarray, bound: Fraction, positive: Array | None) -> bool:
    if not row.any():
        return bool(bound >= 0)
    size = max(abs(float(entry)) for entry in row)
    scale = np.array([max(abs(float(entry)) for entry in each) or 1.0 for each in G])
    best = maximum(row.astype(float) / size, G.astype(float) / scale[:, None], g.astype(float) / scale)
    if best is None or not np.isfinite(best.value):
        return False
    proposal = best.multipliers * size / scale
    basis = _independent_rows(G.astype(float), proposal)
    pushes = PUSHES if positive is not None else PUSHES[:1]
    for push in pushes:
        moved = proposal if positive is None else proposal + push * max(float(proposal.max()), 1e-300) * positive
        y = exact(moved)
        repair = None if basis is None else solve(G[basis].T, row - y @ G)
        if repair is None:
            return False
        y[basis] = y[basis] + repair
        if all(entry >= 0 for entry in y) and y @ g <= bound:
            return True
    return False


def _independent_rows(G: Array, weight: Array) -> np.ndarray | None:
    """Indices of n independent rows, those of large weight first; None when the rows do not span R^n."""
    n = G.shape[1]
    chosen: list[int] = []
    rest = G / np.linalg.norm(G, axis=1, keepdims=True)
    heavy = weight > 1e-9 * weight.max(initial=0.0)
    for _ in range(n):
        # Among rows with weight, then among the others, the one farthest from the span of those chosen.
        left = np.linalg.norm(rest, axis=1)
        score = np.where(heavy & (left > 1e-6), 1.0 + left, left)
        best = int(np.argmax(score))
        if left[best] <= 1e-9:
            return None
        chosen.append(best)
        direction = rest[best] / left[best]
        rest = rest - np.outer(rest @ direction, direction)
    return np.array(chosen)


def _positive_combination(G: Array) -> Array | None:
    """A y0 > 0 with G'y0 about 0, its largest entry 1 in size; None when there is none, so when the set is unbounded."""
    from scipy.optimize import linprog

    k, n = G.shape
    norms = np.linalg.norm(G, axis=1)
    if np.any(norms == 0):
        return None
    # Maximize t over y >= t, y <= 1, (rows of unit length)' y = 0.
    unit = G / norms[:, None]
    outcome = linprog(np.append(np.zeros(k), -1.0), A_ub=np.column_stack([-np.eye(k), np.ones(k)]), b_ub=np.zeros(k),
                      A_eq=np.column_stack([unit.T, np.zeros(n)]), b_eq=np.zeros(n),
                      bounds=[(0, 1)] * k + [(None, 1)], method="highs")
    return outcome.x[:-1] / norms if outcome.status == 0 and outcome.x[-1] > 0 else None
