"""The rectified linear unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .base import Activation, Pieces


@dataclass(frozen=True)
class ReLU(Activation):
    """ReLU: phi(z) = max(z, 0), sector and slopes in [0, 1], two pieces that meet at 0.

    >>> ReLU()([-2.0, 3.0]).tolist()
    [0.0, 3.0]
    """

    def formula(self, z: Any, ops: Any) -> Any:
        """Return max(z, 0)."""
        return ops.fmax(z, 0.0)

    def derivative(self, z: ArrayLike) -> Array:
        """Return 0 for z < 0 and 1 for z >= 0."""
        return self._slope_of_piece(z)

    @property
    def slopes(self) -> tuple[float, float]:
        """Slopes lie in [0, 1]."""
        return (0.0, 1.0)

    @property
    def bounds(self) -> tuple[float, float]:
        """ReLU is nonnegative."""
        return (0.0, np.inf)

    @property
    def pieces(self) -> Pieces:
        """0 on the left of 0, z on its right."""
        return Pieces(np.array([0.0]), np.array([0.0, 1.0]), np.array([0.0, 0.0]))
