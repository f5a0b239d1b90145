"""The leaky rectified linear unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, number
from .base import Activation, Pieces


@dataclass(frozen=True)
class LeakyReLU(Activation):
    """Leaky ReLU: phi(z) = max(z, slope z) with slope in [0, 1]; sector and slopes in [slope, 1].

    slope: the slope for z < 0; 0 gives the ReLU and 1 the identity.
    Raises InvalidInputError when the slope is outside [0, 1].

    >>> LeakyReLU(0.5)([-2.0, 3.0]).tolist()
    [-1.0, 3.0]
    """

    slope: float = 0.01

    def __post_init__(self) -> None:
        object.__setattr__(self, "slope", number("leaky ReLU slope", self.slope, 0.0, 1.0))

    def formula(self, z: Any, ops: Any) -> Any:
        """Return max(z, slope z)."""
        return ops.fmax(z, self.slope * z)

    def derivative(self, z: ArrayLike) -> Array:
        """Return the slope for z < 0 and 1 for z >= 0."""
        return self._slope_of_piece(z)

    @property
    def slopes(self) -> tuple[float, float]:
        """Slopes lie in [slope, 1]."""
        return (self.slope, 1.0)

    @property
    def odd(self) -> bool:
        """Odd only when the slope is 1, the identity."""
        return self.slope == 1.0

    @property
    def bounds(self) -> tuple[float, float]:
        """Nonnegative when the slope is 0, unbounded otherwise."""
        return (0.0 if self.slope == 0.0 else -np.inf, np.inf)

    @property
    def pieces(self) -> Pieces:
        """slope z on the left of 0, z on its right."""
        return Pieces(np.array([0.0]), np.array([self.slope, 1.0]), np.array([0.0, 0.0]))
