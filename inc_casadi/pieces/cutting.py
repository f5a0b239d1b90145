"""Cut polytopes until the controller is one affine law on each: the step that walks, reachable sets and regions share."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .cells import Cells, cut, in_start, moved
from .laws import Laws, PiecewiseLoop

TOLERANCE = 1e-12  # a z this close to a kink counts as on it, relative to the terms that z is summed from
MOST_NUMBERS = 4_000_000  # heights are worked out for so many vertices at once that no table holds more numbers
MOST_BYTES = 2**30  # that polytopes, and the tables that find their edges, may take


@dataclass(frozen=True)
class Deadline:
    """When cutting must stop: before there are more than `pieces` polytopes, `done` of them elsewhere; before a GiB is
    used; or after `seconds` from `start`."""

    pieces: int
    seconds: float
    start: float
    done: int = 0

    def passed(self, pieces: int, size: int = 0) -> str:
        """Why there must not be so many pieces of so many bytes (`Cells.size`) now, or an empty string.

        >>> Deadline(10, float("inf"), 0.0, done=4).passed(7)
        'more than 10 pieces'
        """
        if self.done + pieces > self.pieces:
            return f"more than {self.pieces} pieces"
        if size > MOST_BYTES:
            return f"more than {MOST_BYTES / 2**30:g} GiB for the vertices of {pieces} pieces"
        return f"the time limit of {self.seconds:g} s" if time.monotonic() - self.start > self.seconds else ""


@dataclass(frozen=True, eq=False)
class Split:
    """Cells on each of which the controller is the law of one pattern, unless `ended` says that cutting was stopped.

    parent (N,): the cell that each came from; patterns (N, q); cuts: what each new plane of the table was made from;
    size (q,): the magnitude of z met so far.
    """

    cells: Cells
    parent: np.ndarray
    patterns: np.ndarray
    cuts: Cuts
    size: Array
    ended: str


@dataclass(frozen=True, eq=False)
class Cuts:
    """What C cuts were made along: z of a unit at an end of its piece, plus a level, under the law of a pattern.

    parent (C,): the cell that was there before any cut; patterns (C, q); bound (C,): which of the 2q ends, the lower ones
    first; level (C,): how far beyond it.
    """

    parent: np.ndarray
    patterns: np.ndarray
    bound: np.ndarray
    level: Array

    def __len__(self) -> int:
        return len(self.parent)


def one_law_each(loop: PiecewiseLoop, cells: Cells, guess: np.ndarray | None, size: Array, deadline: Deadline) -> Split:
    """Cut cells until the law of the pattern at the middle of each holds at all its vertices, hence everywhere on it.

    If some vertex lies beyond a bound of the pattern's piece, another lies within it, because their mean does. The cell
    is cut where the law's z meets the bound that is passed the farthest, to within a tolerance: there the law of the
    neighbouring piece takes over, and neither half passes that bound again. There are finitely many patterns, so this ends.

    guess (N, q): patterns to start from, or None; size (q,): the magnitude of z met so far, that of these cells is added:
    the tolerance is relative to it.
    """
    parent, ready, ended = np.arange(len(cells)), [], ""
    made = [Cuts(parent[:0], np.zeros((0, loop.inc.q), int), parent[:0], np.zeros(0))]
    patterns = loop.patterns_at(cells.middles(), guess)
    size = np.maximum(size, _magnitude(loop, patterns, cells))
    tolerance = TOLERANCE * np.tile(size, 2)
    planes = cells.planes
    while len(cells):
        distinct, which = loop.distinct(patterns)
        laws = loop.laws(distinct)
        highest, crossed = _passed_bounds(laws, which, cells, tolerance)
        split = np.any(crossed, axis=1)
        ready.append((cells.take(~split), parent[~split], patterns[~split]))
        if not split.any():
            break
        ended = _no_room(deadline, [part for part, _, _ in ready], cells.take(split))
        if ended:
            ready.append((cells.take(split), parent[split], patterns[split]))
            break
        cells, parent, patterns, which = cells.take(split), parent[split], patterns[split], which[split]
        bound = np.where(crossed[split], highest[split] / np.where(tolerance > 0, tolerance, 1.0), -np.inf).argmax(axis=1)
        height, plane = _height(laws, which, cells, bound)
        cells, half, level = cut(cells, height, plane, tolerance[bound])
        made.append(Cuts(parent, patterns, bound, level))
        planes, parent = cells.planes, parent[half]
        patterns = loop.patterns_at(cells.middles(), patterns[half])
    return _collected(ready, planes, made, size, ended)


def _no_room(deadline: Deadline, ready: list[Cells], crossed: Cells) -> str:
    """Why cells that are crossed must not be cut: each becomes two, with about twice the vertices at most."""
    pieces = sum(len(part) for part in ready) + 2 * len(crossed)
    return deadline.passed(pieces, sum(part.size for part in ready) + 2 * crossed.size)


def _collected(ready: list, planes: Array, made: list[Cuts], size: Array, ended: str) -> Split:
    cells = Cells.joined_all([part for part, _, _ in ready], planes)
    names = ("parent", "patterns", "bound", "level")
    cuts = Cuts(*(np.concatenate([getattr(part, name) for part in made]) for name in names))
    parents, patterns = (np.concatenate([part[i] for part in ready]) for i in (1, 2))
    return Split(cells, parents, patterns, cuts, size, ended)


def _passed_bounds(laws: Laws, which: np.ndarray, cells: Cells, tolerance: Array) -> tuple[Array, np.ndarray]:
    """How far each cell's z lies beyond each bound of its piece, (N, 2q), and which of them it has on both sides."""
    q = laws.z0.shape[1]
    if q == 0:
        return np.zeros((len(cells), 0)), np.zeros((len(cells), 0), bool)
    ends = np.concatenate([-laws.low, laws.high], axis=1)[which]
    top, bottom = z_range(laws, which, cells)
    highest = np.concatenate([-bottom, top], axis=1) - ends
    lowest = np.concatenate([-top, bottom], axis=1) - ends
    return highest, (highest > tolerance) & (lowest < -tolerance)


