"""What each step of a walk over polytopes says of its cells: in floats where that is clear, with 256 places where not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..claims.regional import Regional
from .cell_motions import Motions, PlacedLaws
from .cell_walk import CellWalk
from .places import Places, floats, placed, times

CLEAR = 1e-9  # in floats, what lies within a bound by this share of its terms certainly does
OUTWARD = 1e-12  # a share that is more than the rounding of a float value, relative to its terms
MOST_NUMBERS = 2_000_000  # tables over the vertices of one block hold at most so many


@dataclass(frozen=True, eq=False)
class Passage:
    """How k cells pass one step.

    cells, law (k,): which cells and by which laws; beyond (k, q): how far z of a cell's own law lies beyond its piece at
    most, negative where it is within; x (k, n), u (k, m): magnitudes of states and inputs at most; slack (k,): the smallest
    h - H u at the vertices, infinite without limits.
    """

    cells: np.ndarray
    law: np.ndarray
    beyond: Array
    x: Array
    u: Array
    slack: Array


class FloatLaws(NamedTuple):
    """The laws in floats; ends that there are none of are infinite."""

    Zx: Array
    z0: Array
    Gx: Array
    g: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Passages:
    """All steps of a walk's cells, ready to be worked out in blocks.

    walk: the complete walk; claim: for its input limits; laws, moved: with 256 places; points (M, n): the vertices.
    """

    walk: CellWalk
    claim: Regional
    laws: PlacedLaws
    moved: Motions
    points: Places

    @property
    def steps(self) -> int:
        """The number of steps until the last cell arrived."""
        return int(self.walk.steps_taken.max(initial=0))

    @cached_property
    def chain(self) -> np.ndarray:
        """The node of each cell at each step, (steps + 1, N), -1 once it has arrived."""
        walk, chain = self.walk, np.full((self.steps + 1, len(self.walk.arrived)), -1)
        chain[walk.steps_taken, np.arange(len(walk.arrived))] = walk.node
        for step in range(self.steps, 0, -1):
            under_way = chain[step] >= 0
            chain[step - 1, under_way] = walk.trails.parent[chain[step, under_way]]
        return chain

    def blocks(self, step: int) -> Iterator[np.ndarray]:
        """Yield the cells under way at a step in blocks of like laws, small enough for tables over their vertices."""
        after = self.chain[step + 1]
        cells = np.flatnonzero(after >= 0)
        cells = cells[np.argsort(self.walk.trails.pattern[after[cells]], kind="stable")]
        q, n = self.laws.z0.shape[1], self.points.shape[1]
        most = max(1, MOST_NUMBERS // ((q + n + 1) * n))
        ends = np.cumsum(self._counts[cells]) // most
        yield from (part for part in np.split(cells, np.flatnonzero(np.diff(ends)) + 1) if part.size)

    def passage(self, step: int, cells: np.ndarray) -> Passage:
        """Return how cells, like laws side by side, pass a step."""
        at, after = self.chain[step, cells], self.chain[step + 1, cells]
        law = self.walk.trails.pattern[after]
        vertex, cell, first = self._vertices(cells)
        x, reach = self._states(at, vertex, cell)
        beyond = np.maximum.reduceat(self._beyond(after, vertex, cell, x, reach), first, axis=0)
        u, u_terms = _affine(self._float.Gx[law][cell], self._float.g[law][cell], x, reach)
        slack = np.full(len(cells), np.inf)
        if self.claim.inputs is not None:
            slack = np.minimum.reduceat(self._room(after, vertex, cell, u, u_terms).min(axis=1), first)
        x, u = np.abs(x) + OUTWARD * reach, np.abs(u) + OUTWARD * u_terms
        x, u = (np.maximum.reduceat(part, first, axis=0) for part in (x, u))
        return Passage(cells, law, beyond, x, u, slack)

    def ends(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, Array, Array, np.ndarray]:
        """Return the vertices of cells, the cell of each, where they arrive, the terms of that, each cell's first."""
        vertex, cell, first = self._vertices(cells)
        return vertex, cell, *self._states(self.walk.node[cells], vertex, cell), first

    def _vertices(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        counts = self._counts[cells]
        first = np.cumsum(counts) - counts
        cell = np.repeat(np.arange(len(cells)), counts)
        return (np.cumsum(self._counts) - self._counts)[cells][cell] + np.arange(len(cell)) - first[cell], cell, first

    def _states(self, at: np.ndarray, vertex: np.ndarray, cell: np.ndarray) -> tuple[Array, Array]:
        F, f = self.F[at][cell], self.f[at][cell]
        rough = self._rough[vertex, :, None]
        return (F @ rough)[:, :, 0] + f, (np.abs(F) @ np.abs(rough))[:, :, 0] + np.abs(f)

    def _beyond(self, after: np.ndarray, vertex: np.ndarray, cell: np.ndarray, x: Array, reach: Array) -> Array:
        """How far z (M, q) lies beyond the nearer end of its piece at most.

        A float z is off by some 2 n + 5 roundings of its terms, so that one that is below an end by 1e-9 of them, raised by
        as much, bounds the true one from above; the others are taken with 256 places.
        """
        law = self.walk.trails.pattern[after][cell]
        out = np.full((len(vertex), self.laws.z0.shape[1]), -np.inf)
        for ends, rough, sign in ((self.laws.low, self._float.low, -1), (self.laws.high, self._float.high, 1)):
            row, unit = self._rough_beyond(out, rough, sign, law, x, reach)
            if row.size:
                value = self._height(ends, after, vertex[row], cell[row], unit)
                out[row, unit] = np.maximum(out[row, unit], sign * value + OUTWARD * np.abs(value))
        return out

    def _rough_beyond(self, out: Array, ends: Array, sign: int, law: np.ndarray, x: Array,
                      reach: Array) -> tuple[np.ndarray, np.ndarray]:
        """Raise entries of out to how far z is beyond lower (-1) or upper ends (1); return those that floats leave open."""
        rows, units = [], []
        begins = np.flatnonzero(np.diff(law, prepend=-1))
        for begin, stop in zip(begins, [*begins[1:], len(law)], strict=True):
            group, own = slice(begin, stop), law[begin]
            there = np.flatnonzero(np.isfinite(ends[own]))
            Z, z0, end = self._float.Zx[own, there], self._float.z0[own, there], ends[own, there]
            room = CLEAR * (reach[group] @ np.abs(Z).T + (np.abs(z0) + np.abs(end)))
            height = sign * (x[group] @ Z.T + (z0 - end)) + room
            row, column = np.nonzero(height > 0)
            height[row, column] = -np.inf
            out[group, there] = np.maximum(out[group, there], height)
            rows.append(begin + row)
            units.append(there[column])
        return np.concatenate(rows), np.concatenate(units)

    def _height(self, ends: Places, after: np.ndarray, vertex: np.ndarray, cell: np.ndarray, unit: np.ndarray) -> Array:
        """z - end of units at vertices of cells."""
        q = ends.shape[1]
        key, which = np.unique(after[cell] * q + unit, return_inverse=True)
        node, law, unit = self.walk.trails.parent[key // q], self.walk.trails.pattern[key // q], key % q
        return self._values(node, self.laws.Zx[law, unit], self.laws.z0[law, unit] - ends[law, unit], which.reshape(-1),
                            vertex)

    def _room(self, after: np.ndarray, vertex: np.ndarray, cell: np.ndarray, u: Array, u_terms: Array) -> Array:
        """The room h - H u (M, k) at least."""
        assert self.claim.inputs is not None
        H, h = np.asarray(self.claim.inputs.H), np.asarray(self.claim.inputs.h)
        terms = np.abs(h) + u_terms @ np.abs(H).T
        room = h - u @ H.T - CLEAR * terms
        row, limit = np.nonzero(room <= 0)
        if row.size:
            key, which = np.unique(after[cell[row]] * len(h) + limit, return_inverse=True)
            node, pattern, k = self.walk.trails.parent[key // len(h)], self.walk.trails.pattern[key // len(h)], key % len(h)
            rows = placed(H)[k][:, None, :]
            gradient = times(rows, self.laws.Gx[pattern])[:, 0]
            offset = times(rows, self.laws.g[pattern][:, :, None])[:, 0, 0] - placed(h)[k]
            value = self._values(node, gradient, offset, which.reshape(-1), vertex[row])
            room[row, limit] = -value - OUTWARD * np.abs(value)
        return room

    def _values(self, node: np.ndarray, gradient: Places, offset: Places, which: np.ndarray, vertex: np.ndarray) -> Array:
        """gradient (F v + f) + offset at vertices v, in floats: planes in x0 first, which many vertices share."""
        along = times(gradient[:, None, :], self.moved.F[node])[:, 0]
        beyond = times(gradient[:, None, :], self.moved.f[node][:, :, None])[:, 0, 0] + offset
        return floats(times(along[which][:, None, :], self.points[vertex][:, :, None])[:, 0, 0] + beyond[which])

    @cached_property
    def F(self) -> Array:
        """The linear parts of the maps of all nodes in floats."""
        return floats(self.moved.F)

    @cached_property
    def f(self) -> Array:
        """Their constants."""
        return floats(self.moved.f)

    @cached_property
    def _rough(self) -> Array:
        return floats(self.points)

    @cached_property
    def _counts(self) -> np.ndarray:
        return np.bincount(self.walk.arrived.owner, minlength=len(self.walk.arrived))

    @cached_property
    def _float(self) -> FloatLaws:
        laws = self.laws
        return FloatLaws(floats(laws.Zx), floats(laws.z0), floats(laws.Gx), floats(laws.g),
                         _with_infinity(laws.low, -1), _with_infinity(laws.high, 1))


def _affine(gradient: Array, offset: Array, x: Array, reach: Array) -> tuple[Array, Array]:
    """gradient x + offset at vertices of cells, and the sum of the magnitudes of its terms."""
    value = (gradient @ x[:, :, None])[:, :, 0] + offset
    return value, (np.abs(gradient) @ reach[:, :, None])[:, :, 0] + np.abs(offset)


def _with_infinity(ends: Places, sign: int) -> np.ndarray:
    there = ends != None  # noqa: E711  # asked of each entry
    out = np.full(ends.shape, sign * np.inf)
    out[there] = floats(ends[there])
    return out
