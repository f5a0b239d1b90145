"""A claim for every plant of an uncertain family."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InvalidInputError
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Multiplier, Unknown
from ..plant import Plant
from ..uncertainty import Uncertainty
from .base import DECREASE, Claim, Graphs

NOT_BIASED = ("it is about the origin of an uncertain plant, so the controller must preserve it (b = 0, d = 0, "
              "phi(0) = 0): a biased loop rests elsewhere for each plant. Claim it of each plant by itself, or take the "
              "biases out")


@dataclass(frozen=True, eq=False)
class Robust(Claim):
    """A claim that holds for every Delta of an uncertainty, with one V for all of them. Sufficient, not necessary.

    The inequalities are those of the claim over the stack (x, eta, w), with the uncertainty's form N added to M: where
    s'M s >= 0 and s'N s >= 0 (a static Delta), V decreases as before. A dynamic Delta makes only the sums of s'N s over time
    nonnegative; that is enough where the claim's proof sums with weights that do not grow (`Claim.sums`; by Abel's
    summation), and not for a named rate, whose weights grow.

    claim: say `Stability()`, `DiscountedCost` or `L2Gain`; uncertainty: `NormBounded` or `InputSector`.
    Raises InvalidInputError for what is none, and for a biased controller.

    >>> from inc_casadi.claims import Stability
    >>> from inc_casadi.uncertainty import InputSector
    >>> Robust(Stability(), InputSector(0.5, 2.0)).yes_or_no
    True
    """

    claim: Claim
    uncertainty: Uncertainty

    def __post_init__(self) -> None:
        if not isinstance(self.claim, Claim) or self.claim.uncertain or self.claim.compound:
            raise InvalidInputError(f"claim is {self.claim!r}, but must be a Claim about one step that is not robust "
                                    "already: put Robust inside Polytopic or Together")
        if not isinstance(self.uncertainty, Uncertainty):
            raise InvalidInputError(f"uncertainty is {self.uncertainty!r}, but must be an Uncertainty such as InputSector")

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise when the claim or the uncertainty does not fit, or the controller is biased."""
        self.claim.check(plant, inc)
        self.uncertainty.check(plant)
        if not inc.preserves_origin:
            raise InvalidInputError(f"a robust claim cannot be made: {NOT_BIASED}")

    def refusal(self, loop: ClosedLoop, multiplier: Multiplier) -> str | None:
        """Return why the claim refuses the multiplier over the loop with w."""
        return self.claim.refusal(self._opened(loop), multiplier)

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return the claim's graphs of the loop with w."""
        return self.claim.graphs(self._opened(loop), multiplier)

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return the claim's unknowns and the uncertainty's."""
        return (*self.claim.unknowns(graphs), *self.uncertainty.unknowns(graphs[DECREASE].plant))

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return the claim's conditions with N added to the multiplier of the step."""
        step = graphs[DECREASE]
        r = self.uncertainty.entry(step.plant).shape[1]
        w = np.eye(step.width)[step.n + step.q: step.n + step.q + r]
        N = self.uncertainty.matrix(step, w, dict(values))
        return self.claim.conditions(graphs, values, {**M, DECREASE: M[DECREASE] + N})

    def objective(self, graphs: Graphs, values: Mapping[str, Any]) -> Any:
        """Return the claim's objective."""
        return self.claim.objective(graphs, values)

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the claim's bound."""
        return self.claim.bound(loop, values)

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the claim's merit."""
        return self.claim.merit(loop, values)

    @property
    def uncertain(self) -> bool:
        """Yes."""
        return True

    @property
    def sums(self) -> bool:
        """Whether the claim's proof sums with weights that do not grow."""
        return self.claim.sums

    @property
    def yes_or_no(self) -> bool:
        """Whether the claim is; an open rate is not tuned for a family."""
        return self.claim.yes_or_no or self.claim.tunable

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise, for every plant of the family."""
        return f"For every {self.uncertainty.words(self.claim.sums)}: {self.claim.sentence(loop, values)}"

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return the claim's obstacle."""
        return self.claim.obstacle(plant, inc, exactly=exactly)

    def _opened(self, loop: ClosedLoop) -> ClosedLoop:
        return loop.with_inputs(self.uncertainty.entry(loop.plant))
