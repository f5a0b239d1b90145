"""The uniform distribution on a set, which is what a bare set means where a distribution is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InvalidInputError
from . import simplex
from .base import Distribution, Set
from .box import Box
from .polytope import Polytope


@dataclass(frozen=True, eq=False)
class Uniform(Distribution):
    """The uniform distribution on a Box, Polytope or Ellipsoid, with exact moments.

    Parameters
    ----------
    support : the set that carries the distribution

    Raises
    ------
    InvalidInputError : `support` is not a set

    Examples
    --------
    >>> uniform = Uniform(Box([-1, 0], [1, 3]))
    >>> uniform.mean.tolist(), uniform.second_moment.round(6).tolist()
    ([0.0, 1.5], [[0.333333, 0.0], [0.0, 3.0]])
    """

    support: Set

    def __post_init__(self) -> None:
        if not isinstance(self.support, Set):
            raise InvalidInputError(f"Uniform needs a Box, Polytope or Ellipsoid, not {type(self.support).__name__}")

    @property
    def dimension(self) -> int:
        """The dimension n."""
        return self.support.dimension

    @property
    def mean(self) -> Array:
        """The centroid (n,)."""
        return self.support.center

    @property
    def covariance(self) -> Array:
        """The covariance (n, n), in closed form."""
        return self.support.covariance

    @property
    def vertices(self) -> Array:
        """The vertices (n, N) of the set; an InvalidInputError for an ellipsoid."""
        return self.support.vertices

    def simplices(self) -> tuple[Array, Array]:
        """Return the triangulation (N, n + 1, n) of the set and the probability (N,) of each simplex.

        Raises
        ------
        InvalidInputError : the set is not a Box or a Polytope

        >>> Uniform(Box([0, 0], [1, 3])).simplices()[1].tolist()
        [0.5, 0.5]
        """
        if not isinstance(self.support, Box | Polytope):
            raise InvalidInputError(f"{type(self.support).__name__} has no triangulation: use a Box or a Polytope")
        simplices = self.support.simplices()
        volumes = simplex.volumes(simplices)
        return simplices, volumes / volumes.sum()

    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent draws (n, N).

        >>> Uniform(Box(0, 1)).sample(3, np.random.default_rng(0)).shape
        (1, 3)
        """
        return self.support.sample(N, rng)

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return the set's rule: nodes (n, N), weights (N,), exact for polynomials of degree 2 order - 1.

        >>> Uniform(Box(0, 1)).quadrature(1)[0].tolist()
        [[0.5]]
        """
        return self.support.quadrature(order)


def as_distribution(value: Any) -> Distribution:
    """Return a distribution as it is, and a set as the uniform distribution on it.

    Raises
    ------
    InvalidInputError : anything else; an array could be points, vertices or bounds, so it is not guessed at

    >>> as_distribution(Box(0, 2)).mean.tolist()
    [1.0]
    """
    if isinstance(value, Distribution):
        return value
    if isinstance(value, Set):
        return Uniform(value)
    raise InvalidInputError(f"the initial distribution must be a Uniform, Gaussian or Empirical, or a set, not "
                            f"{type(value).__name__}; points as columns are Empirical(points)")
