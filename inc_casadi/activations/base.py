"""The promise of an activation: what it computes and what is true of it everywhere."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array


@dataclass(frozen=True, eq=False)
class Pieces:
    """A continuous piecewise-affine function of one variable, phi(z) = slopes[j] z + intercepts[j] on piece j.

    Piece j reaches from kinks[j - 1] to kinks[j]; the first and last pieces are unbounded.

    kinks: (k,) increasing; slopes: (k + 1,); intercepts: (k + 1,).

    >>> Pieces(np.array([0.0]), np.array([0.0, 1.0]), np.array([0.0, 0.0])).index(np.array([-1.0, 2.0]))
    array([0, 1])
    """

    kinks: Array
    slopes: Array
    intercepts: Array

    def index(self, z: ArrayLike) -> np.ndarray:
        """Return the piece of each z; a z on a kink belongs to the piece on its right."""
        return np.searchsorted(self.kinks, z, side="right")


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

    def __call__(self, z: ArrayLike) -> Array:
        """Return phi(z) elementwise for an array of any shape."""
        return self.formula(np.asarray(z, dtype=float), np)

    def _slope_of_piece(self, z: ArrayLike) -> Array:
        pieces = self.pieces
        assert pieces is not None
        return pieces.slopes[pieces.index(z)]
