"""The homogeneous unit with one slope on each side of zero: what any kinked unit looks like from its kink."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, number
from .base import Activation, Pieces


@dataclass(frozen=True)
class TwoSlopes(Activation):
    """phi(z) = left z for z <= 0 and right z for z >= 0; sector and slopes between the two.

    left, right: any finite slopes; equal ones give a straight unit. Raises InvalidInputError for NaN or infinities.

    >>> TwoSlopes(1.0, 0.25)([-2.0, 4.0]).tolist()
    [-2.0, 1.0]
    """

    left: float
    right: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "left", number("left slope", self.left))
        object.__setattr__(self, "right", number("right slope", self.right))

    def formula(self, z: Any, ops: Any) -> Any:
        """Return left min(z, 0) + right max(z, 0): one of the two is zero, so the sum is not rounded."""
        return self.left * ops.fmin(z, 0.0) + self.right * ops.fmax(z, 0.0)

    def derivative(self, z: ArrayLike) -> Array:
        """Return the left slope for z < 0 and the right one for z >= 0."""
        return self._slope_of_piece(z)

    @property
    def slopes(self) -> tuple[float, float]:
        """The smaller and the larger slope."""
        return (min(self.left, self.right), max(self.left, self.right))

    @property
    def odd(self) -> bool:
        """Odd only when straight."""
        return self.left == self.right

    @property
    def bounds(self) -> tuple[float, float]:
        """Unbounded on each side that a slope reaches."""
        low = -np.inf if self.left > 0 or self.right < 0 else 0.0
        high = np.inf if self.left < 0 or self.right > 0 else 0.0
        return (low, high)

    @property
    def pieces(self) -> Pieces:
        """left z, then right z, meeting at 0."""
        return Pieces(np.array([0.0]), np.array([self.left, self.right]), np.array([0.0, 0.0]))
