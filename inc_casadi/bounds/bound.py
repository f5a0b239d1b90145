"""A lower bound on what a class of controllers costs, with the numbers that prove it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from fractions import Fraction
from math import isfinite
from time import perf_counter

from ..brief import Brief
from ..certificate import EXACT, Proof
from ..plant import Plant
from ..spec import Spec


@dataclass(frozen=True, eq=False)
class Bound(Brief, ABC):
    """The claim that every controller of a class costs at least `value` on `plant` under `spec`.

    The value is that of a dual point which is feasible by construction, evaluated in NumPy and lowered by a rounding
    allowance; no solver has to be trusted. `float(bound)` is the value.

    Parameters
    ----------
    plant, spec : what the bound is about
    value : the bound, in the units of the cost
    seconds : wall time of finding it
    cut_short : whether a time limit ended the search, so that a longer one may prove more

    Notes
    -----
    Weak duality: f(w) >= g(lambda) for each admissible w and each lambda >= 0. A poor lambda makes a bound low, never
    wrong.
    """

    plant: Plant = field(repr=False)
    spec: Spec = field(repr=False)
    value: float
    seconds: float
    cut_short: bool = field(default=False, kw_only=True)

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        return self.statement

    @property
    @abstractmethod
    def statement(self) -> str:
        """One sentence for an engineer: who costs at least what."""

    @abstractmethod
    def dual(self) -> tuple[float, float]:
        """Return the weak-duality value recomputed from the stored numbers, and the rounding allowance (>= 0)."""

    def exact_value(self) -> Fraction | str:
        """Return the weak-duality value in exact rational arithmetic, or in words why there is none."""
        return "this bound is not stated in exact arithmetic"

    def prove(self) -> Proof:
        """Settle the bound in exact rational arithmetic: every stored float is taken as exactly the number it is."""
        begun = perf_counter()
        found = self.exact_value()
        if isinstance(found, str):
            return Proof(False, EXACT, perf_counter() - begun, found)
        short = "" if Fraction(self.value) <= found else f"the exact value is {float(found)!r}, below the stated one"
        return Proof(not short, EXACT, perf_counter() - begun, short)

    def holds(self) -> bool:
        """Return whether the stored numbers prove the value: NumPy only, no solver.

        Half of the allowance is left for machines that add up in another order.
        """
        value, allowance = self.dual()
        return isfinite(self.value) and self.value <= value - allowance / 2
