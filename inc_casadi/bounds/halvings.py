"""Who was cut, and along what: a record of repeated halving from which the cells are computed anew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError


@dataclass(frozen=True, eq=False)
class Halvings:
    """`roots` cells, and cuts in two of them and of what came out.

    Cells are numbered in the order in which they appear: cut i divides cell cut[i] along its direction along[i] into
    the cells roots + 2 i and roots + 2 i + 1. If every cut cell exists before its cut and is cut once (`sound`), those
    never cut (`leaves`) are a partition of the roots: halving by halving, nothing is lost or counted twice.

    Parameters
    ----------
    roots : number of cells to begin with
    cut, along : (K,) integers

    >>> record = Halvings(1, np.array([0, 2]), np.array([0, 1]))
    >>> record.leaves.tolist(), record.sound(ways=2)
    ([1, 3, 4], True)
    """

    roots: int
    cut: np.ndarray
    along: np.ndarray

    @classmethod
    def none(cls, roots: int) -> Halvings:
        """Return the record of no cut."""
        return cls(roots, np.zeros(0, dtype=int), np.zeros(0, dtype=int))

    @property
    def size(self) -> int:
        """The number of all cells that ever were."""
        return self.roots + 2 * len(self.cut)

    @cached_property
    def leaves(self) -> np.ndarray:
        """The numbers (c,) of the cells never cut."""
        return np.setdiff1d(np.arange(self.size), self.cut)

    def sound(self, ways: int) -> bool:
        """Return whether every cut cell exists before, is cut once, and along one of `ways` directions.

        >>> Halvings(1, np.array([0, 0]), np.array([0, 0])).sound(1)
        False
        """
        cut, along = np.asarray(self.cut), np.asarray(self.along)
        if cut.shape != along.shape or cut.ndim != 1 or cut.dtype.kind != "i" or along.dtype.kind != "i":
            return False
        exists = (cut >= 0) & (cut < self.roots + 2 * np.arange(len(cut)))
        return self.roots > 0 and bool(np.all(exists & (along >= 0) & (along < ways)) and len(set(cut.tolist())) == len(cut))

    def more(self, cut: np.ndarray, along: np.ndarray) -> Halvings:
        """Return the record with further cuts.

        >>> Halvings.none(2).more(np.array([1]), np.array([0])).leaves.tolist()
        [0, 2, 3]
        """
        return Halvings(self.roots, np.append(self.cut, cut), np.append(self.along, along))

    def unfolded(self, first: Array, halve: Callable[[Array, np.ndarray], tuple[Array, Array]]) -> Array:
        """Return something (size, ...) of every cell from that of the roots, `first`, by `halve(of cells, along)`.

        >>> Halvings.none(1).more(np.array([0]), np.array([0])).unfolded(np.ones(1), lambda p, _: (p / 2, p / 2)).tolist()
        [1.0, 0.5, 0.5]
        """
        found = np.empty((self.size, *first.shape[1:]), dtype=first.dtype)
        found[: self.roots] = first
        ready: np.ndarray = np.arange(self.size) < self.roots
        waiting: np.ndarray = np.arange(len(self.cut))
        while waiting.size:
            now = waiting[ready[self.cut[waiting]]]
            if not now.size:
                raise InvalidInputError(f"{waiting.size} cuts are of cells that never were")
            waiting = waiting[~ready[self.cut[waiting]]]
            halves = halve(found[self.cut[now]], self.along[now])
            for which, half in enumerate(halves):
                found[self.roots + 2 * now + which] = half
                ready[self.roots + 2 * now + which] = True
        return found
