"""The saturation to [-1, 1]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .base import Activation, Pieces


@dataclass(frozen=True)
class Saturation(Activation):
    """Saturation: phi(z) = max(-1, min(z, 1)); sector and slopes in [0, 1]; other limits are scaled into U, V, b, d.

    >>> Saturation()([-2.0, 0.5, 3.0]).tolist()
    [-1.0, 0.5, 1.0]
    """

    def formula(self, z: Any, ops: Any) -> Any:
        """Return max(-1, min(z, 1))."""
        return ops.fmax(-1.0, ops.fmin(z, 1.0))

    def derivative(self, z: ArrayLike) -> Array:
        """Return 1 for -1 <= z < 1 and 0 elsewhere."""
        return self._slope_of_piece(z)

    @property
    def slopes(self) -> tuple[float, float]:
        """Slopes lie in [0, 1]."""
        return (0.0, 1.0)

    @property
    def odd(self) -> bool:
        """sat(-z) = -sat(z)."""
        return True

    @property
    def bounds(self) -> tuple[float, float]:
        """Values lie in [-1, 1]."""
        return (-1.0, 1.0)

    @property
    def pieces(self) -> Pieces:
        """-1, then z, then 1, meeting at -1 and 1."""
        return Pieces(np.array([-1.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 1.0]))
