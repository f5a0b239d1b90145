"""The distribution of finitely many weighted points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, frozen, matrix, vector
from ..errors import DimensionError, EmptySetError, InvalidInputError
from . import rules
from .base import Distribution
from .polytope import Polytope

NORMALIZED = 1e-14


@dataclass(frozen=True, eq=False)
class Empirical(Distribution):
    """The distribution with mass weights_i at the point x_i: measured initial states, or one known initial state.

    Parameters
    ----------
    points : (n, N) points as columns
    weights : (N,) nonnegative and not all zero, divided by their sum; None for equal weights

    Raises
    ------
    DimensionError : the shapes do not fit
    InvalidInputError : a negative weight, no positive one, a NaN or an infinity

    Examples
    --------
    >>> known = Empirical([[1.0, 3.0], [0.0, 4.0]], weights=[3, 1])
    >>> known.mean.tolist(), known.covariance.tolist()
    ([1.5, 1.0], [[0.75, 1.5], [1.5, 3.0]])
    """

    points: Array
    weights: Array = None  # type: ignore[assignment]  # None is replaced by equal weights

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, points: ArrayLike, weights: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        points = matrix("points", self.points)
        if 0 in points.shape:
            raise DimensionError(f"points has shape {points.shape}, but at least one point and coordinate are needed")
        N = points.shape[1]
        weights = vector("weights", np.ones(N) if self.weights is None else self.weights, N)
        for i in np.flatnonzero(weights < 0):
            raise InvalidInputError(f"weights[{i}] = {weights[i]:g} is negative")
        if not np.any(weights > 0):
            raise InvalidInputError("every weight is zero")
        # Weights that sum to 1 stay as they are, so that a file gives them back.
        if weights.max() > 1.0 or abs(math.fsum(weights) - 1.0) > NORMALIZED:
            weights = weights / weights.max()  # before the sum, which would overflow for huge weights
            weights = weights / weights.sum()
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "weights", frozen(np.array(weights)))

    @property
    def dimension(self) -> int:
        """The dimension n."""
        return self.points.shape[0]

    @cached_property
    def mean(self) -> Array:
        """The weighted mean (n,)."""
        return frozen(self.points @ self.weights)

    @cached_property
    def covariance(self) -> Array:
        """The weighted covariance (n, n), normalized by the total weight and not by N - 1."""
        shifted = self.points - self.mean[:, None]
        return frozen((shifted * self.weights) @ shifted.T)

    @cached_property
    def support(self) -> Polytope | None:
        """The convex hull of the points of positive weight, or None when they lie in a hyperplane."""
        try:
            return Polytope.from_vertices(self.vertices)
        except EmptySetError:
            return None

    @property
    def vertices(self) -> Array:
        """The points of positive weight (n, N): their hull carries the distribution, though not all need be extreme."""
        return frozen(self.points[:, self.weights > 0])

    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent draws (n, N), with replacement.

        >>> Empirical([[1.0], [2.0]]).sample(2, np.random.default_rng(0)).tolist()
        [[1.0, 1.0], [2.0, 2.0]]
        """
        return self.points[:, rng.choice(len(self.weights), size=rules.whole("N", N, 0), p=self.weights)]

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return the points of positive weight (n, N) and their weights: exact for every function, at any order.

        >>> Empirical([[1.0, 2.0]]).quadrature(1)[1].tolist()
        [0.5, 0.5]
        """
        rules.whole("order", order, 1)
        kept = self.weights > 0
        return self.points[:, kept], self.weights[kept]
