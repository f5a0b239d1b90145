"""The identity, for hidden units that are linear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .base import Activation, Pieces


@dataclass(frozen=True)
class Identity(Activation):
    """Identity: phi(z) = z, sector and slopes exactly 1, one piece.

    >>> Identity()([-2.0, 3.0]).tolist()
    [-2.0, 3.0]
    """

    def formula(self, z: Any, ops: Any) -> Any:
        """Return z."""
        return 1.0 * z

    def derivative(self, z: ArrayLike) -> Array:
        """Return 1."""
        return self._slope_of_piece(z)

    @property
    def slopes(self) -> tuple[float, float]:
        """The slope is 1."""
        return (1.0, 1.0)

    @property
    def odd(self) -> bool:
        """phi(-z) = -phi(z)."""
        return True

    @property
    def pieces(self) -> Pieces:
        """One piece without a kink."""
        return Pieces(np.empty(0), np.array([1.0]), np.array([0.0]))
