"""All vertices of {x: H x <= h} in exact arithmetic, each provably found, and simplices that fill it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..sets import Box, Polytope

MOST_EDGES = 10_000  # lines tried before the search for vertices is given up


@dataclass(frozen=True, eq=False)
class Corners:
    """The vertices of {x: H x <= h}: points (V, n) of Fractions, and incident (V, k), where H x = h."""

    points: np.ndarray
    incident: np.ndarray


def corners(region: Box | Polytope) -> Corners | str:
    """Return the vertices of the polytope whose half-spaces are the stored floats, or why they were not listed.

    The search walks along edges. Every edge at a vertex lies on a line that n - 1 independent half-spaces through the
    vertex define, so all of them are tried; and since the vertices and edges of a polytope form a connected graph, no
    vertex is missed, however many half-spaces meet in one.

    >>> corners(Box([-1, 0], [1, 0.5])).points.astype(float).tolist()
    [[1.0, 0.5], [1.0, 0.0], [-1.0, 0.5], [-1.0, 0.0]]
    """
    H, h = exact(region.H), exact(region.h)
    first = _first(H, h, exact(region.vertices.mean(axis=1)))
    if first is None:
        return "the mean of the stored vertices of a polytope is not inside it"
    known, waiting, tried = {tuple(first): first}, [first], 0
    while waiting:
        x = waiting.pop()
        for other in _neighbours(H, h, x):
            tried += 1
            if tried > MOST_EDGES:
                return f"more than {MOST_EDGES} edges of a polytope of {len(h)} half-spaces"
            if other is not None and tuple(other) not in known:
                known[tuple(other)] = other
                waiting.append(other)
    points = np.array(list(known.values()), dtype=object)
    return Corners(points, points @ H.T == h)


def tiling(found: Corners) -> np.ndarray:
    """Return indices (S, n + 1) of vertices whose simplices fill the polytope without overlap.

    A face is filled by the cones from its first vertex over its facets that do not contain it, and so on down (a pulling
    triangulation). The facets of a face are the largest of its proper intersections with half-spaces.

    >>> len(tiling(corners(Box([0, 0, 0], [1, 1, 1]))))
    6
    """
    sides = {frozenset(np.flatnonzero(column).tolist()) for column in found.incident.T}
    everything = frozenset(range(len(found.points)))
    return np.array(list(_pulled(everything, found.points.shape[1], sides)), dtype=int)


def _pulled(face: frozenset[int], dimension: int, sides: set[frozenset[int]]) -> Iterator[tuple[int, ...]]:
    if len(face) == dimension + 1:
        yield tuple(sorted(face))
        return
    apex = min(face)
    parts = {face & side for side in sides} - {face}
    for part in parts:
        if apex not in part and not any(part < other for other in parts):
            for simplex in _pulled(part, dimension - 1, sides):
                yield (apex, *simplex)


def _first(H: np.ndarray, h: np.ndarray, x: np.ndarray) -> np.ndarray | None:
    # From a point inside along a line to the nearest half-space, then within that one, n times: each is a new direction.
    if np.any(H @ x > h):
        return None
    met: list[int] = []
    for _ in range(len(x)):
        direction, _ = orthogonal(H[met])
        step, nearest = _reach(H, h, x, direction)
        x = x + step * direction
        met.append(nearest)
    return x


def _neighbours(H: np.ndarray, h: np.ndarray, x: np.ndarray) -> Iterator[np.ndarray | None]:
    # The other end of every edge at the vertex x; x itself for a line that leaves at once, None where there is no line.
    through = np.flatnonzero(H @ x == h)
    for chosen in combinations(through, len(x) - 1):
        direction, freedom = orthogonal(H[list(chosen)])
        for way in (direction, -direction):
            yield x + _reach(H, h, x, way)[0] * way if freedom == 1 else None


def _reach(H: np.ndarray, h: np.ndarray, x: np.ndarray, direction: np.ndarray) -> tuple[Fraction, int]:
    approach = H @ direction
    ahead = np.flatnonzero(approach > 0)
    steps = (h[ahead] - H[ahead] @ x) / approach[ahead]
    nearest = min(range(len(ahead)), key=lambda i: steps[i])
    return steps[nearest], int(ahead[nearest])


def orthogonal(rows: Array) -> tuple[np.ndarray, int]:
    """Return a vector (n,) != 0 of Fractions with rows @ vector = 0, and the dimension of all of them, at least 1.

    rows: (r, n) of Fractions, of a rank below n; zero and dependent rows do no harm.

    >>> orthogonal(exact(np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 1.0]])))
    (array([Fraction(-2, 1), Fraction(1, 1), Fraction(0, 1)], dtype=object), 1)
    """
    table, n = rows.copy(), rows.shape[1]
    pivots: list[int] = []
    for column in range(n):
        left = [i for i in range(len(pivots), len(table)) if table[i, column] != 0]
        if not left:
            continue
        table[[len(pivots), left[0]]] = table[[left[0], len(pivots)]]
        pivot = table[len(pivots)] / table[len(pivots), column]
        table = table - np.outer(table[:, column], pivot)
        table[len(pivots)] = pivot
        pivots.append(column)
    free = next(column for column in range(n) if column not in pivots)
    vector = np.full(n, Fraction(0), dtype=object)
    vector[free] = Fraction(1)
    vector[pivots] = -table[:len(pivots), free]
    return vector, n - len(pivots)
