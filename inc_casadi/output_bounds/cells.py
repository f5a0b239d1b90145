"""Cells that a region is cut into: boxes, or simplices that keep their corners as exact shares of a few roots."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np

from ..arrays import Array


class Cells(ABC):
    """N convex cells in R^n. Halving is exact: the two halves cover the cell to the last bit."""

    @abstractmethod
    def __len__(self) -> int:
        """The number N of cells."""

    @property
    @abstractmethod
    def low(self) -> Array:
        """The lower ends (N, n) of boxes that hold the cells, up to rounding of the corners."""

    @property
    @abstractmethod
    def high(self) -> Array:
        """The upper ends (N, n) of these boxes."""

    @abstractmethod
    def most(self, slope: Array) -> Array:
        """Return the maximum (N, k) of slope'x over each cell; slope (N, k, n).

        The rounding of corners is allowed for, that of the products is left to the caller.
        """

    @abstractmethod
    def points(self) -> Array:
        """Return points (N, r, n) to try: the middle of each cell and some of its corners."""

    @abstractmethod
    def halves(self, weight: Array, widths: Array) -> Self:
        """Return 2 N cells: each cut across the edge d with the largest sum_i weight_i |d_i| + |d / widths|.

        weight (N, n): how much each coordinate matters; widths (n,): the size of the region.
        """

    @abstractmethod
    def divisible(self) -> np.ndarray:
        """Return which cells (N,) can be halved exactly once more."""

    @abstractmethod
    def take(self, which: np.ndarray) -> Self:
        """Return the cells chosen by an index or mask array."""

    @abstractmethod
    def joined(self, other: Self) -> Self:
        """Return these cells followed by others."""


@dataclass(frozen=True, eq=False)
class Boxes(Cells):
    """Boxes with lower and upper ends (N, n).

    >>> Boxes(np.zeros((1, 2)), np.array([[1.0, 4.0]])).halves(np.ones((1, 2)), np.ones(2)).upper.tolist()
    [[1.0, 2.0], [1.0, 4.0]]
    """

    lower: Array
    upper: Array

    def __len__(self) -> int:
        return self.lower.shape[0]

    @property
    def low(self) -> Array:
        """The lower ends."""
        return self.lower

    @property
    def high(self) -> Array:
        """The upper ends."""
        return self.upper

    def most(self, slope: Array) -> Array:
        """Return the maximum of slope'x, coordinate by coordinate."""
        low, high = self.lower[:, None, :], self.upper[:, None, :]
        return np.maximum(slope * low, slope * high).sum(axis=2)

    def points(self) -> Array:
        """Return middle, lower and upper end."""
        return np.stack([(self.lower + self.upper) / 2, self.lower, self.upper], axis=1)

    def halves(self, weight: Array, widths: Array) -> Boxes:
        """Return lower and upper halves; both end at the same float."""
        axis = ((weight + _least(weight, widths)) * (self.upper - self.lower)).argmax(axis=1)
        rows = np.arange(len(self))
        lower, upper = self.lower.copy(), self.upper.copy()
        cut = lower[rows, axis] / 2 + upper[rows, axis] / 2
        lower[rows, axis], upper[rows, axis] = cut, cut
        return Boxes(np.concatenate([self.lower, lower]), np.concatenate([upper, self.upper]))

    def divisible(self) -> np.ndarray:
        """Return where an edge is longer than a few roundings."""
        return np.any(self.upper - self.lower > 1e-14 * (np.abs(self.lower) + np.abs(self.upper)), axis=1)

    def take(self, which: np.ndarray) -> Boxes:
        """Return a choice of boxes."""
        return Boxes(self.lower[which], self.upper[which])

    def joined(self, other: Boxes) -> Boxes:
        """Return both."""
        return Boxes(np.concatenate([self.lower, other.lower]), np.concatenate([self.upper, other.upper]))


