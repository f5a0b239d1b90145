"""Many simple polytopes at once, carried as vertices through affine maps: what a walk cuts, steps and measures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..brief import Brief
from ..sets import Box, Polytope, simplex
from .scatter import scattered

GAPS = np.linspace(-0.1, 0.1, 18)[1:-1]  # where a cut may be placed, in tolerances, so that it meets no vertex


@dataclass(frozen=True, eq=False)
class Cells(Brief):
    """N polytopes of starting points in R^n and where their points are now, with M vertices in all.

    A polytope is simple: each vertex lies on exactly n facets, so a vertex is known by its facets, and two vertices
    are ends of an edge exactly when they share n - 1. A hyperplane through no vertex cuts a simple polytope into two
    simple ones, whose new vertices are where it meets edges; so only this incidence is carried, and no convex hull is
    ever computed.

    owner (M,): the polytope of each vertex, ascending; facets (M, n): numbers of the facets it lies on, ascending; start
    (M, n) and now (M, n): where it began and where it is; planes (F, n + 1): with (a, b) = planes[f], facet 2 f stands for
    a x0 <= b and facet 2 f + 1 for a x0 >= b, in starting coordinates; center (N, n): a starting point of each polytope;
    motion (N, n, n + 1): the affine map from x0 - center to now; cost (N, n + 1, n + 1): the form c with cost(x0) =
    (x0 - center, 1)' c (x0 - center, 1). A center within keeps the terms of both as small as their sums, so that no digits
    are lost where motions spread apart.
    """

    owner: np.ndarray
    facets: np.ndarray
    start: Array
    now: Array
    planes: Array
    center: Array
    motion: Array
    cost: Array

    def __len__(self) -> int:
        return self.motion.shape[0]

    @property
    def size(self) -> int:
        """About how many bytes it takes to hold the polytopes and to find their edges (`paired`)."""
        M, n = self.facets.shape
        return M * n * (120 + n * n) + 8 * len(self) * (n + 1) * (2 * n + 1)

    @property
    def first(self) -> np.ndarray:
        """The first vertex (N,) of each polytope."""
        return np.searchsorted(self.owner, np.arange(len(self)))

    def highest(self, values: Array) -> Array:
        """Return the largest of values (M, ...) over the vertices of each polytope (N, ...)."""
        return np.maximum.reduceat(values, self.first, axis=0) if len(self) else values[:0]

    def lowest(self, values: Array) -> Array:
        """Return the smallest of values (M, ...) over the vertices of each polytope (N, ...)."""
        return np.minimum.reduceat(values, self.first, axis=0) if len(self) else values[:0]

    def middles(self) -> Array:
        """Return the mean (N, n) of each polytope's vertices where they are now: a point within."""
        if not len(self):
            return self.now[:0]
        counts = np.bincount(self.owner, minlength=len(self))
        return np.add.reduceat(self.now, self.first, axis=0) / counts[:, None]

    def take(self, which: np.ndarray) -> Cells:
        """Return the polytopes chosen by a mask (N,) or by indices, in ascending order."""
        chosen = np.zeros(len(self), dtype=bool)
        chosen[which] = True
        mine = chosen[self.owner]
        number = np.cumsum(chosen) - 1
        return Cells(number[self.owner[mine]], self.facets[mine], self.start[mine], self.now[mine], self.planes,
                     self.center[chosen], self.motion[chosen], self.cost[chosen])

    @staticmethod
    def joined_all(parts: list[Cells], planes: Array) -> Cells:
        """Return the polytopes of all parts in turn; `planes` is a table that continues each part's."""
        shifts = np.cumsum([0] + [len(part) for part in parts[:-1]])
        owner = np.concatenate([part.owner + shift for part, shift in zip(parts, shifts, strict=True)])
        names = ("facets", "start", "now")
        facets, start, now = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
        center, motion, cost = (np.concatenate([getattr(part, name) for part in parts])
                                for name in ("center", "motion", "cost"))
        return Cells(owner, facets, start, now, planes, center, motion, cost)

    def lifted(self) -> Array:
        """Return (x0 - center, 1), (M, n + 1), at the vertices."""
        return np.concatenate([self.start - self.center[self.owner], np.ones((len(self.owner), 1))], axis=1)

    def recentered(self) -> Cells:
        """Return the same cells with their centers in the middle of their vertices."""
        if not len(self):
            return self
        counts = np.bincount(self.owner, minlength=len(self))
        center = np.add.reduceat(self.start, self.first, axis=0) / counts[:, None]
        n = center.shape[1]
        shift = np.broadcast_to(np.eye(n + 1), (len(self), n + 1, n + 1)).copy()
        shift[:, :n, n] = center - self.center
        return replace(self, center=center, motion=self.motion @ shift, cost=np.swapaxes(shift, 1, 2) @ self.cost @ shift)


