"""The box [lower, upper] in R^n."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, columns, frozen, vector
from ..errors import EmptySetError, InvalidInputError
from . import rules, simplex
from .base import Set

MOST_CORNERS, MOST_SIMPLICES = 20, 8  # dimensions up to which 2^n corners and n! simplices are listed


@dataclass(frozen=True, eq=False)
class Box(Set):
    """The box {x: lower <= x <= upper}, with lower < upper in every coordinate.

    Parameters
    ----------
    lower, upper : (n,) arrays, in the units of the state or input; scalars when n = 1

    Raises
    ------
    DimensionError : the two ends have different sizes
    EmptySetError : lower >= upper in some coordinate
    InvalidInputError : a NaN or an infinity

    Examples
    --------
    >>> box = Box([-1, 0], [1, 3])
    >>> box.volume, box.center.tolist(), box.contains([0.5, 3.0])
    (6.0, [0.0, 1.5], True)
    """

    lower: Array
    upper: Array

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, lower: ArrayLike, upper: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        lower = vector("lower", self.lower)
        upper = vector("upper", self.upper, lower.size)
        if lower.size == 0:
            raise EmptySetError("a box needs at least one coordinate")
        for i in np.flatnonzero(lower >= upper):
            raise EmptySetError(f"the box has no interior: coordinate {i} has lower = {lower[i]:g} and upper = "
                                f"{upper[i]:g}, but lower < upper is needed")
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)

    @property
    def dimension(self) -> int:
        """The dimension n."""
        return self.lower.size

    @property
    def center(self) -> Array:
        """The midpoint (n,)."""
        return frozen((self.lower + self.upper) / 2)

    @property
    def covariance(self) -> Array:
        """The covariance of the uniform distribution: diag((upper - lower)^2) / 12."""
        return frozen(np.diag((self.upper - self.lower) ** 2) / 12)

    @property
    def volume(self) -> float:
        """The product of the widths."""
        return float(np.prod(self.upper - self.lower))

    @cached_property
    def vertices(self) -> Array:
        """The corners (n, 2^n), the last coordinate alternating fastest.

        Raises
        ------
        InvalidInputError : n > 20
        """
        n = self.dimension
        if n > MOST_CORNERS:
            raise InvalidInputError(f"a box in dimension {n} has 2^{n} vertices; they are listed up to {MOST_CORNERS}")
        raised = np.array(list(product((False, True), repeat=n))).T
        return frozen(np.where(raised, self.upper[:, None], self.lower[:, None]))

    @property
    def H(self) -> Array:
        """The matrix (2n, n) of the half-spaces H x <= h: I over -I."""
        return frozen(np.vstack([np.eye(self.dimension), -np.eye(self.dimension)]))

    @property
    def h(self) -> Array:
        """The right-hand side (2n,) of the half-spaces: upper over -lower."""
        return frozen(np.concatenate([self.upper, -self.lower]))

    def contains(self, x: ArrayLike, tol: float = 0.0) -> bool | np.ndarray:
        """Return whether x is in the box enlarged by `tol` on every side.

        Parameters
        ----------
        x : (n,) or columns (n, N)
        tol : allowance in the units of x

        >>> Box([0, 0], [1, 2]).contains([[0.5, 1.5], [1.0, 1.0]]).tolist()
        [True, False]
        """
        points, single = columns("x", x, self.dimension)
        inside = np.all((points >= self.lower[:, None] - tol) & (points <= self.upper[:, None] + tol), axis=0)
        return bool(inside[0]) if single else inside

    def support(self, direction: ArrayLike) -> float | Array:
        """Return the maximum of direction'x over the box, for (n,) or columns (n, N).

        >>> Box([-1, 0], [1, 3]).support([1.0, -1.0])
        1.0
        """
        directions, single = columns("direction", direction, self.dimension)
        values = self.upper @ np.maximum(directions, 0) + self.lower @ np.minimum(directions, 0)
        return float(values[0]) if single else values

    def simplices(self) -> Array:
        """Return Kuhn's triangulation (n!, n + 1, n), all of equal volume.

        Raises
        ------
        InvalidInputError : n > 8

        >>> Box([0, 0, 0], [1, 1, 1]).simplices().shape
        (6, 4, 3)
        """
        n = self.dimension
        if n > MOST_SIMPLICES:
            raise InvalidInputError(f"a box in dimension {n} is cut into {n}! simplices; that is done up to "
                                    f"dimension {MOST_SIMPLICES}: use sample(N, rng) or a global certificate instead")
        return simplex.kuhn(self.lower, self.upper)

    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent uniform points (n, N).

        >>> Box([0, 5], [1, 6]).sample(4, np.random.default_rng(0)).shape
        (2, 4)
        """
        draws = rng.random((rules.whole("N", N, 0), self.dimension)).T
        return self.lower[:, None] + (self.upper - self.lower)[:, None] * draws

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return the tensor Gauss-Legendre rule with `order` points per axis: nodes (n, order^n), weights of sum 1.

        Exact for polynomials of degree 2 order - 1 in each coordinate.

        >>> nodes, weights = Box([0], [1]).quadrature(2)
        >>> round(float(weights @ nodes[0] ** 3), 12)
        0.25
        """
        nodes, weights = rules.tensor([rules.legendre(order)] * self.dimension)
        return self.center[:, None] + (self.upper - self.lower)[:, None] / 2 * nodes, weights
