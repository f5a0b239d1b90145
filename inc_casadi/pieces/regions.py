"""The regions of a piecewise-affine law: its patterns on a polytope, their laws, their volumes, and their shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..brief import Brief
from ..errors import InvalidInputError
from ..inc import INC
from ..loop import close_loop
from ..plant import Plant, as_plant
from ..sets import Box, Polytope
from .cover import cover, source_of
from .laws import Laws

SLIVER = 1e-12  # a share of the volume below which a region is rounding


@dataclass(frozen=True, eq=False)
class Regions(Brief):
    """The patterns of a law on a polytope: on region i, u = G[i] x + g[i].

    patterns (k, q), G (k, m, n), g (k, m); volumes (k,); lost: what they lack of the polytope's volume, slivers of rounding
    and whatever the budget left uncut; simplices (N, n+1, n), which (N,): the pieces and the region of each; seconds;
    ended: "" or the budget that ran out.

    Each region is convex: it is where low <= Zx x + z0 <= high for its pattern.
    """

    patterns: np.ndarray
    G: Array
    g: Array
    volumes: Array
    lost: float
    simplices: Array
    which: np.ndarray
    seconds: float
    ended: str = ""

    def __len__(self) -> int:
        return len(self.volumes)

    def polytope(self, i: int) -> Polytope:
        """Return region i as the convex hull of its simplices.

        Raises InvalidInputError when there is no such region.
        """
        if not 0 <= i < len(self):
            raise InvalidInputError(f"there is no region {i}: the regions are numbered 0 to {len(self) - 1}")
        return Polytope.from_vertices(self.simplices[self.which == i].reshape(-1, self.simplices.shape[2]).T)

    def distinct_laws(self, tol: float = 1e-9) -> tuple[Array, Array, np.ndarray]:
        """Return the distinct affine laws (l, m, n), (l, m), and which of them each region has (k,).

        tol: the difference, relative to the largest coefficient, below which two laws are one.
        """
        rows = np.concatenate([self.G, self.g[:, :, None]], axis=2).reshape(len(self), -1)
        scale = max(1.0, float(np.max(np.abs(rows), initial=0.0)))
        first: list[int] = []
        of = np.empty(len(self), dtype=int)
        for i, row in enumerate(rows):
            gaps = np.max(np.abs(rows[first] - row), axis=1, initial=0.0)
            found = np.flatnonzero(gaps <= tol * scale)
            if not found.size:
                first.append(i)
            of[i] = found[0] if found.size else len(first) - 1
        return self.G[first], self.g[first], of


def regions(plant: Plant, law: INC | Any, region: Box | Polytope, pieces: int = 500_000, seconds: float = 60.0) -> Regions:
    """Return the regions of a piecewise-affine law of a plant's measurement on a polytope of states.

    plant: its C counts, nothing else; law: a piecewise-affine INC, or another source of affine laws over the state, such as
    `CriticalRegions`; region: Box or Polytope in R^n; pieces, seconds: what may be used.

    Raises InvalidInputError when a unit is not piecewise affine, DimensionError when plant and controller do not fit.

    >>> found = regions(Plant([[1.2]], [[1.0]]), INC.saturated([[-0.8]], 1.0), Box([-2.0], [2.0]))
    >>> len(found), found.volumes.round(6).tolist()
    (3, [0.75, 2.5, 0.75])
    """
    plant = as_plant(plant)
    if isinstance(law, INC):
        close_loop(plant, law)
    source = source_of(law, plant.C) if isinstance(law, INC) else law
    found = cover([source], region, pieces, seconds)
    finished = found.finished
    distinct, which = source.distinct(finished.patterns[0])
    shares = np.bincount(which, finished.simplices.weight, len(distinct))
    kept = np.flatnonzero(shares > SLIVER)
    number = np.full(len(distinct), -1)
    number[kept] = np.arange(len(kept))
    laws: Laws = source.laws(distinct[kept])
    rows = number[which] >= 0
    lost = float(found.simplices.weight.sum() - shares[kept].sum())
    return Regions(distinct[kept], laws.Gx, laws.g, shares[kept] * region.volume, lost * region.volume,
                   finished.simplices.now[rows], number[which][rows], found.seconds, found.ended)
