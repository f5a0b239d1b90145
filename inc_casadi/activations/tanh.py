"""The hyperbolic tangent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .bell import Bell


@dataclass(frozen=True)
class Tanh(Bell):
    """Hyperbolic tangent: sector and slopes in [0, 1], odd, values in [-1, 1].

    >>> Tanh()(0.0).item()
    0.0
    """

    def formula(self, z: Any, ops: Any) -> Any:
        """Return tanh(z)."""
        return ops.tanh(z)

    def derivative(self, z: ArrayLike) -> Array:
        """Return 1 - tanh(z)^2."""
        return 1.0 - np.tanh(z) ** 2

    @property
    def slopes(self) -> tuple[float, float]:
        """Slopes lie in [0, 1]."""
        return (0.0, 1.0)

    @property
    def odd(self) -> bool:
        """tanh(-z) = -tanh(z)."""
        return True

    @property
    def bounds(self) -> tuple[float, float]:
        """Values lie in [-1, 1]."""
        return (-1.0, 1.0)
