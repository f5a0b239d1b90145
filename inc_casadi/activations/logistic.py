"""The logistic sigmoid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .bell import Bell


@dataclass(frozen=True)
class Logistic(Bell):
    """Logistic sigmoid: phi(z) = 1 / (1 + exp(-z)), slopes in [0, 1/4], values in [0, 1].

    phi(0) = 1/2, so it has no sector at the origin: its loops are certified about their equilibrium only
    (thm:incremental_certificate).

    >>> Logistic()(0.0).item()
    0.5
    """

    def formula(self, z: Any, ops: Any) -> Any:
        """Return (1 + tanh(z / 2)) / 2, which does not overflow."""
        return 0.5 + 0.5 * ops.tanh(0.5 * z)

    def derivative(self, z: ArrayLike) -> Array:
        """Return (1 - tanh(z / 2)^2) / 4."""
        return 0.25 * (1.0 - np.tanh(0.5 * np.asarray(z, dtype=float)) ** 2)

    @property
    def slopes(self) -> tuple[float, float]:
        """Slopes lie in [0, 1/4]."""
        return (0.0, 0.25)

    @property
    def sector(self) -> None:
        """None: phi(0) = 1/2."""
        return None

    @property
    def bounds(self) -> tuple[float, float]:
        """Values lie in [0, 1]."""
        return (0.0, 1.0)