@dataclass(frozen=True, eq=False)
class Simplices(Cells):
    """Simplices as shares (N, n+1, n+1) of root simplices (R, n+1, n), `root` (N,) saying which.

    Corner k is shares[k] @ roots[root]. Halving an edge halves shares, which are dyadic: floats hold them exactly, down to
    2^-52, so that halves cover their simplex although its corners are rounded when they are computed.

    >>> edge = Simplices.of(np.array([[[0.0], [1.0]]]))
    >>> edge.halves(np.ones((1, 1)), np.ones(1)).corners[:, :, 0].tolist()
    [[0.0, 0.5], [0.5, 1.0]]
    """

    roots: Array
    root: np.ndarray
    shares: Array

    @classmethod
    def of(cls, corners: Array) -> Simplices:
        """Return simplices given by their corners (N, n+1, n) as their own roots."""
        N, size, _ = corners.shape
        return cls(corners, np.arange(N), np.broadcast_to(np.eye(size), (N, size, size)).copy())

    def __len__(self) -> int:
        return self.root.size

    @property
    def corners(self) -> Array:
        """The corners (N, n+1, n), rounded."""
        return self.shares @ self.roots[self.root]

    @property
    def low(self) -> Array:
        """The smallest coordinates of the corners, less what rounding may have added."""
        return self.corners.min(axis=1) - self._room()

    @property
    def high(self) -> Array:
        """The largest coordinates of the corners, and what rounding may have taken."""
        return self.corners.max(axis=1) + self._room()

    def _room(self) -> Array:
        return 1e-15 * self.roots.shape[1] * np.abs(self.roots).max(axis=1)[self.root]

    def most(self, slope: Array) -> Array:
        """Return the largest slope'x over the corners, and what their own rounding may hide of it."""
        hidden = (np.abs(slope) @ self._room()[:, :, None])[:, :, 0]
        return (slope @ np.swapaxes(self.corners, 1, 2)).max(axis=2) + hidden

    def points(self) -> Array:
        """Return the middle, and the corners moved towards it by a millionth: inside, whatever rounding did to them."""
        corners = self.corners
        middle = corners.mean(axis=1, keepdims=True)
        return np.concatenate([middle, corners + 1e-6 * (middle - corners)], axis=1)

    def halves(self, weight: Array, widths: Array) -> Simplices:
        """Return the two halves of each simplex, cut at the middle of its heaviest edge."""
        i, j = np.triu_indices(self.shares.shape[1], 1)
        edges = np.abs(self.corners[:, i] - self.corners[:, j])
        heaviest = (edges @ (weight + _least(weight, widths))[:, :, None])[:, :, 0].argmax(axis=1)
        rows, a, b = np.arange(len(self)), i[heaviest], j[heaviest]
        first, second = self.shares.copy(), self.shares.copy()
        middle = (self.shares[rows, a] + self.shares[rows, b]) / 2
        first[rows, b], second[rows, a] = middle, middle
        return Simplices(self.roots, np.tile(self.root, 2), np.concatenate([first, second]))

    def take(self, which: np.ndarray) -> Simplices:
        """Return a choice of simplices."""
        return Simplices(self.roots, self.root[which], self.shares[which])

    def joined(self, other: Simplices) -> Simplices:
        """Return both; they have the same roots."""
        return Simplices(self.roots, np.concatenate([self.root, other.root]), np.concatenate([self.shares, other.shares]))

    def divisible(self) -> np.ndarray:
        """Return where all shares are multiples of 2^-48."""
        scaled = np.ldexp(self.shares, 48)
        return np.all(scaled == np.rint(scaled), axis=(1, 2))


def _least(weight: Array, widths: Array) -> Array:
    """A weight (N, n) that no coordinate falls below, so that every cell shrinks in the end."""
    scale = np.max(weight * widths, axis=1, keepdims=True)
    return 0.1 * np.where(scale > 0, scale, 1.0) / widths
