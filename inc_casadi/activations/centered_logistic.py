"""The logistic sigmoid shifted through the origin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .bell import Bell


@dataclass(frozen=True)
class CenteredLogistic(Bell):
    """Centered logistic sigmoid: phi(z) = 1 / (1 + exp(-z)) - 1/2 = tanh(z / 2) / 2; sector and slopes in [0, 1/4].

    Since the slope is at most 1/4, W is well posed already when lambda_pf(|W|) < 4.

    >>> CenteredLogistic()(0.0).item()
    0.0
    """

    def formula(self, z: Any, ops: Any) -> Any:
        """Return tanh(z / 2) / 2, which does not overflow."""
        return 0.5 * ops.tanh(0.5 * z)

    def derivative(self, z: ArrayLike) -> Array:
        """Return (1 - tanh(z / 2)^2) / 4."""
        return 0.25 * (1.0 - np.tanh(0.5 * np.asarray(z, dtype=float)) ** 2)

    @property
    def slopes(self) -> tuple[float, float]:
        """Slopes lie in [0, 1/4]."""
        return (0.0, 0.25)

    @property
    def odd(self) -> bool:
        """phi(-z) = -phi(z)."""
        return True

    @property
    def bounds(self) -> tuple[float, float]:
        """Values lie in [-1/2, 1/2]."""
        return (-0.5, 0.5)
