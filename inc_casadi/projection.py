"""Project a polytope of (x, v) on x: the points x for which some v keeps all half-spaces."""

from __future__ import annotations

import numpy as np

from .arrays import Array
from .errors import ConvergenceError, EmptySetError
from .linear_program import maximum
from .sets import Polytope

FACET_TOL = 1e-8  # a facet of the hull that no point exceeds by this share of the set's size is a facet of the projection
MOST_ROUNDS = 200


def projection(Hx: Array, Hv: Array, h: Array) -> Polytope:
    """Return the polytope {x: Hx x + Hv v <= h for some v} as the hull of its vertices; from within, up to rounding.

    A linear program finds the farthest x in a direction. The hull of the points found is a subset of the projection, by
    convexity; the normals of its facets are the next directions, and when no facet is exceeded it is the projection.

    Hx: (k, n); Hv: (k, r); h: (k,).

    Raises EmptySetError when there is no point, no interior or no bound, ConvergenceError after 200 rounds.

    >>> shadow = projection(np.array([[1.0], [-1.0], [0.0]]), np.array([[1.0], [0.0], [-1.0]]), np.array([2.0, 1.0, 0.0]))
    >>> shadow.vertices.round(9).tolist()
    [[-1.0, 2.0]]
    """
    n = Hx.shape[1]
    scale = np.abs(np.hstack([Hx, Hv])).max(axis=1)
    G, g = np.hstack([Hx, Hv]) / scale[:, None], h / scale
    directions = np.vstack([np.eye(n), -np.eye(n), np.ones((1, n)) / n])
    points = np.column_stack([_farthest(row, G, g) for row in directions])
    for _ in range(MOST_ROUNDS):
        hull = Polytope.from_vertices(_separate(points))
        news = []
        for row, bound in zip(hull.H, hull.h, strict=True):
            reach = _farthest(row, G, g)
            if row @ reach > bound + FACET_TOL * float(np.ptp(row @ hull.vertices)):
                news.append(reach)
        if not news:
            return hull
        points = np.column_stack([hull.vertices, *news])
    raise ConvergenceError(f"{MOST_ROUNDS} rounds did not find all facets of the projection to R^{n}")


def _farthest(row: Array, G: Array, g: Array) -> Array:
    n = len(row)
    size = float(np.max(np.abs(row)))
    best = maximum(np.append(row / size, np.zeros(G.shape[1] - n)), G, g)
    if best is None:
        raise EmptySetError("the projection is empty: no point satisfies all half-spaces")
    if not np.isfinite(best.value):
        raise EmptySetError(f"the projection is unbounded in the direction {np.round(row, 6).tolist()}")
    return best.point[:n]


def _separate(points: Array) -> Array:
    """Points without repetitions, to 1e-9 of their spread."""
    spread = np.ptp(points, axis=1).max() or 1.0
    _, first = np.unique(np.round(points / spread, 9), axis=1, return_index=True)
    return points[:, np.sort(first)]
