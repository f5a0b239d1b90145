"""What every set and every distribution promises."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, frozen
from ..brief import Brief


class Set(Brief, ABC):
    """A bounded, convex, full-dimensional set in R^n: where states start or inputs stay.

    Points are vectors (n,) or columns (n, N). Each set knows the mean and covariance of the uniform distribution on
    itself, how to draw from it and how to integrate over it; `Uniform` passes these on.
    """

    @property
    @abstractmethod
    def dimension(self) -> int:
        """The dimension n of the space."""

    @property
    @abstractmethod
    def center(self) -> Array:
        """The centroid (n,): the mean of the uniform distribution."""

    @property
    @abstractmethod
    def covariance(self) -> Array:
        """The covariance (n, n) of the uniform distribution."""

    @property
    @abstractmethod
    def volume(self) -> float:
        """The n-dimensional volume."""

    @property
    @abstractmethod
    def vertices(self) -> Array:
        """The extreme points as columns (n, N); an error when they are not finitely many."""

    @abstractmethod
    def contains(self, x: ArrayLike, tol: float = 0.0) -> bool | np.ndarray:
        """Return whether the point (n,) is in the set, or for columns (n, N) the (N,) answers."""

    @abstractmethod
    def support(self, direction: ArrayLike) -> float | Array:
        """Return max of direction'x over the set, for one direction (n,) or for columns (n, N)."""

    @abstractmethod
    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent uniform points as columns (n, N)."""

    @abstractmethod
    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return nodes (n, N), positive weights (N,) of sum 1: exact means of polynomials of degree 2 order - 1."""


class Distribution(Brief, ABC):
    """A distribution of the initial state on R^n: its moments, its draws, and a quadrature for expectations.

    Besides what follows, each has as a field or property

    mean : (n,) E[x]
    covariance : (n, n) E[(x - E[x]) (x - E[x])']
    support : the Set that carries it, or None when there is no bounded full-dimensional one
    """

    if TYPE_CHECKING:
        # Fields in some subclasses, properties in others. A property here would have no setter, and so bar the fields.
        @property
        def mean(self) -> Array: ...

        @property
        def covariance(self) -> Array: ...

        @property
        def support(self) -> Set | None: ...

    @property
    @abstractmethod
    def dimension(self) -> int:
        """The dimension n of the space."""

    @property
    def second_moment(self) -> Array:
        """S0 = E[x x'] = covariance + mean mean', shape (n, n)."""
        return frozen(self.covariance + np.outer(self.mean, self.mean))

    @property
    @abstractmethod
    def vertices(self) -> Array:
        """Finitely many points (n, N) whose convex hull carries the distribution; an error when there are none."""

    @abstractmethod
    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent draws as columns (n, N)."""

    @abstractmethod
    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return nodes (n, N) and positive weights (N,) of sum 1 with E[f(x)] close to sum_i weights_i f(nodes_i)."""
