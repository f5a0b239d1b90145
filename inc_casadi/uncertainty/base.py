"""What an uncertainty promises: signals that enter the plant, bounded by others in a quadratic constraint."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from ..arrays import Array
from ..brief import Brief
from ..loop import ClosedLoop
from ..multipliers.base import Unknown
from ..plant import Plant


class Uncertainty(Brief, ABC):
    """Signals w = Delta(v) that enter as x+ = A x + B u + E w, for every Delta of a set.

    Promise: with nonnegative values of its unknowns the form s'N s of `matrix` has sum_{k<=K} s_k'N s_k >= 0 (in
    continuous time an integral) for every K, every Delta of the set and every motion. For a static Delta, time-varying
    or not, each term is nonnegative; a dynamic one has the sums by causality.
    """

    @abstractmethod
    def check(self, plant: Plant) -> None:
        """Raise DimensionError when it does not fit the plant."""

    @abstractmethod
    def entry(self, plant: Plant) -> Array:
        """Return E, (n, r)."""

    @abstractmethod
    def unknowns(self, plant: Plant) -> tuple[Unknown, ...]:
        """Return the weights to look for."""

    @abstractmethod
    def matrix(self, loop: ClosedLoop, w: Array, values: dict[str, Any]) -> Any:
        """Return N over the stack of the loop, in which w (r, width) are the rows of its own signals."""

    @abstractmethod
    def words(self, dynamic: bool) -> str:
        """Return the set in words, to follow `for every`; dynamic: whether dynamic Delta are covered."""