def whole(region: Box | Polytope) -> Cells:
    """Return a region as cells at rest: a box is one; of another polytope the triangulation's simplices are.

    >>> cells = whole(Box([-1.0, -1.0], [1.0, 1.0]))
    >>> len(cells), cells.start.shape, cells.facets[0].tolist()
    (1, (4, 2), [2, 6])
    """
    if isinstance(region, Box):
        corners = region.vertices.T
        raised = corners == region.upper
        facets = 4 * np.arange(region.dimension) + 2 * ~raised
        planes = np.stack([np.column_stack([np.eye(region.dimension), region.upper]),
                           np.column_stack([-np.eye(region.dimension), -region.lower])], axis=1)
        return _at_rest(np.zeros(len(corners), int), facets, corners, planes.reshape(-1, region.dimension + 1), 1)
    corners = region.simplices()
    N, size, n = corners.shape
    others = np.array([[j for j in range(size) if j != i] for i in range(size)])
    facets = 2 * (size * np.arange(N)[:, None, None] + others).reshape(-1, n)
    return _at_rest(np.repeat(np.arange(N), size), facets, corners.reshape(-1, n), _faces(corners), N)


def _faces(corners: Array) -> Array:
    """The planes (N (n + 1), n + 1) of simplices: that of face i is l_i >= 0 for the barycentric coordinate l_i."""
    lifted = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2)
    coordinates = np.linalg.inv(lifted)  # column i holds l_i as an affine function
    planes = np.swapaxes(coordinates, 1, 2).reshape(-1, corners.shape[1])
    return np.column_stack([-planes[:, :-1], planes[:, -1]])


def _at_rest(owner: np.ndarray, facets: np.ndarray, corners: Array, planes: Array, N: int) -> Cells:
    n = corners.shape[1]
    motion = np.broadcast_to(np.eye(n, n + 1), (N, n, n + 1)).copy()
    return Cells(owner, facets, corners, corners, planes, np.zeros((N, n)), motion, np.zeros((N, n + 1, n + 1))).recentered()


def cut(cells: Cells, height: Array, planes: Array, tolerance: Array) -> tuple[Cells, np.ndarray, Array]:
    """Cut each polytope in two where its own height passes 0, to within a tolerance; return pieces, parents and levels.

    height (M,): an affine function on each polytope, at its vertices, beyond the tolerance (N,) on both sides; planes
    (N, n + 1): the same as (a, b) with height = a x0 - b. The cut is made at level 0 or, where a vertex lies within a
    tenth of the tolerance of it, at the height within that tenth that is farthest from all vertices' heights: so it passes
    through none of them, and the pieces are simple again.

    The N lower halves come first, then the upper ones; the planes of the cuts are added to the table in the order of the
    cells.

    >>> box = whole(Box([0.0, 0.0], [1.0, 1.0]))
    >>> halves, parent, _ = cut(box, box.start[:, 0] - 0.25, np.array([[1.0, 0.0, 0.25]]), np.array([1e-12]))
    >>> [float(halves.highest(halves.start[:, 0])[i].round(9)) for i in (0, 1)], parent.tolist()
    ([0.25, 1.0], [0, 0])
    """
    N, level = len(cells), _free_level(cells, height, tolerance)
    height = height - level[cells.owner]
    low, high, shared = _crossed_edges(cells, height)
    share = (height[low] / (height[low] - height[high]))[:, None]
    start = (1 - share) * cells.start[low] + share * cells.start[high]
    now = (1 - share) * cells.now[low] + share * cells.now[high]
    owner = cells.owner[low]
    below = height < 0
    table = np.vstack([cells.planes, np.column_stack([planes[:, :-1], planes[:, -1] + level])])
    halves = []
    for half, side in enumerate((below, ~below)):
        everything = np.concatenate([cells.owner[side], owner]) + half * N
        facets = np.column_stack([shared, 2 * (len(cells.planes) + owner) + half])
        halves.append((everything, np.concatenate([cells.facets[side], facets]),
                       np.concatenate([cells.start[side], start]), np.concatenate([cells.now[side], now])))
    parts = [np.concatenate(pair) for pair in zip(*halves, strict=True)]
    order = np.argsort(parts[0], kind="stable")
    owners, facets, start, now = (part[order] for part in parts)
    parent = np.tile(np.arange(N), 2)
    pieces = Cells(owners, facets, start, now, table, cells.center[parent], cells.motion[parent], cells.cost[parent])
    return pieces.recentered(), parent, level


def in_start(cells: Cells, rows: Array, offset: Array) -> Array:
    """Return functions rows x + offset of the states now, (N, n) and (N,), as planes (N, n + 1), (a, b) with a x0 - b."""
    along = (rows[:, None, :] @ cells.motion)[:, 0]
    a = along[:, :-1]
    return np.column_stack([a, (a * cells.center).sum(axis=1) - along[:, -1] - offset])


