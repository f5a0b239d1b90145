"""Cells of a distribution: what they promise; points, and cells of which only probability and mean are known."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..errors import InvalidInputError
from ..sets import Distribution, Empirical, Uniform
from .clouds import cloud
from .moves import UNIT
from .shapes import Shapes

_NORMALIZED = 2e-14  # by how much weights of sum 1 may be off


class Cells(ABC):
    """A partition of a distribution, computed from what is stored."""

    @property
    @abstractmethod
    def every(self) -> Shapes:
        """All cells by their numbers, those that were cut included."""

    @property
    def leaves(self) -> np.ndarray:
        """The numbers (c,) of the cells of the partition."""
        return np.arange(self.every.probabilities.size)

    @cached_property
    def shapes(self) -> Shapes:
        """The cells of the partition."""
        return self.every.take(self.leaves)

    @property
    def complete(self) -> bool:
        """Whether the shapes have all the covariance of the distribution, none being unknown inside the cells."""
        return True

    @property
    def probabilities(self) -> Array:
        """The probabilities (c,)."""
        return self.shapes.probabilities

    @property
    def centroids(self) -> Array:
        """The conditional means (n, c)."""
        return self.shapes.centers

    @property
    def halving(self) -> bool:
        """Whether cells can be halved, which `halved` does."""
        return False

    def halved(self, cut: np.ndarray, along: np.ndarray) -> Self:
        """Return the partition with the cells numbered `cut` halved each along one of its `Shapes.ways`.

        Raises
        ------
        InvalidInputError : the cells cannot be halved
        """
        raise InvalidInputError(f"the cells of a {type(self).__name__} cannot be halved")

    @abstractmethod
    def divide(self, initial: Distribution) -> bool:
        """Return whether these are a partition of the distribution."""

    @abstractmethod
    def exact(self) -> Shapes | str:
        """Return the cells in Fractions, from the stored parameters of the distribution, or why there are none."""


@dataclass(frozen=True, eq=False)
class Points(Cells):
    """Finitely many points, each of them a cell.

    >>> Points(Empirical([[1.0, 3.0]])).probabilities.tolist()
    [0.5, 0.5]
    """

    initial: Empirical

    @cached_property
    def every(self) -> Shapes:
        """The points of positive weight."""
        kept = self.initial.weights > 0
        points = self.initial.points[:, kept]
        return _points(self.initial.weights[kept], points, _NORMALIZED, np.zeros(len(points)))

    def divide(self, initial: Distribution) -> bool:
        """Return whether these are the points and weights of the distribution."""
        return isinstance(initial, Empirical) and np.array_equal(initial.points, self.initial.points) \
            and np.array_equal(initial.weights, self.initial.weights)

    def exact(self) -> Shapes:
        """Return the points in Fractions, the weights divided by their sum."""
        kept = self.initial.weights > 0
        weights = exact(self.initial.weights[kept])
        return _points(weights / weights.sum(), exact(self.initial.points[:, kept]), 0.0, np.zeros(self.initial.dimension))


@dataclass(frozen=True, eq=False)
class Cloud(Cells):
    """Cells of which only probability (c,) and mean (n, c) are known, cut in one way for a number that was asked for.

    Parameters
    ----------
    initial : the distribution
    asked : about how many cells
    """

    initial: Distribution
    asked: int

    @cached_property
    def every(self) -> Shapes:
        """The cells, as points at their means."""
        weights, means = cloud(self.initial, self.asked)
        off = 8 * UNIT * len(weights)
        return _points(weights, means, off, off * np.max(np.abs(means), axis=1))

    @property
    def complete(self) -> bool:
        """No: the covariances inside the cells are not known one by one."""
        return False

    def divide(self, initial: Distribution) -> bool:
        """Return whether it is this distribution that was cut."""
        return initial is self.initial

    def exact(self) -> str:
        """Return why there are no fractions."""
        cut = self.initial.support if isinstance(self.initial, Uniform) else self.initial
        return f"the cells of the {type(cut).__name__} have probabilities that are no fractions"


def _points(weights: Array, points: Array, doubt: float, rounding: Array) -> Shapes:
    n, c = points.shape
    return Shapes(weights, points, np.zeros((n, 0, c), dtype=points.dtype), 1, False, rounding, np.full(c, doubt))
