"""Actuators whose gain is off: a sector at the plant input, with its gain and phase margins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..blocks import diag, he
from ..errors import InvalidInputError
from ..figures import at_least, at_most
from ..loop import ClosedLoop
from ..multipliers.base import Unknown, constant
from ..plant import Plant
from .base import Uncertainty


@dataclass(frozen=True)
class InputSector(Uncertainty):
    """The plant gets psi_i(u_i) for u_i, with psi_i in the sector [low, high], 0 <= low <= 1 <= high, each on its own.

    w = psi(u) - u enters with E = B and obeys sum_i tau_i (w_i - (low - 1) u_i) ((high - 1) u_i - w_i) >= 0 for tau >= 0:
    sound for every nonlinear, time-varying gain in the sector. The same sum over time is nonnegative for a linear
    stable system, started at rest, whose frequency response lies in the disk with diameter [low, high]: it is a gain of the
    disk's center plus one of its radius, and that is causal. So a phase lag of arccos((1 + low high)/(low + high)) in every
    channel is tolerated too (Seiler, Packard, Gahinet, IEEE Control Systems Magazine 40(5), 2020).

    Raises InvalidInputError for other ends.

    >>> round(InputSector(0.5, 2.0).phase, 4)   # degrees: the circle with diameter [0.5, 2] meets the unit circle there
    36.8699
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", number("low", self.low, 0.0))
        object.__setattr__(self, "high", number("high", self.high, 0.0))
        if not self.low <= 1.0 <= self.high:
            raise InvalidInputError(f"the sector [{self.low:g}, {self.high:g}] at the plant input must contain the gain 1")

    @classmethod
    def disk(cls, alpha: float) -> InputSector:
        """Return the symmetric disk margin alpha in [0, 2): gains in [(2 - alpha)/(2 + alpha), (2 + alpha)/(2 - alpha)].

        >>> round(InputSector.disk(2 / 3).low, 12)
        0.5
        """
        alpha = number("alpha", alpha, 0.0, 2.0, open_high=True)
        return cls((2.0 - alpha) / (2.0 + alpha), (2.0 + alpha) / (2.0 - alpha))

    @property
    def phase(self) -> float:
        """Phase margin in degrees, 0 when the unit circle is left at once.

        1 - cos(theta) = (1 - low)(high - 1)/(low + high) = 2 sin^2(theta / 2): no digits cancel for a narrow sector.
        """
        half = (1.0 - self.low) * (self.high - 1.0) / (2.0 * (self.low + self.high))
        return float(np.degrees(2.0 * np.arcsin(np.sqrt(half))))

    def check(self, plant: Plant) -> None:
        """Fit every plant."""

    def entry(self, plant: Plant) -> Array:
        """Return B."""
        return plant.B

    def unknowns(self, plant: Plant) -> tuple[Unknown, ...]:
        """Return tau (m,)."""
        return (Unknown("tau", (plant.m,), "nonnegative"),)

    def matrix(self, loop: ClosedLoop, w: Array, values: dict[str, Any]) -> Any:
        """Return the weighted sector inequality of w and u."""
        one, u = constant(loop, 1.0), loop.G
        below, above = constant(loop, self.low) - one, constant(loop, self.high) - one
        return he((w - below * u).T @ diag(values["tau"]) @ (above * u - w))

    def words(self, dynamic: bool) -> str:
        """Return the set in words, with the phase margin where dynamic perturbations are covered."""
        gains = (f"gain between {at_most(self.low)} and {at_least(self.high)} at each plant input, nonlinear and "
                 "time-varying ones included")
        return gains + (f", and every phase lag up to {at_least((1.0 - 1e-12) * self.phase)} degrees" if dynamic else "")
