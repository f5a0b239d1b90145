"""The Gaussian distribution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, symmetric, vector
from ..errors import DimensionError, InvalidInputError
from . import rules
from .base import Distribution


@dataclass(frozen=True, eq=False)
class Gaussian(Distribution):
    """The Gaussian distribution N(mean, covariance); the covariance may be singular.

    Parameters
    ----------
    mean : (n,)
    covariance : (n, n) symmetric positive semidefinite

    Raises
    ------
    DimensionError : the shapes do not fit
    InvalidInputError : the covariance is not symmetric positive semidefinite, a NaN or an infinity

    Examples
    --------
    >>> Gaussian([1, 2], [[1, 0], [0, 0]]).second_moment.tolist()
    [[2.0, 2.0], [2.0, 4.0]]
    """

    mean: Array
    covariance: Array

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, mean: ArrayLike, covariance: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        mean = vector("mean", self.mean)
        if mean.size == 0:
            raise DimensionError("mean has shape (0,), but a distribution needs at least one coordinate")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", symmetric("covariance", self.covariance, mean.size, definite="semi"))

    @property
    def dimension(self) -> int:
        """The dimension n."""
        return self.mean.size

    @property
    def support(self) -> None:
        """None: a Gaussian is carried by no bounded set."""
        return None

    @property
    def vertices(self) -> Array:
        """A Gaussian has no vertices.

        Raises
        ------
        InvalidInputError : always
        """
        raise InvalidInputError("a Gaussian is unbounded, so it has no vertices: hard limits on states or inputs need "
                                "an initial distribution on a bounded set, such as Uniform(Box(lower, upper))")

    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent draws (n, N).

        >>> Gaussian([0.0, 5.0], [[1.0, 0.0], [0.0, 0.0]]).sample(3, np.random.default_rng(0))[1].tolist()
        [5.0, 5.0, 5.0]
        """
        draws = rng.standard_normal((rules.whole("N", N, 0), self._root.shape[1])).T
        return self.mean[:, None] + self._root @ draws

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return the tensor Gauss-Hermite rule: nodes (n, order^r) and weights of sum 1, r the rank of the covariance.

        Exact for polynomials of degree 2 order - 1; the nodes are mean + T z with T the symmetric square root of the
        covariance, or its r columns of positive variance when it is singular.

        >>> Gaussian([1.0], [[4.0]]).quadrature(2)[0].round(6).tolist()
        [[-1.0, 3.0]]
        """
        if self._root.shape[1] == 0:
            return self.mean[:, None].copy(), np.ones(1)
        nodes, weights = rules.tensor([rules.hermite(order)] * self._root.shape[1])
        return self.mean[:, None] + self._root @ nodes, weights

    @cached_property
    def _root(self) -> Array:
        # T with T T' = covariance. The symmetric root does not depend on the choice among eigenvectors of a repeated
        # eigenvalue; when singular, principal axes without variance are left out, which saves a factor of the nodes.
        eigenvalues, V = np.linalg.eigh(self.covariance)
        kept = eigenvalues > 1e-14 * self.dimension * eigenvalues[-1]
        if np.all(kept):
            return (V * np.sqrt(eigenvalues)) @ V.T
        return V[:, kept] * np.sqrt(eigenvalues[kept])
