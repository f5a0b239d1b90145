"""The claim of eq:regional_input_check: on a compact set, inputs within their limits and a next state in the set again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..brief import Brief
from ..errors import DimensionError, InvalidInputError
from ..plant import Plant
from ..sets import Box, Polytope

Number = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Rows(Brief):
    """Half-spaces E x + G u <= t over a state and the input at it: E (k, n), G (k, m), t (k,)."""

    E: Array
    G: Array
    t: Array


@dataclass(frozen=True, eq=False)
class Invariance(Brief):
    """For every x of a region X: pi(C x) lies in U and A x + B pi(C x) lies in X (eq:regional_input_check).

    Both are half-spaces: H_u u <= h_u, and H (A x + B u) <= h with X = {x: H x <= h}. A motion that starts in X then
    stays in X and its inputs in U for ever, by induction. No convergence is claimed.

    region: Box or Polytope in state units; inputs: Box or Polytope in R^m, in the units of u, or None for no limits.

    Raises InvalidInputError for another kind of set.

    >>> Invariance(Box([-1.0], [1.0]), Box([-2.0], [2.0])).rows(Plant([[0.5]], [[3.0]])).G.tolist()
    [[1.0], [-1.0], [3.0], [-3.0]]
    """

    region: Box | Polytope
    inputs: Box | Polytope | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.region, Box | Polytope):
            raise InvalidInputError(f"region must be a Box or a Polytope, not {self.region!r}")
        if self.inputs is not None and not isinstance(self.inputs, Box | Polytope):
            raise InvalidInputError(f"inputs must be a Box, a Polytope or None, not {self.inputs!r}")

    def check(self, plant: Plant) -> None:
        """Raise DimensionError when the claim does not fit the plant."""
        if self.region.dimension != plant.n:
            raise DimensionError(f"the region lies in R^{self.region.dimension}, but the plant has {plant.n} states")
        if self.inputs is not None and self.inputs.dimension != plant.m:
            raise DimensionError(f"the input set lies in R^{self.inputs.dimension}, but the plant has {plant.m} inputs")

    @property
    def limits(self) -> int:
        """How many of the rows speak of inputs; they come first."""
        return 0 if self.inputs is None else self.inputs.h.size

    def rows(self, plant: Plant, number: Number = np.asarray) -> Rows:
        """Return the half-spaces, those of U and then those of X at the next state.

        number: turns float arrays into the numbers to compute with. With np.abs, every term is taken absolutely: the
        sizes that rounding is relative to.
        """
        H, h = number(self.region.H), number(self.region.h)
        E, G, t = H @ number(plant.A), H @ number(plant.B), h
        if self.inputs is None:
            return Rows(E, G, t)
        none = number(np.zeros((self.limits, plant.n)))
        return Rows(np.vstack([none, E]), np.vstack([number(self.inputs.H), G]), np.concatenate([number(self.inputs.h), t]))

    def name(self, row: int) -> str:
        """Return what a row of the half-spaces speaks of, in words."""
        if row < self.limits:
            return f"half-space {row} of the input set"
        return f"half-space {row - self.limits} of the region at the next state"


@dataclass(frozen=True, eq=False)
class Slacks(Brief):
    """What a method found about t - (E x + G u) over the region, row by row.

    least (k,): a lower bound on it, -inf when there is none; how reliable it is depends on the method. reached (k,): the
    smallest value found at a point of the region, and points (k, n) where; infinite and NaN when none was looked at.
    ended: the budget that ran out before `least` was as good as the method can make it, or "". work: pieces, cells or nodes.
    """

    least: Array
    reached: Array
    points: Array
    ended: str
    work: int
    seconds: float

    def worst(self) -> int:
        """Return the row whose slack may be smallest.

        >>> Slacks(np.array([2.0, 1.0]), np.array([3.0, 1.5]), np.zeros((2, 1)), "", 1, 0.0).worst()
        1
        """
        return int(np.argmin(np.where(np.isfinite(self.least), self.least, self.reached)))