def z_range(laws: Laws, which: np.ndarray, cells: Cells) -> tuple[Array, Array]:
    """The largest and the smallest z (N, q) of each cell's own law over its vertices."""
    q = laws.z0.shape[1]
    stride = max(1, int(MOST_NUMBERS / max(1, q * cells.now.shape[1])))
    first = cells.first
    ends = np.searchsorted(first, np.arange(0, len(cells.owner) + stride, stride)[1:], side="right")
    tops, bottoms, begin = [], [], 0
    for end in np.unique(np.clip(ends, 1, len(cells))):
        rows = slice(first[begin], first[end] if end < len(cells) else len(cells.owner))
        law = which[cells.owner[rows]]
        z = (laws.Zx[law] @ cells.now[rows, :, None])[:, :, 0] + laws.z0[law]
        starts = first[begin:end] - first[begin]
        tops.append(np.maximum.reduceat(z, starts, axis=0))
        bottoms.append(np.minimum.reduceat(z, starts, axis=0))
        begin = end
    return np.concatenate(tops), np.concatenate(bottoms)


def _height(laws: Laws, which: np.ndarray, cells: Cells, bound: np.ndarray) -> tuple[Array, Array]:
    """How far z of the chosen bound (N,) lies beyond it: at the vertices (M,), and as planes (N, n + 1) in x0."""
    q = laws.z0.shape[1]
    unit, lower = bound % q, bound < q
    sign = np.where(lower, -1.0, 1.0)
    gradient = sign[:, None] * laws.Zx[which, unit]
    offset = np.where(lower, laws.low[which, unit] - laws.z0[which, unit], laws.z0[which, unit] - laws.high[which, unit])
    height = (gradient[cells.owner] * cells.now).sum(axis=1) + offset[cells.owner]
    return height, in_start(cells, gradient, offset)


def _magnitude(loop: PiecewiseLoop, patterns: np.ndarray, cells: Cells) -> Array:
    """The magnitude (q,) of the terms that z is summed from: rounding is relative to it, also where z vanishes."""
    laws = loop.laws(loop.distinct(patterns)[0])
    reach = np.abs(cells.now).max(axis=0)
    return (np.abs(laws.Zx) @ reach + np.abs(laws.z0)).max(axis=0, initial=0.0)


def inputs_at(cells: Cells, laws: Laws, which: np.ndarray) -> Array:
    """Return u (M, m) at the vertices, where cell i is under the law which[i]."""
    law = which[cells.owner]
    return (laws.Gx[law] @ cells.now[:, :, None])[:, :, 0] + laws.g[law]


def under_laws(loop: PiecewiseLoop, cells: Cells, laws: Laws, which: np.ndarray) -> Cells:
    """Return the cells one step later, where cell i is under the law which[i]."""
    plant = loop.plant
    return moved(cells, plant.A + plant.B @ laws.Gx[which], laws.g[which] @ plant.B.T)
