"""Linear programs over half-spaces, {x: G x <= g}: the largest value of a row, where it is taken, and its multipliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Array
from .errors import SolverError

LP_TOL = 1e-10  # feasibility asked of HiGHS, the smallest it accepts; absolute, so callers scale their rows first


@dataclass(frozen=True, eq=False)
class Optimum:
    """The maximum of row'x over G x <= g: value (infinite when unbounded), point (n,), multipliers (k,) >= 0.

    The multipliers y have G'y = row and g'y = value up to the solver's tolerance: they are a proposal for a proof, and
    `implied.is_implied` turns them into one.
    """

    value: float
    point: Array
    multipliers: Array


def maximum(row: Array, G: Array, g: Array) -> Optimum | None:
    """Return the maximum of row'x over {x: G x <= g}, or None when no x satisfies G x <= g.

    row: (n,); G: (k, n); g: (k,), all of size about one, since the tolerances are absolute.

    Raises SolverError when HiGHS ends without an answer.

    >>> found = maximum(np.array([1.0, 1.0]), np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]), np.array([1.0, 2.0, 9.0]))
    >>> round(found.value, 9), found.multipliers.round(9).tolist()
    (3.0, [1.0, 1.0, 0.0])
    """
    from scipy.optimize import linprog

    n, k = G.shape[1], G.shape[0]
    options = {"primal_feasibility_tolerance": LP_TOL, "dual_feasibility_tolerance": LP_TOL}
    outcome = linprog(-row, A_ub=G, b_ub=g, bounds=(None, None), method="highs", options=options)
    if outcome.status == 4:  # often "unbounded or infeasible": without presolve HiGHS tells which
        outcome = linprog(-row, A_ub=G, b_ub=g, bounds=(None, None), method="highs", options=options | {"presolve": False})
    if outcome.status == 2:
        return None
    if outcome.status == 3:
        return Optimum(np.inf, np.full(n, np.nan), np.zeros(k))
    if outcome.status != 0:
        raise SolverError(f"a linear program over {k} half-spaces in R^{n} was not solved: {outcome.message}")
    return Optimum(float(row @ outcome.x), np.asarray(outcome.x), np.maximum(-outcome.ineqlin.marginals, 0.0))


def irredundant(G: Array, g: Array, tol: float) -> np.ndarray:
    """Return a mask (k,) of half-spaces that keeps the set {x: G x <= g} up to `tol`.

    A row is dropped when its maximum over the rows that are left is at most g + tol, one after the other, so of equal rows
    one stays. Rows of size about one; the set must not be empty.

    >>> irredundant(np.array([[1.0], [2.0], [-1.0]]), np.array([1.0, 2.0, 1.0]), 1e-9).sum()
    np.int64(2)
    """
    keep = np.ones(len(g), dtype=bool)
    for i in range(len(g)):
        keep[i] = False
        best = maximum(G[i], G[keep], g[keep]) if keep.any() else None
        keep[i] = best is None or best.value > g[i] + tol
    return keep
