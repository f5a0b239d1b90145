"""Many simplices at once, carried as vertices through affine maps, with the probability and the cost they hold."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields
from math import comb
from typing import Any

import numpy as np

from ..arrays import Array
from ..brief import Brief


@dataclass(frozen=True, eq=False)
class Simplices(Brief):
    """N simplices in R^n, each the image of a simplex of starting points under one affine map.

    now (N, n+1, n): the vertices where they are; start (N, n+1, n): the vertices where they began; weight (N,): the
    probability of starting in them; cost (N, n+1, n+1): the symmetric form c with cost(x0) = l' c l, for the
    barycentric coordinates l of x0. Affine maps keep barycentric coordinates, so all integrals over starting
    points are closed forms in the vertices, even when the image is flat.
    """

    now: Array
    start: Array
    weight: Array
    cost: Array

    def __len__(self) -> int:
        return self.weight.shape[0]

    def take(self, which: np.ndarray) -> Simplices:
        """Return the simplices chosen by an index or mask array."""
        return Simplices(*(getattr(self, f.name)[which] for f in fields(self)))

    def joined(self, *others: Simplices) -> Simplices:
        """Return these simplices followed by the others."""
        return Simplices(*(np.concatenate([getattr(part, f.name) for part in (self, *others)]) for f in fields(self)))

    def centroids(self) -> Array:
        """Return the centroids (N, n) of the current simplices."""
        return self.now.sum(axis=1) / self.now.shape[1]

    def split(self, i: np.ndarray, j: np.ndarray, t: Array) -> Simplices:
        """Cut each simplex at the point (1 - t) v_i + t v_j of its edge i-j, 0 < t < 1, into two.

        The first N results keep vertex i and hold the share t of the weight, the next N keep vertex j.
        """
        return self._half(i, j, t, keep_i=True).joined(self._half(i, j, t, keep_i=False))

    def _half(self, i: np.ndarray, j: np.ndarray, t: Array, keep_i: bool) -> Simplices:
        rows = np.arange(len(self))
        gone = j if keep_i else i

        def mixed(values: Array) -> Array:
            s = t.reshape(-1, *(1,) * (values.ndim - 2))
            return (1 - s) * values[rows, i] + s * values[rows, j]

        now, start, cost = self.now.copy(), self.start.copy(), self.cost.copy()
        now[rows, gone], start[rows, gone] = mixed(self.now), mixed(self.start)
        row = mixed(self.cost)
        corner = (1 - t) * row[rows, i] + t * row[rows, j]
        cost[rows, gone, :], cost[rows, :, gone] = row, row
        cost[rows, gone, gone] = corner
        return Simplices(now, start, self.weight * (t if keep_i else 1 - t), cost)

    def expected_cost(self) -> Any:
        """Return sum over simplices of weight times the mean of l' c l: E l_i l_j = (1 + [i = j]) / ((n+1)(n+2)).

        >>> edge = Simplices(np.zeros((1, 2, 1)), np.zeros((1, 2, 1)), np.ones(1), np.array([[[0., 0.], [0., 1.]]]))
        >>> round(float(edge.expected_cost()), 12)
        0.333333333333
        """
        size = self.cost.shape[1]
        trace = self.cost[:, np.arange(size), np.arange(size)].sum(axis=1)
        return (self.weight * (self.cost.sum(axis=(1, 2)) + trace)).sum() / (size * (size + 1))

    def worst_cost(self) -> tuple[Any, Array]:
        """Return the largest cost over all starting points, and a point (n,) where it is attained.

        On each simplex the cost is a sum of squares, so l' c l is convex and its maximum lies at a vertex.
        """
        size = self.cost.shape[1]
        corners = self.cost[:, np.arange(size), np.arange(size)]
        flat = int(np.argmax(corners))
        return corners.flat[flat], self.start.reshape(-1, self.start.shape[2])[flat]


def begin(vertices: Array, weight: Array) -> Simplices:
    """Return simplices at rest at their starting points with no cost yet; vertices (N, n+1, n), weight (N,)."""
    N, size, _ = vertices.shape
    zero = vertices[:, :1, :1] * 0
    return Simplices(vertices, vertices, weight, np.broadcast_to(zero, (N, size, size)).copy())


def cut_along(simplices: Simplices, height: Array) -> tuple[Simplices, np.ndarray, int]:
    """Cut each simplex along its own hyperplane until no piece has points on both sides; return pieces, parents, depth.

    height (N, n+1): a height over the hyperplane, affine on each simplex, at its vertices. An edge that crosses is cut
    where the height is 0, and the piece's new vertex has that height exactly. Each cut takes a vertex off one side of
    the piece, so this ends; and a hyperplane once cut along is never crossed again by any part of the piece.

    >>> edge = begin(np.array([[[-1.0], [3.0]]]), np.ones(1))
    >>> pieces, parent, depth = cut_along(edge, np.array([[-1.0, 3.0]]))
    >>> pieces.start[:, :, 0].tolist(), pieces.weight.tolist(), parent.tolist(), depth
    ([[-1.0, 0.0], [0.0, 3.0]], [0.25, 0.75], [0, 0], 1)
    """
    parent, parts, parents = np.arange(len(simplices)), [], []
    while True:
        crossing = (height.max(axis=1) > 0) & (height.min(axis=1) < 0)
        parts.append(simplices.take(~crossing))
        parents.append(parent[~crossing])
        if not crossing.any():
            return parts[0].joined(*parts[1:]), np.concatenate(parents), len(parts) - 1
        simplices, height, parent = simplices.take(crossing), height[crossing], np.tile(parent[crossing], 2)
        i, j = steepest_crossing_edge(height)
        rows = np.arange(len(simplices))
        simplices = simplices.split(i, j, height[rows, i] / (height[rows, i] - height[rows, j]))
        height = np.concatenate([height, height])
        height[rows, j], height[len(rows) + rows, i] = 0, 0


def pieces_of_cuts(height: Array) -> int:
    """Return how many pieces `cut_along` makes of simplices with these heights (N, n+1), counted without cutting.

    With k vertices below and l above there are C(k + l, k): a cut puts one of either in the hyperplane, which leaves
    (k - 1, l) and (k, l - 1), and Pascal's rule adds up.

    >>> height = np.array([[-1.0, 3.0, 2.0, -2.0], [0.0, 1.0, 1.0, 1.0]])
    >>> pieces_of_cuts(height), len(cut_along(begin(np.eye(4)[None, :, :3].repeat(2, axis=0), np.ones(2)), height)[0])
    (7, 7)
    """
    below, above = (height < 0).sum(axis=1), (height > 0).sum(axis=1)
    return sum(int(count) * comb(int(k + l), int(k))
               for (k, l), count in zip(*np.unique(np.column_stack([below, above]), axis=0, return_counts=True),
                                        strict=True))


def steepest_crossing_edge(height: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return for each simplex the edge (i, j) with height[i] < 0 < height[j] along which height changes most.

    height (N, k), with at least one such edge in every row. Measured against cutting the longest edge, the one nearest
    to its middle, or the shortest, this leaves the fewest simplices.
    """
    return height.argmin(axis=1), height.argmax(axis=1)


def levelled(vertices: Array, lower: Array, upper: Array, gain: Array) -> Array:
    """Return a box's Kuhn triangulation (N, n+1, n), mirrored so that its long diagonal runs along levels of gain x.

    All simplices share that diagonal, and one that hardly changes u is seldom cut. Coordinates are swapped between
    lower and upper (n,), never computed. gain (m, n).
    """
    n = lower.size
    signs = np.array([(1, *rest) for rest in itertools.product((1, -1), repeat=n - 1)])
    climb = np.abs(gain @ ((upper - lower) * signs).T).sum(axis=0)
    mirrored = signs[int(np.argmin(climb))] < 0
    return np.where(mirrored & (vertices == lower), upper, np.where(mirrored, lower, vertices))
