"""Cells that are halved again and again, computed from a record of the halvings: boxes and simplices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import factorial

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..pieces.linear import determinant
from ..sets import Box, Distribution, Polytope, Uniform
from ..sets.simplex import volumes
from .cells import Cells
from .halvings import Halvings
from .moves import UNIT
from .shapes import Shapes

_DEEPEST = 45  # halvings: shares of a root are dyadic, and floats hold them exactly down to here


@dataclass(frozen=True, eq=False)
class Boxes(Cells):
    """A box with the uniform distribution, halved again and again along its axes.

    >>> Boxes(Box([0, 0], [1, 4]), Halvings.none(1)).halved(np.array([0]), np.array([1])).centroids.tolist()
    [[0.5, 0.5], [1.0, 3.0]]
    """

    box: Box
    record: Halvings

    @cached_property
    def every(self) -> Shapes:
        """All boxes."""
        lower, upper = self.box.lower[:, None], self.box.upper[:, None]
        return self._shapes(lower, upper, self.shares, 4 * UNIT * np.maximum(np.abs(lower), np.abs(upper))[:, 0])

    def _shapes(self, lower: Array, upper: Array, shares: Array, rounding: Array) -> Shapes:
        low, size = shares[:, 0].T, shares[:, 1].T
        half = (upper - lower) * size / 2
        spans = np.zeros((len(half), *half.shape), dtype=half.dtype)
        spans[np.arange(len(half)), np.arange(len(half))] = half
        centers = lower + (upper - lower) * (low + size / 2)
        return Shapes(np.prod(size, axis=0), centers, spans, 3, True, rounding, np.zeros(centers.shape[1]))

    @cached_property
    def shares(self) -> Array:
        """Where each box begins and how long it is along each axis, (c, 2, n) shares of the whole, without rounding."""
        n = self.box.dimension
        return self.record.unfolded(np.stack([np.zeros(n), np.ones(n)])[None], _halved_box)

    @property
    def leaves(self) -> np.ndarray:
        """The boxes never cut."""
        return self.record.leaves

    @property
    def halving(self) -> bool:
        """Boxes can be halved."""
        return True

    def halved(self, cut: np.ndarray, along: np.ndarray) -> Boxes:
        """Return the partition with some boxes halved along an axis."""
        fine = self.shares[cut, 1, along] > 2.0**-_DEEPEST
        return replace(self, record=self.record.more(cut[fine], along[fine]))

    def divide(self, initial: Distribution) -> bool:
        """Return whether the box is that of the distribution and the halvings are sound."""
        same = isinstance(initial, Uniform) and isinstance(initial.support, Box) and _same_box(initial.support, self.box)
        return same and self.record.sound(self.box.dimension) and bool(np.all(self.shares[:, 1] >= 2.0**-_DEEPEST))

    def exact(self) -> Shapes:
        """Return the boxes in Fractions."""
        lower, upper = exact(self.box.lower)[:, None], exact(self.box.upper)[:, None]
        return self._shapes(lower, upper, exact(self.shares[self.leaves]), np.zeros(len(lower)))


@dataclass(frozen=True, eq=False)
class Simplices(Cells):
    """Simplices (R, n + 1, n) with the uniform distribution on their union, halved again and again at edges.

    >>> triangle = Simplices(np.array([[[0.0, 0.0], [4.0, 0.0], [0.0, 1.0]]]), Halvings.none(1))
    >>> triangle.halved(np.array([0]), np.array([0])).probabilities.tolist()
    [0.5, 0.5]
    """

    roots: Array
    record: Halvings

    @cached_property
    def every(self) -> Shapes:
        """All simplices."""
        sizes, n = volumes(self.roots), self.roots.shape[2]
        shares, owner = self._shares
        found = _simplices(self.roots, sizes / sizes.sum(), shares, owner)
        far = np.max(np.abs(self.roots), axis=(0, 1))
        # A determinant errs by roundings of the product of the lengths of its rows, and so does the sum of all.
        most = np.prod(np.linalg.norm(self.roots[:, 1:] - self.roots[:, :1], axis=2), axis=1) / factorial(n)
        doubt = 8 * UNIT * (n + 2) ** 3 * (most / sizes + most.sum() / sizes.sum())
        return replace(found, rounding=2 * UNIT * (n + 4) * far, doubt=doubt[owner[:, 0]])

    @cached_property
    def _shares(self) -> tuple[Array, Array]:
        # Barycentric coordinates of the vertices, (c, n + 1, n + 1); root and number of halvings of each, (c, 2).
        N, size, _ = self.roots.shape
        first = np.broadcast_to(np.eye(size), (N, size, size))
        owner = self.record.unfolded(np.stack([np.arange(N), np.zeros(N, dtype=int)], axis=1), _deeper)
        return self.record.unfolded(first, _halved_simplex), owner

    @property
    def leaves(self) -> np.ndarray:
        """The simplices never cut."""
        return self.record.leaves

    @property
    def halving(self) -> bool:
        """Simplices can be halved."""
        return True

    def halved(self, cut: np.ndarray, along: np.ndarray) -> Simplices:
        """Return the partition with some simplices halved at the middle of an edge, numbered as `np.triu_indices` does."""
        fine = self._shares[1][cut, 1] < _DEEPEST
        return replace(self, record=self.record.more(cut[fine], along[fine]))

    def divide(self, initial: Distribution) -> bool:
        """Return whether the roots are the triangulation of the distribution's polytope and the halvings are sound."""
        same = isinstance(initial, Uniform) and isinstance(initial.support, Polytope) \
            and np.array_equal(initial.support.simplices(), self.roots)
        size = self.roots.shape[1]
        sound = same and self.record.sound(size * (size - 1) // 2)
        return sound and bool(np.all(self._shares[1][:, 1] <= _DEEPEST))

    def exact(self) -> Shapes:
        """Return the simplices in Fractions, the stored roots taken as they are."""
        roots, (shares, owner) = exact(self.roots), self._shares
        sizes = np.array([abs(determinant(root[1:] - root[0])) for root in roots], dtype=object)
        kept = self.leaves
        return _simplices(roots, sizes / sizes.sum(), exact(shares[kept]), owner[kept])


def _same_box(one: Box, other: Box) -> bool:
    return np.array_equal(one.lower, other.lower) and np.array_equal(one.upper, other.upper)


def _halved_box(shares: Array, along: np.ndarray) -> tuple[Array, Array]:
    low, high, rows = shares.copy(), shares.copy(), np.arange(len(along))
    low[rows, 1, along] /= 2
    high[rows, 1, along] /= 2
    high[rows, 0, along] += high[rows, 1, along]
    return low, high


def _halved_simplex(shares: Array, along: np.ndarray) -> tuple[Array, Array]:
    first, second = np.triu_indices(shares.shape[1], 1)
    rows, i, j = np.arange(len(along)), first[along], second[along]
    middle = (shares[rows, i] + shares[rows, j]) / 2
    left, right = shares.copy(), shares.copy()
    left[rows, i], right[rows, j] = middle, middle
    return left, right


def _deeper(owner: Array, along: np.ndarray) -> tuple[Array, Array]:
    return owner + [0, 1], owner + [0, 1]


def _simplices(roots: Array, weights: Array, shares: Array, owner: Array) -> Shapes:
    n, (root, depth) = roots.shape[2], owner.T
    corners = np.einsum("cij,cjn->nic", shares, roots[root]) if roots.dtype != object else \
        np.sum(shares[:, :, :, None] * roots[root][:, None], axis=2).transpose(2, 1, 0)
    halves = np.ldexp(1.0, -depth) if roots.dtype != object else np.array([Fraction(1, 2**int(d)) for d in depth])
    centers = corners.sum(axis=1) / (n + 1)
    return Shapes(weights[root] * halves, centers, corners - centers[:, None], (n + 1) * (n + 2), False, np.zeros(n),
                  np.zeros(len(root)))