def _free_level(cells: Cells, height: Array, tolerance: Array) -> Array:
    """The level (N,) near 0 that is farthest from all vertices' heights; 0 where no vertex is near."""
    near = cells.lowest(np.abs(height)) <= -GAPS[0] * tolerance
    level = np.zeros(len(cells))
    if near.any():
        rows = near[cells.owner]
        number = np.cumsum(near) - 1
        mine = number[cells.owner[rows]]
        candidates = tolerance[near, None] * GAPS
        distance = np.abs(height[rows, None] - candidates[mine])
        room = np.minimum.reduceat(distance, np.searchsorted(mine, np.arange(near.sum())), axis=0)
        level[near] = candidates[np.arange(len(room)), room.argmax(axis=1)]
    return level


def _crossed_edges(cells: Cells, height: Array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges with a lower and an upper end: the two vertices (E,), (E,) and the facets (E, n - 1) that they share."""
    low, high = edges(cells)
    crossed = (height[low] < 0) != (height[high] < 0)
    low, high = low[crossed], high[crossed]
    swap = height[low] >= 0
    low, high = np.where(swap, high, low), np.where(swap, low, high)
    facets = cells.facets[low]
    common = (facets[:, :, None] == cells.facets[high][:, None, :]).any(axis=2)
    return low, high, facets[common].reshape(len(low), facets.shape[1] - 1)


def edges(cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends (E,), (E,) of every edge: two vertices of one polytope that share all facets but one.

    Each vertex leaves out each of its facets in turn; what remains names one edge, and both its ends name it. That a name
    stands for one edge is checked (`paired`).

    >>> low, high = edges(whole(Box([0.0, 0.0, 0.0], [1.0, 1.0, 1.0])))
    >>> len(low)
    12
    """
    low, high, sound = paired(cells)
    assert sound, "the vertices do not close up to polytopes"
    return low, high


def paired(cells: Cells) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return pairs of vertices by the names of their edges, and whether each pair does share a polytope and n - 1 facets.

    The names are 64-bit sums of scattered facet numbers, so equal names may stand for different edges: hence the check.
    """
    M, n = cells.facets.shape
    codes = scattered(cells.facets)
    names = (codes.sum(axis=1, dtype=np.uint64) + scattered(cells.owner + (1 << 40)))[:, None] - codes
    order = np.argsort(names, axis=None, kind="stable")
    if M * n % 2:
        return order[:0], order[:0], False
    first, second = order[0::2], order[1::2]
    flat = names.reshape(-1)
    low, high = first // n, second // n
    same = (cells.facets[low][:, :, None] == cells.facets[high][:, None, :]).any(axis=2).sum(axis=1)
    sound = (flat[first] == flat[second]).all() and (same == n - 1).all() and (cells.owner[low] == cells.owner[high]).all()
    return low, high, bool(sound)


def moved(cells: Cells, A: Array, c: Array) -> Cells:
    """Return the cells after x -> A_i x + c_i on polytope i; A (N, n, n), c (N, n)."""
    now = (A[cells.owner] @ cells.now[:, :, None])[:, :, 0] + c[cells.owner]
    motion = A @ cells.motion
    motion[:, :, -1] += c
    return replace(cells, now=now, motion=motion)


def simplices_of(cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """Return a triangulation by vertex numbers (S, n + 1), and the polytope (S,) of each simplex.

    Pulling: each face is the cone from its first vertex over those of its facets that do not hold it, and each of these
    is treated alike. With one order of the vertices for all faces the cones fit together.

    >>> corners, owner = simplices_of(whole(Box([0.0, 0.0, 0.0], [1.0, 1.0, 1.0])))
    >>> corners.shape
    (6, 4)
    """
    M, n = cells.facets.shape
    item, vertex = cells.owner, np.arange(M)
    first = np.searchsorted(item, np.arange(len(cells)))
    apexes = vertex[first][:, None]
    left = cells.facets  # facets of each listed vertex that are not yet fixed
    for depth in range(n, 0, -1):
        tip = cells.facets[apexes[:, -1]]
        holds = (left[:, :, None] == tip[item][:, None, :]).any(axis=2)
        row, column = np.nonzero(~holds)
        key = item[row] * (2 * len(cells.planes) + 2) + left[row, column]
        order = np.argsort(key, kind="stable")
        row, column = row[order], column[order]
        starts = np.flatnonzero(np.diff(key[order], prepend=-1))
        number = np.zeros(len(order), int)
        number[starts[1:]] = 1
        rest = np.ones((len(row), depth), dtype=bool)
        rest[np.arange(len(row)), column] = False
        parent, left = item[row[starts]], left[row][rest].reshape(len(row), depth - 1)
        vertex, item = vertex[row], np.cumsum(number)
        apexes = np.column_stack([apexes[parent], vertex[starts]])
    return apexes, cells.owner[apexes[:, 0]]


def volumes(cells: Cells) -> Array:
    """Return the volumes (N,) of the polytopes of starting points, from a triangulation.

    >>> volumes(whole(Box([0.0, 0.0], [1.0, 2.0]))).round(12).tolist()
    [2.0]
    """
    if not len(cells):
        return np.zeros(0)
    corners, owner = simplices_of(cells)
    return np.bincount(owner, simplex.volumes(cells.start[corners]), minlength=len(cells))
