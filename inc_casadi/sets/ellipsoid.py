"""The ellipsoid {x: (x - c)' P (x - c) <= level} in R^n."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import exp, lgamma, log, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, columns, frozen, number, symmetric, vector
from ..errors import DimensionError, InvalidInputError
from . import rules
from .base import Set


@dataclass(frozen=True, eq=False)
class Ellipsoid(Set):
    """The ellipsoid {x: (x - c)' P (x - c) <= level}, a sublevel set of a quadratic Lyapunov function.

    Parameters
    ----------
    P : (n, n) symmetric positive definite
    center : (n,), or None for the origin
    level : > 0, in the units of x'P x

    Raises
    ------
    DimensionError : P is not square, or center does not fit
    InvalidInputError : P is not symmetric positive definite, level <= 0, a NaN or an infinity

    Examples
    --------
    >>> disc = Ellipsoid(P=[[1, 0], [0, 4]], level=4.0)
    >>> round(disc.volume / np.pi, 12), disc.support([0.0, 1.0])
    (2.0, 1.0)
    """

    P: Array
    center: Array = None  # type: ignore[assignment]  # None is replaced by the origin
    level: float = 1.0

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, P: ArrayLike, center: ArrayLike | None = None, level: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        P = symmetric("P", self.P, definite="strict")
        n = P.shape[0]
        if n == 0:
            raise DimensionError("P has shape (0, 0), but an ellipsoid needs at least one coordinate")
        center = vector("center", np.zeros(n) if self.center is None else self.center, n)
        level = number("level", self.level, 0.0, open_low=True)
        for name, value in (("P", P), ("center", center), ("level", level)):
            object.__setattr__(self, name, value)

    @property
    def dimension(self) -> int:
        """The dimension n."""
        return self.P.shape[0]

    @cached_property
    def covariance(self) -> Array:
        """The covariance of the uniform distribution: level P^-1 / (n + 2)."""
        return frozen(self._shape @ self._shape.T / (self.dimension + 2))

    @property
    def volume(self) -> float:
        """The volume pi^(n/2) / Gamma(n/2 + 1) * sqrt(level^n / det P)."""
        n = self.dimension
        logdet = float(np.linalg.slogdet(self.P)[1])
        return exp(n / 2 * log(pi) - lgamma(n / 2 + 1) + (n * log(self.level) - logdet) / 2)

    @property
    def vertices(self) -> Array:
        """An ellipsoid has no vertices.

        Raises
        ------
        InvalidInputError : always
        """
        raise InvalidInputError("an ellipsoid has no vertices: use a Box or a Polytope that contains it, or `support`")

    def contains(self, x: ArrayLike, tol: float = 0.0) -> bool | np.ndarray:
        """Return whether (x - c)' P (x - c) <= level (1 + tol).

        Parameters
        ----------
        x : (n,) or columns (n, N)
        tol : allowance relative to the level

        >>> Ellipsoid([[1, 0], [0, 1]]).contains([[0.6, 0.9], [0.6, 0.9]]).tolist()
        [True, False]
        """
        points, single = columns("x", x, self.dimension)
        shifted = points - self.center[:, None]
        inside = np.einsum("in,ij,jn->n", shifted, self.P, shifted) <= self.level * (1 + tol)
        return bool(inside[0]) if single else inside

    def support(self, direction: ArrayLike) -> float | Array:
        """Return the maximum of d'x over the ellipsoid, d'c + sqrt(level d'P^-1 d), for (n,) or columns (n, N).

        >>> round(Ellipsoid([[4.0]], center=[1.0]).support([1.0]), 12)
        1.5
        """
        directions, single = columns("direction", direction, self.dimension)
        values = self.center @ directions + np.linalg.norm(self._shape.T @ directions, axis=0)
        return float(values[0]) if single else values

    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent uniform points (n, N): a direction on the sphere, and a radius u^(1/n).

        >>> Ellipsoid([[1, 0], [0, 1]]).sample(4, np.random.default_rng(0)).shape
        (2, 4)
        """
        n = self.dimension
        draws = rng.standard_normal((rules.whole("N", N, 0), n)).T
        radius = rng.random(draws.shape[1]) ** (1 / n)
        return self.center[:, None] + self._shape @ (draws * (radius / np.linalg.norm(draws, axis=0)))

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return a symmetric spherical-radial product rule, exact for polynomials of degree 2 order - 1.

        In two dimensions 2 order angles on ceil(order / 2) rings; each further dimension multiplies by `order`.

        >>> nodes, weights = Ellipsoid([[1, 0], [0, 1]]).quadrature(2)
        >>> round(float(weights @ nodes[0] ** 2), 12)
        0.25
        """
        nodes, weights = rules.ball(self.dimension, order)
        return self.center[:, None] + self._shape @ nodes, weights

    @cached_property
    def _shape(self) -> Array:
        # The symmetric T with T T' = level P^-1: the ellipsoid is c + T times the unit ball.
        eigenvalues, V = np.linalg.eigh(self.P)
        return (V * np.sqrt(self.level / eigenvalues)) @ V.T
