"""The promise of an activation: what it computes and what is true of it everywhere."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .piecewise import Pieces, around, as_interval, sector_between, slopes_between

__all__ = ["Activation", "Pieces"]


class Activation(ABC):
    """A scalar nonlinearity with the facts that multipliers, bounds and exact pieces are built from.

    Every fact is a promise about all real z, and nothing downstream looks at the name of the class. A new
    activation is one new file that states its formula and these facts.
    """

    @abstractmethod
    def formula(self, z: Any, ops: Any) -> Any:
        """Return phi(z) elementwise with the functions of `ops`: NumPy or CasADi (fmin, fmax, tanh, exp)."""

    @abstractmethod
    def derivative(self, z: ArrayLike) -> Array:
        """Return phi'(z); at a kink, the slope on its right."""

    @property
    @abstractmethod
    def slopes(self) -> tuple[float, float]:
        """Bounds on (phi(r) - phi(s)) / (r - s) over all r != s (Assumption ass:incremental_sector)."""

    @property
    def sector(self) -> tuple[float, float] | None:
        """Bounds on phi(z) / z over all z != 0 (Assumption ass:sector), or None when phi(0) is not 0."""
        return self.slopes

    @property
    def odd(self) -> bool:
        """Whether phi(-z) = -phi(z)."""
        return False

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of phi, infinite where there is none."""
        return (-np.inf, np.inf)

    @property
    def pieces(self) -> Pieces | None:
        """The affine pieces, or None when phi is not piecewise affine."""
        return None

    @property
    def homogeneous(self) -> tuple[float, float] | None:
        """(slope for z <= 0, slope for z >= 0) when phi is linear on each half line from 0, else None."""
        pieces = self.pieces
        if pieces is None or np.any(pieces.intercepts) or np.any(pieces.kinks):
            return None
        return float(pieces.slopes[0]), float(pieces.slopes[-1])

    def slopes_on(self, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
        """Return bounds on (phi(r) - phi(s)) / (r - s) over all r != s in [low, high].

        Piecewise-affine activations: the extreme slopes of the pieces met, exactly. Others: `slopes`, true everywhere; an
        activation that knows its derivative states more. The bounds hold in exact arithmetic. low, high: finite, of any
        common shape.

        Raises InvalidInputError when low > high.
        """
        low, high = as_interval(low, high)
        return slopes_between(self.pieces, low, high) if self.pieces else self._everywhere(low)

    def sector_on(self, center: ArrayLike, low: ArrayLike, high: ArrayLike,
                  spread: ArrayLike = 0.0) -> tuple[Array, Array]:
        """Return bounds on (phi(z) - phi(c)) / (z - c) over z != c, z in [low, high], |c - center| <= spread.

        These are the local sectors of Yin, Seiler and Arcak (IEEE TAC 67(4), 2022) about a center that need only be
        enclosed. Piecewise-affine activations: sharp; others: `slopes`, as in `slopes_on`. Rounded outward, so that the
        bounds hold in exact arithmetic. All of any common shape.

        Raises InvalidInputError when low > high or spread < 0.
        """
        low, high = as_interval(low, high)
        first, last = around(center, spread)
        return sector_between(self.pieces, first, last, low, high) if self.pieces else self._everywhere(low + first)

    def _everywhere(self, like: Array) -> tuple[Array, Array]:
        lowest, highest = self.slopes
        return np.full(like.shape, lowest), np.full(like.shape, highest)

    def __call__(self, z: ArrayLike) -> Array:
        """Return phi(z) elementwise for an array of any shape."""
        return self.formula(np.asarray(z, dtype=float), np)

    def _slope_of_piece(self, z: ArrayLike) -> Array:
        pieces = self.pieces
        assert pieces is not None
        return pieces.slopes[pieces.index(z)]
