"""Global exponential stability, in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import number
from ..errors import InvalidInputError
from ..figures import at_least, at_most
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Unknown, constant
from ..plant import Plant
from .base import DECREASE, Claim, Graphs, descent, positive, storage, storage_form


@dataclass(frozen=True, eq=False)
class Stability(Claim):
    """The equilibrium is globally exponentially stable, at a rate. Sufficient, not necessary.

    With V(x) = x'P x, P > 0, along every motion:

    * discrete time (thm:dt_stability): rho^2 X'PX - F'PF - M > 0 gives V(x_k) <= rho^(2k) V(x_0), rate = rho in [0, 1);
    * continuous time (thm:ct_stability): -He(X'P Fc) - alpha X'PX - M > 0 gives V(x(t)) <= exp(-alpha t) V(x(0)),
      rate = alpha > 0 in 1/s.

    The proof: s'(...)s > 0 and s'M s >= 0 on the graph of the activation leave V(x+) <= rho^2 V(x), or
    dV/dt <= -alpha V; thm:wellposed makes the motions exist.
    rate None: at some rate that is not named (rho = 1 or alpha = 0 with the strict inequality; by continuity it
    then holds with some rho < 1 or alpha > 0). `certify` replaces it by the best rate that it finds.

    A biased controller (thm:incremental_certificate): x, eta are then differences of two motions and M holds by slopes,
    so any two motions approach each other in the norm of P: one step (or the flow over one second) is a contraction of
    R^n, and by Banach's fixed-point theorem there is exactly one equilibrium x*. The statement holds about x*.

    Raises InvalidInputError for a rate that is negative or not finite; `check` for one that does not fit the plant.

    >>> Stability(rate=0.9).rate
    0.9
    """

    rate: float | None = None

    def __post_init__(self) -> None:
        if self.rate is not None:
            object.__setattr__(self, "rate", number("rate", self.rate, 0.0))

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise InvalidInputError for rho >= 1 in discrete time or alpha <= 0 in continuous time."""
        if self.rate is None:
            return
        if plant.discrete and self.rate >= 1.0:
            raise InvalidInputError(f"rate = {self.rate:g} is outside [0, 1): in discrete time V shrinks by rate^2 in "
                                    "every step")
        if not plant.discrete and self.rate <= 0.0:
            raise InvalidInputError(f"rate = {self.rate:g} must be positive: in continuous time V decays as "
                                    "exp(-rate t)")

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return P, symmetric, over what V is quadratic in."""
        return (storage(graphs),)

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return V > 0 and the decrease, over the stack."""
        P, step = values["P"], graphs[DECREASE]
        X = step.X
        if step.plant.discrete:
            rho = constant(step, 1.0 if self.rate is None else self.rate)
            decrease = (rho * rho) * (X.T @ P @ X) - step.F.T @ P @ step.F - M[DECREASE]
        else:
            alpha = constant(step, 0.0 if self.rate is None else self.rate)
            decrease = descent(step, P) - alpha * (X.T @ P @ X) - M[DECREASE]
        return {**positive(graphs, P, M), "decrease": decrease}

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return rho, or alpha in 1/s; 1 or 0 when no rate is named."""
        if self.rate is None:
            return 1.0 if loop.plant.discrete else 0.0
        return self.rate

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return 1 - rho, or alpha: the faster the stronger."""
        rate = self.bound(loop, values)
        return 1.0 - rate if loop.plant.discrete else rate

    def growth(self, discrete: bool) -> float:
        """Return rho, or -alpha / 2, for V is of second degree; 1 or 0 when no rate is named."""
        if self.rate is None:
            return 1.0 if discrete else 0.0
        return self.rate if discrete else -self.rate / 2

    @property
    def sums(self) -> bool:
        """Whether no rate is named."""
        return self.rate is None

    @property
    def tunable(self) -> bool:
        """Whether the rate is left open."""
        return self.rate is None

    def at(self, level: float, loop: ClosedLoop) -> Stability:
        """Return the claim at speed 1 - rho, or alpha."""
        return Stability(1.0 - level if loop.plant.discrete else level)

    def ceiling(self, loop: ClosedLoop) -> float:
        """Return 1 - rho = 1, or infinity."""
        return 1.0 if loop.plant.discrete else np.inf

    @property
    def yes_or_no(self) -> bool:
        """Whether a rate was asked for."""
        return self.rate is not None

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise with its rate."""
        about = "the origin" if loop.inc.preserves_origin else "its only equilibrium x*"
        V = storage_form(loop, values)
        if self.rate is None:
            speed = "the distance falls to zero at a rate that is not named"
        elif loop.plant.discrete:
            speed = f"{V} shrinks at least by the factor {at_most(self.rate)}^2 in every step"
        else:
            speed = f"{V} decays at least as exp(-{at_least(self.rate)} t), t in seconds"
        return f"The loop is globally exponentially stable about {about}: from every initial state, {speed}."
