"""Cut a polytope into simplices on each of which one or several piecewise-affine laws are affine."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..arrays import Array
from ..inc import INC
from ..plant import Plant
from ..sets import Box, Polytope
from .laws import Laws, PiecewiseLoop, heights
from .linear import determinant
from .simplices import Simplices, begin, cut_along, pieces_of_cuts


class Source(Protocol):
    """A piecewise-affine law that states its affine law on each pattern: `PiecewiseLoop`, or `CriticalRegions`.

    The law of pattern k holds at x exactly when low <= Zx[k] x + z0[k] <= high.
    """

    @property
    def arithmetic(self) -> str:
        """ "float" or "exact"."""

    @property
    def kink_tolerance(self) -> Any:
        """How far beyond a bound counts as on it, relative to the terms of z in floats."""

    def numbers(self, array: Array) -> Array:
        """Return the array in this source's numbers."""

    def patterns_at(self, x: Array, guess: np.ndarray | None = None) -> np.ndarray:
        """Return the pattern (N, q) at each point x (N, n)."""

    def laws(self, patterns: np.ndarray) -> Laws:
        """Return the laws of patterns (k, q)."""

    def distinct(self, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distinct rows of patterns (N, q), and for each pattern which of them it is."""


@dataclass(frozen=True, eq=False)
class Cover:
    """Simplices that fill a polytope without overlap, and the pattern of each source on each of them.

    simplices: their weights are shares of the volume; patterns: one (N, q) array per source; done (N,): whether every law is
    affine on the simplex; ended: "" when it is so on all, else the budget that ran out; seconds.

    Cutting keeps volume: the weights add up to 1 (asserted), exactly so in Fractions.
    """

    simplices: Simplices
    patterns: tuple[np.ndarray, ...]
    done: np.ndarray
    ended: str
    seconds: float

    @property
    def finished(self) -> Cover:
        """The simplices on which every law is affine, alone."""
        patterns = tuple(part[self.done] for part in self.patterns)
        return replace(self, simplices=self.simplices.take(self.done), patterns=patterns, done=self.done[self.done])


def source_of(inc: INC, C: Array, arithmetic: str = "float") -> PiecewiseLoop:
    """Return the law u = inc(C x) as a source of affine laws, without the units that no output depends on; C (p, n).

    Raises InvalidInputError when a unit is not piecewise affine.

    >>> source = source_of(INC.saturated([[2.0, 0.0]], 1.0), np.eye(2))
    >>> source.laws(source.patterns_at(np.zeros((1, 2)))).Gx.tolist()
    [[[2.0, 0.0]]]
    """
    n = C.shape[1]
    return PiecewiseLoop(Plant(np.eye(n), np.zeros((n, inc.m)), C), inc.without_idle_units(), arithmetic)


def cover(sources: list[Any], region: Box | Polytope, pieces: int = 500_000, seconds: float = 60.0) -> Cover:
    """Cut a region until every source is one affine law on every simplex, one source after the other.

    sources: `Source`s of the same arithmetic over R^n; region: triangulated first; pieces, seconds: when to give up.

    >>> found = cover([source_of(INC.saturated([[1.0]], 1.0), np.eye(1))], Box([-2.0], [3.0]))
    >>> sorted(found.simplices.weight.round(12).tolist()), found.ended
    ([0.2, 0.4, 0.4], '')
    """
    clock = time.monotonic()
    simplices, ended = triangulated(region, sources[0].numbers), ""
    found: list[np.ndarray] = []
    done = np.ones(len(simplices), dtype=bool)
    for source in sources:
        parts = one_law_each(source, simplices, pieces, clock + seconds)
        simplices, ended = parts.simplices, ended or parts.ended
        found = [patterns[parts.parent] for patterns in found] + [parts.patterns]
        done = done[parts.parent] & parts.done
    gap = abs(simplices.weight.sum() - 1)
    assert gap <= (0 if sources[0].arithmetic == "exact" else 1e-9), f"cutting lost or doubled the volume {float(gap):.3g}"
    return Cover(simplices, tuple(found), done, ended, time.monotonic() - clock)


def triangulated(region: Box | Polytope, numbers: Any) -> Simplices:
    """Return the region's simplices in the given numbers, weighed by their share of the volume.

    >>> triangulated(Box([0.0, 0.0], [1.0, 2.0]), np.asarray).weight.tolist()
    [0.5, 0.5]
    """
    corners = numbers(region.simplices())
    if corners.dtype != object:
        sizes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    else:
        sizes = np.array([abs(determinant(each[1:] - each[0])) for each in corners], dtype=object)
    return begin(corners, sizes / sizes.sum())


@dataclass(frozen=True, eq=False)
class Parts:
    """What `one_law_each` made: simplices, the pattern (N, q) of each, the simplex (N,) it came from, which are done."""

    simplices: Simplices
    patterns: np.ndarray
    parent: np.ndarray
    done: np.ndarray
    ended: str


def one_law_each(source: Any, simplices: Simplices, pieces: int, deadline: float) -> Parts:
    """Cut simplices until the source is one affine law on each.

    The law of the pattern at the centroid holds on the whole simplex when every vertex is within its bounds, by convexity.
    If a vertex is beyond a bound, another is strictly within, because the centroid is; the simplex is cut along the
    hyperplane of the bound that is exceeded farthest. No piece crosses it again, and there are finitely many, so this ends.
    In floats, what exceeds a bound by rounding counts as on it.
    """
    alive, parent = simplices, np.arange(len(simplices))
    patterns = source.patterns_at(alive.centroids())
    ready: list[tuple[Simplices, np.ndarray, np.ndarray]] = []
    ended = ""
    while True:
        height = _heights(source, patterns, alive.now)
        crossed = (height.max(axis=1) > 0) & (height.min(axis=1) < 0)
        cut = crossed.any(axis=1)
        ready.append((alive.take(~cut), patterns[~cut], parent[~cut]))
        if not cut.any():
            break
        farthest = np.where(crossed[cut], height[cut].max(axis=1), 0).argmax(axis=1)
        chosen = np.take_along_axis(height[cut], farthest[:, None, None], axis=2)[:, :, 0]
        ended = _spent(sum(len(part) for part, _, _ in ready) + pieces_of_cuts(chosen), pieces, deadline)
        if ended:
            ready.append((alive.take(cut), patterns[cut], parent[cut]))
            break
        alive, origin = cut_along(alive.take(cut), chosen)[:2]
        patterns, parent = patterns[cut][origin], parent[cut][origin]
        patterns = source.patterns_at(alive.centroids(), patterns)
    whole, all_patterns, parents = zip(*ready, strict=True)
    done = np.arange(sum(map(len, whole))) < sum(map(len, whole[:-1] if ended else whole))
    return Parts(whole[0].joined(*whole[1:]), np.concatenate(all_patterns), np.concatenate(parents), done, ended)


def _heights(source: Any, patterns: np.ndarray, points: Array) -> Array:
    """How far the vertices are beyond each bound, 0 where rounding alone could have put them there."""
    distinct, which = source.distinct(patterns)
    laws = source.laws(distinct)
    height = heights(laws, which, points)
    if source.arithmetic == "exact" or laws.z0.shape[1] == 0:
        return height
    reach = np.abs(points).max(axis=(0, 1))
    size = np.tile(np.abs(laws.Zx) @ reach + np.abs(laws.z0), (1, 2))
    return np.where(np.abs(height) <= source.kink_tolerance * size[which][:, None, :], 0, height)


def _spent(count: int, pieces: int, deadline: float) -> str:
    if count > pieces:
        return f"more than {pieces} simplices"
    return "the time limit" if time.monotonic() > deadline else ""
