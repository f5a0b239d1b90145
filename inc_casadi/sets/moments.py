"""A distribution of which only a bounded support and the first two moments are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, symmetric, vector
from ..errors import InvalidInputError
from .base import Distribution, Set
from .box import Box
from .ellipsoid import Ellipsoid
from .polytope import Polytope

_TOL = 1e-9  # of the support's size: how far moments may exceed what it allows, which rounding explains


@dataclass(frozen=True, eq=False)
class Moments(Distribution):
    """Any distribution on `support` with this mean and covariance; nothing else about it is used.

    Bounds on linear controllers need no more (sec:general_certificate), and hold for every such distribution. That one
    exists is checked in part. With s = h - H mean >= 0 on a box or polytope {x: H x <= h},

        E (h - H x)(h - H x)' = s s' + H covariance H' >= 0 in every entry,

    a product of nonnegative numbers; on an ellipsoid E (x - c)'P(x - c) <= level. The latter is sufficient too, the
    former need not be.

    Parameters
    ----------
    support : Box, Polytope or Ellipsoid in R^n; every state of it may occur
    mean : (n,) in the support
    covariance : (n, n) symmetric positive semidefinite

    Raises
    ------
    DimensionError : the shapes do not fit
    InvalidInputError : a mean outside the support, a covariance larger than the support allows or not positive
        semidefinite, the wrong kind of thing, a NaN or an infinity

    Examples
    --------
    >>> known = Moments(Box([-1, -2], [1, 2]), mean=[0.5, 0.0], covariance=[[0.25, 0.1], [0.1, 1.0]])
    >>> known.second_moment.tolist()
    [[0.5, 0.1], [0.1, 1.0]]
    """

    support: Set
    mean: Array
    covariance: Array

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, support: Set, mean: ArrayLike, covariance: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        if not isinstance(self.support, Set):
            raise InvalidInputError(f"support must be a Box, Polytope or Ellipsoid, not {type(self.support).__name__}")
        n = self.support.dimension
        mean = vector("mean", self.mean, n)
        covariance = symmetric("covariance", self.covariance, n, definite="semi")
        for name, value in (("mean", mean), ("covariance", covariance)):
            object.__setattr__(self, name, value)
        if isinstance(self.support, Ellipsoid):
            _fit_ellipsoid(self.support, mean, covariance)
        elif isinstance(self.support, Box | Polytope):
            _fit_halfspaces(self.support, mean, covariance)

    @property
    def dimension(self) -> int:
        """The dimension n."""
        return self.support.dimension

    @property
    def vertices(self) -> Array:
        """The vertices (n, N) of the support; an InvalidInputError for an ellipsoid."""
        return self.support.vertices

    def sample(self, N: int, rng: np.random.Generator) -> NoReturn:
        """Refuse: many distributions have these moments.

        Raises
        ------
        InvalidInputError : always
        """
        raise InvalidInputError("a Moments distribution cannot be drawn from: only its support, mean and covariance are "
                                "known; use Uniform or Empirical where draws are needed")

    def quadrature(self, order: int) -> NoReturn:
        """Refuse: expectations of anything but quadratics are not known.

        Raises
        ------
        InvalidInputError : always
        """
        raise InvalidInputError("a Moments distribution has no quadrature: only its support, mean and covariance are "
                                "known; use Uniform or Empirical where expectations of other functions are needed")


def _fit_ellipsoid(support: Ellipsoid, mean: Array, covariance: Array) -> None:
    offset = mean - support.center
    share = float(offset @ support.P @ offset) / support.level
    if share > 1 + _TOL:
        raise InvalidInputError(f"mean is outside the support: (m - c)'P(m - c) is {share:.6g} times the level")
    share += float(np.sum(support.P * covariance)) / support.level
    if share > 1 + _TOL:
        raise InvalidInputError(f"covariance is larger than the support allows: E (x - c)'P(x - c) would be {share:.6g} "
                                "times the level, which it cannot exceed")


def _fit_halfspaces(support: Box | Polytope, mean: Array, covariance: Array) -> None:
    H, h = support.H, support.h
    slack = h - H @ mean
    widths = np.asarray(support.support(H.T)) + np.asarray(support.support(-H.T))
    for i in np.flatnonzero(slack < -_TOL * widths):
        raise InvalidInputError(f"mean is outside the support: it exceeds half-space {i} by {-slack[i]:.6g}")
    product = np.outer(slack, slack) + H @ covariance @ H.T
    short = product / np.outer(widths, widths)
    i, j = np.unravel_index(np.argmin(short), short.shape)
    if short[i, j] < -_TOL:
        raise InvalidInputError(f"covariance is larger than the support allows: the slacks of half-spaces {i} and {j}, "
                                f"which are nonnegative, would have E s_i s_j = {product[i, j]:.6g}")
